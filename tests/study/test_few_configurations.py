"""Studies of so few configurations, or of so few postures, that no candidate is left beyond the base."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from modelsel import Study, run_study, simulate_study

# geometric has 24 parameters that a UR5's positions determine: 9 configurations leave 3 numbers, or,
# where these hold the rest of the geometry as well as that, none: then the study is refused
FEW = 9


def plan(configurations: int) -> Study:
    """A study of a UR5 with an error that the geometry has, to be simulated."""
    return Study(
        name="few",
        measurements={"file": "not-yet.csv"},
        robot={"name": "ur5", "tool_mm": [30, 0, 100]},
        simulate={
            "configurations": configurations,
            "noise_mm": 0.05,
            "effect": [{"frame": 3, "axis": "rz", "cause": "1", "size": 1e-3}],
        },
    )


def build_study(configurations: int, estimation: int | None, candidates: str | list[str]) -> Study:
    """The same, simulated."""
    return Study(
        name="few",
        measurements=simulate_study(plan(configurations)),
        robot={"name": "ur5", "tool_mm": [30, 0, 100]},
        model={"base": ["geometric"], "candidates": candidates},
        split={} if estimation is None else {"estimation": estimation},
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("configurations", "estimation", "candidates"),
    [(FEW, None, "all"), (14, FEW, ["approach-backlash:4", "joint3-twist"]), (14, FEW, [])],
)
def test_few_configurations_end_in_a_verdict(configurations, estimation, candidates) -> None:
    study = build_study(configurations, estimation, candidates)
    result = run_study(study, sampling=False)
    sentences = " ".join(result.record.verdict)
    assert "No error beyond the base model was named." in sentences
    assert "the data are too few for any further effect" in sentences
    assert not result.record.findings
    assert result.record.nothing_else.detection_limit_mm is None


@pytest.mark.slow
def test_postures_that_are_measured_again_are_not_taken_for_others(
    rng: np.random.Generator,
) -> None:
    """Six postures, four times each, that 18 parameters fit exactly: no effect could be found."""
    planned = plan(12)
    once = simulate_study(planned)
    rounds = []
    for _ in range(4):
        again = once.copy()
        again[["x_mm", "y_mm", "z_mm"]] += rng.normal(0, 0.03, (12, 3))
        rounds.append(again)
    repeated = Study(
        name="few",
        measurements=pd.concat(rounds, ignore_index=True),
        robot=planned.robot,
        model={"base": ["geometric"]},
        split={"estimation": 24},
    )
    result = run_study(repeated, sampling=False)
    told = result.record.nothing_else
    assert "the model fits its 6 postures whatever is measured there" in told.sentence
    assert told.detection_limit_mm is None
