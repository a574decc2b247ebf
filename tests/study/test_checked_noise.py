"""The noise floor that `check` tells: from repeats where there are any, else as the data state it."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from modelsel.measurements.reader import read_measurements
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward
from modelsel.study.inspection.inspection import inspect_measurements
from modelsel.study.inspection.inspection_text import format_inspection

NOISE, STATED = 0.03, 0.1


@pytest.fixture
def table(rng) -> pd.DataFrame:
    """Thirty postures, every one measured twice."""
    robot = load_robot("ur5")
    angles = np.tile(robot.draw(rng, 30), (2, 1))
    position = forward(robot, angles, np.array([0.0, 0.0, 100.0]))
    position += rng.normal(0, NOISE, position.shape)
    columns = {f"q{j + 1}_rad": angles[:, j] for j in range(robot.n)}
    columns |= dict(zip(["x_mm", "y_mm", "z_mm"], position.T, strict=True))
    return pd.DataFrame(columns)


def line_of(table: pd.DataFrame) -> str:
    robot = load_robot("ur5")
    inspection = inspect_measurements(robot, read_measurements(table, robot))
    (line,) = (line for line in format_inspection(inspection) if line.startswith("Noise floor"))
    return line


def test_the_noise_floor_is_the_stated_one_where_nothing_was_measured_again(table) -> None:
    stated = table.assign(sx_mm=STATED, sy_mm=STATED, sz_mm=STATED)
    once, twice = line_of(stated.iloc[:30]), line_of(stated)
    assert once == "Noise floor: 0.100 mm per coordinate, as the data state it"
    assert twice.endswith("mm per coordinate, from repeats")
    assert line_of(table.iloc[:30]).startswith("Noise floor: cannot be told")
