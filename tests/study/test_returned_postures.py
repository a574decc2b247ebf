"""A campaign that comes back to its postures, with readings as encoders give them: never twice the
same."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from builders import seeds

from modelsel.config.study_file import Study
from modelsel.exceptions import StudyError
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward
from modelsel.study.pipeline.runner import run_study

TOOL = (120.0, 40.0, 80.0)
POSTURES, TIMES, SIGMA = 50, 4, 0.03
JITTER = np.radians(0.002)


def measure(rng: np.random.Generator, lasting: float) -> pd.DataFrame:
    """Positions of an arm whose joint 1 is off by what lasts at a posture (rms, rad), as where the way
    that led there is not in the file."""
    arm = load_robot("ur5")
    posture = rng.permutation(np.repeat(np.arange(POSTURES), TIMES))
    readings = arm.draw(rng, POSTURES)[posture]
    readings += rng.normal(0, JITTER, readings.shape)
    turned = readings.copy()
    turned[:, 0] += lasting * rng.standard_normal(POSTURES)[posture]
    position = forward(arm, turned, np.array(TOOL)) + rng.normal(0, SIGMA, (len(readings), 3))
    columns = {f"q{j}_rad": column for j, column in enumerate(readings.T, 1)}
    return pd.DataFrame(columns | dict(zip(("x_mm", "y_mm", "z_mm"), position.T, strict=True)))


@pytest.mark.slow
@seeds(1, 2, 3)
def test_what_lasts_at_a_posture_is_no_cause(rng: np.random.Generator) -> None:
    """With every row for itself, eight shapes of single joints explained it, each as certain, and
    held-out rows of the same postures agreed."""
    study = Study(
        name="returns",
        measurements=measure(rng, 3e-4),
        robot={"name": "ur5", "tool_mm": list(TOOL)},
        model={"base": ["geometric"]},
    )
    record = run_study(study, sampling=False).record
    certain = [one.claim.text for one in record.findings if one.claim.probability > 0.9]
    assert not certain
    assert "postures-repeated" in {note.code for note in record.warnings}
    (part,) = [one for one in record.repeatability if one.part in {"configuration", "joint 1"}]
    assert part.share > 0.5


def split_by_part(frame: pd.DataFrame) -> Study:
    return Study(
        name="later",
        measurements=frame,
        robot={"name": "ur5", "tool_mm": list(TOOL)},
        model={"base": ["geometric"], "candidates": []},
        split={"column": "part"},
    )


@pytest.mark.integration
@seeds(1)
def test_a_column_may_hold_out_visits_of_the_same_postures(rng: np.random.Generator) -> None:
    """As a check some weeks later at the postures of the calibration does; it is said what that is worth."""
    frame = measure(rng, 0.0).iloc[:100]
    frame["part"] = np.where(np.arange(100) < 60, "estimation", "held-out")
    record = run_study(split_by_part(frame), sampling=False).record
    (said,) = [one.sentence for one in record.warnings if one.code == "held-out-near"]
    assert "came back among the held-out ones" in said
    again = frame.copy()
    again.iloc[70, :6] = again.iloc[10, :6]
    with pytest.raises(StudyError, match="equal joint readings are on both sides"):
        run_study(split_by_part(again), sampling=False)
