"""Readings that may have been rounded are told where rounding is a good part of the noise, with what it
does to the target; where it is none, or would leave more than is left, nothing is said."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
import pytest
from builders import OFF_AXIS
from exact import flanges_of

from modelsel import Study, run_study
from modelsel.measurements.reader import read_measurements
from modelsel.robot.files import load_robot
from modelsel.study.inspection.inspection import inspect_measurements

ROBOT = load_robot("puma760")
NOISE = 0.05
CODE = "readings-rounded"
WITH_TOOL: dict[str, object] = {"name": "puma760", "tool_mm": OFF_AXIS}


def locate(q: np.ndarray, target: Sequence[float] = OFF_AXIS) -> np.ndarray:
    flange = flanges_of(ROBOT, q)
    return flange[:, :3, 3] + flange[:, :3, :3] @ np.array(target)


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


def told_by_study(frame: pd.DataFrame, robot: dict[str, object] = WITH_TOOL) -> list[str]:
    study = Study(
        name="rounded", robot=robot, measurements=frame, model={"candidates": ["encoder-scale"]}
    )
    record = run_study(study, sampling=False).record
    return [one.sentence for one in record.warnings if one.code == CODE]


def draw_rounded(
    frame: pd.DataFrame,
    step_deg: float,
    rng: np.random.Generator,
    targets: Sequence[Sequence[float]] = (OFF_AXIS,),
) -> float:
    """The rms [mm] by which targets are off when every reading is off by an error within the step."""
    degrees = frame.filter(like="_deg").to_numpy()
    off = rng.uniform(-step_deg / 2, step_deg / 2, degrees.shape)
    read, true = np.radians(degrees), np.radians(degrees + off)
    moved = np.array([locate(true, one) - locate(read, one) for one in targets])
    return float(np.sqrt(np.square(moved).sum(-1).mean()))


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


def read_numbers(sentence: str) -> tuple[float, float]:
    """How far rounding puts the target off [mm], and the noise in all."""
    _, _, rest = sentence.partition("puts the target ")
    moved, _, beside = rest.partition(" mm rms off, ")
    if beside.startswith("as much as the noise in all"):
        return float(moved), float(moved)
    beside = beside.removeprefix("where the noise in all is ")
    return float(moved), float(beside.partition(" mm")[0])


@pytest.mark.integration
@pytest.mark.parametrize("step", [0.01, 0.1])
def test_what_rounding_does_is_no_more_than_the_noise_in_all(
    rng: np.random.Generator, step: float
) -> None:
    """Two targets share the errors of the readings: the distances between them do not show these."""
    exact = campaign(rng, 0.0, 0.0)
    degrees = exact.filter(like="_deg").to_numpy()
    rows = []
    targets = {"A": OFF_AXIS, "B": [OFF_AXIS[0] + 80.0, *OFF_AXIS[1:]]}
    for name, target in targets.items():
        position = locate(np.radians(degrees), target)
        one = pd.DataFrame((degrees / step).round() * step, columns=exact.columns[: ROBOT.n])
        one[["x_mm", "y_mm", "z_mm"]] = position + rng.normal(0, NOISE, position.shape)
        rows.append(one.assign(target=name, configuration=range(len(one))))
    frame = pd.concat(rows, ignore_index=True)
    drawn = [draw_rounded(exact, step, rng, list(targets.values())) for _ in range(20)]
    noise = np.hypot(np.mean(drawn), np.sqrt(3) * NOISE)
    robot = {"name": "puma760", "tools_mm": targets}
    for sentences in (told_by_check(frame), told_by_study(frame, robot)):
        (sentence,) = sentences
        moved, in_all = read_numbers(sentence)
        assert moved == pytest.approx(np.mean(drawn), rel=0.1)
        assert in_all == pytest.approx(noise, rel=0.15)
        assert moved <= in_all


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
