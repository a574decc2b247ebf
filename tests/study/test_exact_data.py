"""Studies of data without noise: the search stops at rounding, and says that nothing is left."""

from __future__ import annotations

import warnings

import pytest

from modelsel import Study, run_study, simulate_study
from modelsel.study.pipeline.result import Result

TOOL = {"name": "ur5", "tool_mm": [30, 0, 100]}
OVERSHOOT = {"frame": 4, "axis": "rz", "cause": "approach4", "size": 4e-4}
NOTHING_LEFT = "Nothing is left to explain: the model agrees with the measurements to rounding."


def study_exact(effects: list[dict[str, object]], candidates: str | list[str]) -> Result:
    """Study 40 simulated configurations of a UR5, without noise."""
    planned = Study(
        name="exact",
        measurements={"file": "not-yet.csv"},
        robot=TOOL,
        simulate={"configurations": 40, "noise_mm": 0.0, "effect": effects},
    )
    study = Study(
        name="exact",
        measurements=simulate_study(planned),
        robot=TOOL,
        model={"candidates": candidates},
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        return run_study(study, sampling=False)


@pytest.mark.slow
@pytest.mark.parametrize("candidates", ["all", []])
def test_a_perfect_arm_leaves_nothing(candidates) -> None:
    result = study_exact([], candidates)
    assert result.record.nothing_else.sentence == NOTHING_LEFT
    assert result.record.nothing_else.predictable is None
    assert not result.record.findings


def test_the_search_stops_where_effects_explain_everything() -> None:
    result = study_exact([OVERSHOOT], ["overshoot:4", "approach-backlash:2", "thermal-growth"])
    assert [finding.estimate[0].symbol for finding in result.record.findings] == ["o4"]
    assert result.record.findings[0].estimate[0].value == pytest.approx(4e-4)
    assert result.record.nothing_else.sentence == NOTHING_LEFT
