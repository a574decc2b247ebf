"""Readings that are rounded: the joints are told not to repeat, and that rounding is why."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from error_parts import INSTRUMENT, part

from modelsel import Study, run_study
from modelsel.fitting.error_structure import ErrorStructure
from modelsel.measurements.measurements import Measurements
from modelsel.measurements.reader import read_measurements
from modelsel.results.repeatability.repeatability import describe_errors
from modelsel.results.repeatability.rounded_readings import find_rounding
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward

TENTH = np.radians(0.1) / np.sqrt(12)


def campaign(
    rng: np.random.Generator, step: float, m: int = 120, unit: str = "deg"
) -> pd.DataFrame:
    """A UR5 whose joints 1 to 3 [deg, or another unit] are read to a step; the arm is not rounded."""
    robot = load_robot("ur5")
    angles = robot.draw(rng, m)
    position = forward(robot, angles, np.array([30.0, 0.0, 100.0]))
    position += rng.normal(0, 0.02, position.shape)
    values = np.degrees(angles) if unit == "deg" else angles
    if step:
        values[:, :3] = np.round(values[:, :3] / step) * step
    columns = {f"q{j + 1}_{unit}": values[:, j] for j in range(robot.n)}
    columns |= dict(zip(["x_mm", "y_mm", "z_mm"], position.T, strict=True))
    return pd.DataFrame(columns)


def read(frame: pd.DataFrame) -> Measurements:
    return read_measurements(frame, load_robot("ur5"))


@pytest.mark.parametrize(
    ("step", "unit", "words"),
    [
        (0.1, "deg", "0.1°"),
        (0.5, "deg", "0.5°"),
        (0.25, "deg", "0.25°"),
        (0.2, "deg", "0.2°"),
        (0.02, "deg", "0.02°"),
        (0.001, "rad", "0.001 rad"),
        (0.002, "rad", "0.002 rad"),
    ],
)
def test_the_step_of_readings_is_found(rng: np.random.Generator, step, unit, words) -> None:
    found = find_rounding(read(campaign(rng, step, unit=unit)))
    assert list(found) == ["joint 1", "joint 2", "joint 3"]
    in_radians = np.radians(step) if unit == "deg" else step
    for one in found.values():
        assert one.step == words
        assert one.scale == pytest.approx(in_radians / np.sqrt(12))


def test_readings_with_their_digits_and_few_commanded_ones_are_not_rounded(
    rng: np.random.Generator,
) -> None:
    assert find_rounding(read(campaign(rng, 0.0))) == {}
    few = campaign(rng, 0.0)
    few["q1_deg"] = np.arange(len(few)) % 10 * 10.0
    assert find_rounding(read(few)) == {}


@pytest.mark.parametrize(("digits", "found"), [(12, 0.1), (9, 0.1), (6, 0.1), (3, 0.001)])
def test_degrees_are_found_in_a_column_of_radians(rng: np.random.Generator, digits, found) -> None:
    """As long as its own digits tell: of three those are found alone."""
    frame = campaign(rng, 0.1)
    radians = campaign(rng, 0.0, unit="rad")
    for j in range(1, 7):
        radians[f"q{j}_rad"] = np.radians(frame[f"q{j}_deg"]).round(digits)
    first = find_rounding(read(radians))["joint 1"]
    step = np.radians(found) if found == 0.1 else found
    assert first.scale == pytest.approx(step / np.sqrt(12))
    assert first.step == ("0.1°" if found == 0.1 else "0.001 rad")


def test_readings_near_whole_degrees_are_not_rounded(rng: np.random.Generator) -> None:
    """A controller that stands up to a hundredth of a degree off what was commanded."""
    frame = campaign(rng, 1.0)
    radians = campaign(rng, 0.0, unit="rad")
    for j in range(1, 7):
        off = rng.uniform(-0.01, 0.01, len(frame))
        frame[f"q{j}_deg"] += off
        radians[f"q{j}_rad"] = np.radians(frame[f"q{j}_deg"]).round(6)
    assert find_rounding(read(frame)) == {}
    assert find_rounding(read(radians)) == {}


@pytest.mark.parametrize(
    ("scale", "told"), [(TENTH, True), (2 * TENTH, True), (5 * TENTH, False), (0.5 * TENTH, False)]
)
def test_rounding_is_told_where_it_is_a_good_part_and_not_more_than_all(rng, scale, told) -> None:
    own = part("joint 2", scale, 0.9 * scale, 1.1 * scale)
    rounding = find_rounding(read(campaign(rng, 0.1)))
    described = describe_errors(ErrorStructure((INSTRUMENT, own)), rounding)
    said = next(one["sentence"] for one in described if one["part"] == "joint 2")
    reason = (
        "Its readings are multiples of 0.1°; if they were rounded to that, this alone leaves 0.50 mrad: "
        "record them with more digits."
    )
    assert (reason in said) is told


@pytest.mark.slow
def test_a_study_of_rounded_readings_says_why_its_joints_do_not_repeat(rng) -> None:
    study = Study(
        name="rounded", measurements=campaign(rng, 0.1), robot={"name": "ur5", "register": True}
    )
    said = {one.part: one.sentence for one in run_study(study, sampling=False).record.repeatability}
    for joint in ("joint 1", "joint 2"):
        assert (
            "multiples of 0.1°; if they were rounded to that, this alone leaves 0.50 mrad"
            in said[joint]
        )
