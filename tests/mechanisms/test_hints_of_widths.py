"""A width that hysteresis does not have is answered with the nearest that it has, of the same joint."""

from __future__ import annotations

import pytest

from modelsel.exceptions import StudyError
from modelsel.measurements.campaign.state_names import state_units
from modelsel.mechanisms.cause_formulas import parse
from modelsel.robot.files import load_robot

UNITS = state_units(load_robot("ur5"))


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        ("drag2_501", "drag2_500"),
        ("drag3_99", "drag3_100"),
        ("drag2_5000", "drag2_1400"),
        ("drag4", "drag4_500"),
        ("drg2_500", "drag2_500"),
    ],
)
def test_the_nearest_width_is_meant(given: str, meant: str) -> None:
    """By its letters 501 looked most like 50."""
    with pytest.raises(StudyError, match=f'Did you mean "{meant}"'):
        parse(given, UNITS)


def test_another_name_is_told_by_its_letters() -> None:
    with pytest.raises(StudyError, match='Did you mean "torque2"'):
        parse("torq2", UNITS)
