"""Readings that may have been rounded are told where rounding is a good part of the noise, with what it
does to the target; where it is none, or would leave more than is left, nothing is said."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from builders import OFF_AXIS
from exact import flanges_of

from modelsel import Study, run_study
from modelsel.measurements.reader import read_measurements
from modelsel.robot.files import load_robot
from modelsel.study.inspection import inspect_measurements

ROBOT = load_robot("puma760")
NOISE = 0.05
CODE = "readings-rounded"


def locate(q: np.ndarray) -> np.ndarray:
    flange = flanges_of(ROBOT, q)
    return flange[:, :3, 3] + flange[:, :3, :3] @ np.array(OFF_AXIS)


def campaign(rng: np.random.Generator, recorded_deg: float, commanded_deg: float) -> pd.DataFrame:
    """Eighty postures, commanded at multiples of a step and recorded at those of another; 0: at any."""
    degrees = np.degrees(ROBOT.draw(rng, 80))
    if commanded_deg:
        degrees = (degrees / commanded_deg).round() * commanded_deg
    position = locate(np.radians(degrees)) + rng.normal(0, NOISE, (80, 3))
    if recorded_deg:
        degrees = (degrees / recorded_deg).round() * recorded_deg
    frame = pd.DataFrame({f"q{k + 1}_deg": degrees[:, k] for k in range(ROBOT.n)})
    frame[["x_mm", "y_mm", "z_mm"]] = position
    return frame


def told_by_check(frame: pd.DataFrame) -> list[str]:
    found = inspect_measurements(ROBOT, read_measurements(frame, ROBOT))
    return [one["sentence"] for one in found["warnings"] if one["code"] == CODE]


def told_by_study(frame: pd.DataFrame) -> list[str]:
    study = Study(
        name="rounded",
        robot={"name": "puma760", "tool_mm": OFF_AXIS},
        measurements=frame,
        model={"candidates": ["encoder-scale"]},
    )
    record = run_study(study, sampling=False).record
    return [one.sentence for one in record.warnings if one.code == CODE]


def draw_rounded(frame: pd.DataFrame, step_deg: float, rng: np.random.Generator) -> float:
    """The rms [mm] by which the target is off when every reading is off by an error within the step."""
    degrees = frame.filter(like="_deg").to_numpy()
    off = rng.uniform(-step_deg / 2, step_deg / 2, degrees.shape)
    moved = locate(np.radians(degrees + off)) - locate(np.radians(degrees))
    return float(np.sqrt(np.square(moved).sum(1).mean()))


@pytest.mark.integration
@pytest.mark.parametrize("step", [0.1, 0.01])
def test_rounded_readings_are_told_with_what_they_do(rng: np.random.Generator, step: float) -> None:
    frame = campaign(rng, step, 0.0)
    drawn = [draw_rounded(frame, step, rng) for _ in range(20)]
    for sentences in (told_by_check(frame), told_by_study(frame)):
        (sentence,) = sentences
        start = f"The readings of joints 1, 2, 3, 4, 5 and 6 are multiples of {step:g}°. If they were rounded"
        assert sentence.startswith(start)
        said = float(sentence.partition("puts the target ")[2].partition(" mm")[0])
        assert said == pytest.approx(np.mean(drawn), rel=0.1)


@pytest.mark.unit
@pytest.mark.parametrize(
    ("recorded", "commanded"), [(0.0, 0.0), (0.001, 0.0), (0.0, 0.1), (0.0, 0.5)]
)
def test_nothing_is_told_of_fine_readings_and_of_commanded_ones(
    rng: np.random.Generator, recorded: float, commanded: float
) -> None:
    """Postures at whole tenths of a degree leave far less than rounding to them would."""
    assert told_by_check(campaign(rng, recorded, commanded)) == []


@pytest.mark.integration
def test_a_study_says_nothing_of_commanded_readings(rng: np.random.Generator) -> None:
    assert told_by_study(campaign(rng, 0.0, 0.1)) == []


@pytest.mark.unit
def test_the_joints_of_every_step_are_named(rng: np.random.Generator) -> None:
    fine, coarse = campaign(rng, 0.0, 0.0), campaign(rng, 0.0, 0.0)
    for j in (1, 2, 4):
        step = 0.05 if j == 4 else 0.1
        coarse[f"q{j}_deg"] = (fine[f"q{j}_deg"] / step).round() * step
    for name in ("x_mm", "y_mm", "z_mm", "q3_deg", "q5_deg", "q6_deg"):
        coarse[name] = fine[name]
    (sentence,) = told_by_check(coarse)
    assert sentence.startswith(
        "The readings of joints 1 and 2 are multiples of 0.1°, those of joint 4 are multiples of 0.05°."
    )
