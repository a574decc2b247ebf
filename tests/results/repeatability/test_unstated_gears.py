"""Joints that seem not to repeat: the gear ratios are asked for where they may tell more."""

from __future__ import annotations

from dataclasses import replace

import pytest
from error_parts import INSTRUMENT, part

from modelsel.fitting.error_structure import ErrorStructure
from modelsel.results.repeatability.repeatability import describe_errors
from modelsel.results.repeatability.unstated_gears import find_unstated_gears
from modelsel.robot.files import load_robot

ARM = load_robot("ur5")
ASKED = "state gear_ratios under [robot]"


def _say(told_by: str, share: float, ratios: list[float] | None) -> str:
    """What is said of joint 2, whose part is a share of what is left, beside the gear ratios."""
    joint = part("joint 2", 21e-6, 18e-6, 24e-6, told_by=told_by, share=share)
    errors = ErrorStructure((replace(INSTRUMENT, share=1 - share), joint))
    unstated = find_unstated_gears(errors, ARM, ratios)
    told = {
        one["part"]: one["sentence"] for one in describe_errors(errors, unstated_gears=unstated)
    }
    assert ASKED not in told["instrument"]
    return told["joint 2"]


@pytest.mark.parametrize("ratios", [None, [101, 0, 101, 50, 50, 50]])
def test_gear_ratios_are_asked_for(ratios: list[float] | None) -> None:
    assert ASKED in _say("directions", 0.7, ratios)


@pytest.mark.parametrize(
    ("told_by", "share", "ratios"),
    [("directions", 0.7, [101.0] * 6), ("directions", 0.3, None), ("repeats", 0.7, None)],
)
def test_they_are_not_where_nothing_would_come_of_it(
    told_by: str, share: float, ratios: list[float] | None
) -> None:
    assert ASKED not in _say(told_by, share, ratios)
