"""Which of several columns `init` takes for the measured position."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from modelsel.cli.main import run_command_line
from modelsel.measurements.measurements import build_measurements
from modelsel.robot.files import load_robot
from modelsel.study.simulation import simulate_points

ROBOT = load_robot("ur10")
TOOL = np.array([[20.0, -10, 130]])
AXES = ["x_mm", "y_mm", "z_mm"]
SHIFT = np.array([900.0, 20.0, -40.0])


def simulate(rng: np.random.Generator, count: int = 40) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Readings with measured positions, off by 0.3 mm, and positions computed to 0.01 mm."""
    q = rng.uniform(-1.8, 1.8, (count, 6))
    at = build_measurements(q, np.zeros((count, 3)))
    noise = [simulate_points(ROBOT, TOOL, [], at=at, noise_mm=mm, rng=rng) for mm in (0.3, 0.0)]
    measured, computed = (points[AXES] for points in noise)
    table = pd.DataFrame(q, columns=[f"J{j}" for j in range(1, 7)])
    table[["X", "Y", "Z"]] = measured.to_numpy() + SHIFT
    return table, computed.round(2)


def init(folder: Path, table: pd.DataFrame) -> tuple[str, dict[str, str]]:
    """What `init` says, and the columns that its study has."""
    table.to_csv(folder / "m.csv", index=False)
    words = ["init", folder / "m.csv", "--robot", "ur10", "--yes", "--out", folder / "s"]
    ran = CliRunner().invoke(run_command_line, list(map(str, words)))
    assert ran.exit_code == 0, ran.output
    study = tomllib.loads((folder / "s" / "study.toml").read_text())
    return " ".join(ran.stdout.split()), study["measurements"]["columns"]


@pytest.mark.parametrize("place", [6, 9])
@pytest.mark.parametrize("names", [["TCP_X", "TCP_Y", "TCP_Z"], ["B_X", "B_Y", "B_Z"]])
def test_a_position_that_the_controller_computed_is_not_the_measured_one(
    names, place, rng, tmp_path
) -> None:
    """The nominal arm fits it best: it was taken for that."""
    table, computed = simulate(rng)
    for k, name in enumerate(names):
        table.insert(place + k, name, computed.iloc[:, k])
    said, columns = init(tmp_path, table)
    assert columns["x_mm"] == "X"
    assert f'Not the position: "{names[0]}"' in said
    assert "they were computed from the joint readings, not measured" in said
    assert "Not sure" not in said


def test_of_two_good_positions_the_better_one_is_not_sure(rng, tmp_path) -> None:
    """A controller with a calibrated arm computes what the nominal arm fits neither."""
    table, computed = simulate(rng)
    table[["TCP_X", "TCP_Y", "TCP_Z"]] = computed + rng.normal(0, 0.05, computed.shape)
    said, columns = init(tmp_path, table)
    assert columns["x_mm"] == "X"
    options = "--column x_mm=TCP_X --column y_mm=TCP_Y --column z_mm=TCP_Z"
    assert f'may also be "TCP_X", "TCP_Y" and "TCP_Z" in mm. To take these: {options}.' in said


@pytest.mark.parametrize("count", [6, 40])
def test_a_rotation_vector_is_no_position(count, rng, tmp_path) -> None:
    """No arm of this size reaches six metres, if it is in metres; with few rows, too."""
    table, _ = simulate(rng, count)
    table = table.rename(columns={"X": "B_X", "Y": "B_Y", "Z": "B_Z"})
    for axis in "xyz":
        turn = rng.uniform(-3, 3, count)
        turn[:2] = -3.1, 3.1
        table[f"r_{axis}"] = turn
    said, columns = init(tmp_path, table)
    assert columns["x_mm"] == "B_X"
    assert "Not sure" not in said


@pytest.mark.slow
def test_readings_that_a_study_would_refuse_are_no_alternative(rng, tmp_path) -> None:
    """A joint that turns the other way leaves the arm far off, but not as far as other columns."""
    table, _ = simulate(rng)
    table["J5"] *= -1
    table[["R_X", "R_Y", "R_Z"]] = rng.uniform(-700, 700, (len(table), 3))
    said, columns = init(tmp_path, table)
    assert columns["x_mm"] == "X"
    assert "if joint 5 turns the other way" in said
    assert "Not sure" not in said
