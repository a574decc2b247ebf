"""The correction table: read as another program reads it, it has the model's errors within the
bound that it states."""

from __future__ import annotations

import io
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from builders import small_arm
from click.testing import CliRunner
from own_urdf import calibrated
from wide_calibration import wide

from modelsel.calibration.calibration_file import calibration_text
from modelsel.calibration.export import GridOptions, export, export_grid
from modelsel.calibration.export.grid import MIN_USE
from modelsel.calibration.prediction import predict
from modelsel.cli.main import run_command_line
from modelsel.exceptions import StudyError, sentence_list
from modelsel.measurements.measurements import build_measurements
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward


@pytest.fixture(scope="module")
def made():
    return calibrated(load_robot("irb120"), np.random.default_rng(7))


@pytest.fixture(scope="module")
def small():
    return calibrated(replace(small_arm(), gravity=(0.0, 0.0, -1.0)), np.random.default_rng(2))


def read(text: str):
    """(joints, interpolated error (m, 3) at their readings), by scipy."""
    from scipy.interpolate import RegularGridInterpolator

    frame = pd.read_csv(io.StringIO(text), comment="#")
    *joints, dx, dy, dz = frame.columns
    assert (dx, dy, dz) == ("dx_mm", "dy_mm", "dz_mm")
    axes = [np.unique(frame[name]) for name in joints]
    values = frame[["dx_mm", "dy_mm", "dz_mm"]].to_numpy()
    return joints, RegularGridInterpolator(axes, values.reshape(*map(len, axes), 3))


def errors(c, q: np.ndarray, **covariates: np.ndarray) -> np.ndarray:
    """Real minus nominal position of the first target, in frame 0; play in its middle."""
    m = len(q)
    data = build_measurements(
        q,
        np.zeros((m, 3)),
        target=[c.targets[0]] * m,
        group=[c.groups[0]] * m,
        approach=np.zeros_like(q),
        covariates=covariates,
    )
    unplaced = replace(
        c, placement=(np.eye(3)[None].repeat(len(c.groups), 0), np.zeros((len(c.groups), 3)))
    )
    return predict(unplaced, unplaced.problem(data)) - forward(c.robot, q, c.tools[0])


def test_table_is_within_its_bound(made, rng) -> None:
    options = GridOptions((1, 2, 3), 0.2, {"q4_deg": 30, "q5_rad": 0.5, "q6_deg": -10})
    found = export_grid(made, options)
    joints, table = read(found.text)
    assert joints == ["q1_rad", "q2_rad", "q3_rad"]
    q = np.empty((3000, 6))
    for k in range(3):
        q[:, k] = rng.uniform(*made.ranges[f"q{k + 1}"], len(q))
    q[:, 3:] = np.radians(30), 0.5, np.radians(-10)
    missed = np.linalg.norm(table(q[:, :3]) - errors(made, q), axis=1)
    assert np.linalg.norm(errors(made, q), axis=1).mean() > 1  # there is something to correct
    assert missed.max() <= found.error_mm <= 0.2
    assert missed.max() > found.error_mm / 4  # no empty promise
    assert f"off by at most {found.error_mm:.2g} mm" in found.notes[0]
    assert found.text.startswith(f"# {found.notes[0]}\n")


def test_what_it_does_not_look_at_is_said(made) -> None:
    found = export_grid(made, GridOptions((2, 3), 0.2, {"q5_deg": 60}))
    assert [text.partition(" away")[0] for text in found.left_out] == [
        f"joint {k}" for k in (1, 4, 5, 6)
    ]
    assert "joint 5 away from 60 deg" in found.left_out
    rms, largest = found.left_out_mm
    assert largest > rms > 10 * found.error_mm
    values = [text.replace(" away from", " =") for text in found.left_out]
    assert f"# it is valid only at {sentence_list(values)}\n" in found.text
    _, bare, left, _ = found.errors
    assert left == rms
    assert (
        f"leaves {rms:.3g} mm rms ({largest:.3g} mm at most); without it the arm is off by"
        in (found.notes[1])
    )
    assert (found.worse is not None) == (left > MIN_USE * bare)
    useless = replace(found, errors=("over all", 1.54, 1.55, 0.0))
    assert useless.worse.startswith("this file is worse than the nominal arm: 1.55 mm rms against")
    assert "hardly better" in replace(found, errors=("over all", 1.57, 1.55, 0.0)).worse
    assert replace(found, errors=("over all", 1.57, 0.5, 0.0)).worse is None


@pytest.mark.integration
def test_a_grid_over_every_joint_leaves_nothing_out(small) -> None:
    found = export_grid(small, GridOptions((1, 2, 3), 0.1))
    assert found.left_out == ()
    assert found.left_out_mm[1] <= found.error_mm <= 0.1


def test_covariates_are_held(rng) -> None:
    c = wide(np.random.default_rng(3))[0]
    found = export_grid(c, GridOptions((2, 3), 0.1, {"temperature_C": 30.0}))
    _, table = read(found.text)
    assert "temperature_C away from 30" in found.left_out
    assert any("direction of approach" in text for text in found.left_out)
    held = np.radians([0, 0, 0, 1, 0, -1])
    q = np.tile(held, (200, 1))
    for k in (1, 2):
        q[:, k] = rng.uniform(*c.ranges[f"q{k + 1}"], len(q))
    wanted = errors(
        c, q, **{name: np.full(200, 30.0) for name in c.needs() if name == "temperature_C"}
    )
    assert np.linalg.norm(table(q[:, 1:3]) - wanted, axis=1).max() <= found.error_mm


@pytest.mark.integration
def test_nearer_takes_more_points(made) -> None:
    sizes = [
        len(export_grid(made, GridOptions((2, 3), within)).text.splitlines())
        for within in (0.5, 0.05, 0.005)
    ]
    assert sizes[0] < sizes[1] < sizes[2]


def test_too_near_is_said(monkeypatch, made) -> None:
    from modelsel.calibration.export import grid

    monkeypatch.setattr(grid, "MAX_POINTS", 200)
    found = export(made, "grid")
    assert "off by more than 0.01 mm: up to" in found.notes[0]
    assert found.error_mm > 0.01
    assert len(read(found.text)[1].values.reshape(-1, 3)) <= 200


def test_the_range_that_is_said_is_taken(made) -> None:
    """Rounded outwards by what a message shows."""
    low, high = (float(f"{v:.3g}") for v in made.ranges["q2"])
    found = export_grid(made, GridOptions((2,), 0.5, {}, {2: (low, high)}))
    axis = read(found.text)[1].grid[0]
    np.testing.assert_allclose(axis[[0, -1]], [low, high], atol=1e-9)


@pytest.mark.slow
def test_joints_that_never_moved_are_none_of_its_own(made) -> None:
    still = dict(made.ranges) | {"q2": (-1.0, -1.0)}
    found = export(replace(made, ranges=still), "grid")
    assert read(found.text)[0] == ["q1_rad", "q3_rad", "q4_rad"]
    assert any(words.startswith("joint 2 away from") for words in found.left_out)
    held = {name: (low, low) for name, (low, _) in made.ranges.items()}
    with pytest.raises(StudyError, match="the calibration has seen no joint move"):
        export(replace(made, ranges=held), "grid")


def test_slides_are_in_mm(rng) -> None:
    c = calibrated(replace(small_arm(prismatic=True), gravity=(0.0, 0.0, -1.0)), rng)
    found = export_grid(c, GridOptions((3,), 0.01, {}, {3: (50.0, 200.0)}))
    joints, table = read(found.text)
    assert joints == ["q3_mm"]
    assert (table.grid[0][0], table.grid[0][-1]) == (50, 200)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (GridOptions((1, 1)), "each once"),
        (GridOptions((1, 2, 3, 4)), "one to 3 of the joints 1 to 6"),
        (GridOptions((7,)), "joints 1 to 6"),
        (GridOptions(()), "one to 3"),
        (GridOptions((1,), at={"q5_dg": 1.0}), 'Did you mean "q5_deg"'),
        (GridOptions((1,), at={"q1_deg": 1.0}), "no such value beside those of the grid"),
        (GridOptions((1,), at={"q2_deg": 700.0}), "q2_deg=700: the calibration has seen"),
        (GridOptions((1,), ranges={1: (1.0, 0.5)}), "start below its end"),
        (GridOptions((1,), ranges={1: (-9.0, 0.5)}), "that the calibration has seen"),
    ],
)
def test_refused(options, says, made) -> None:
    with pytest.raises(StudyError, match=says):
        export_grid(made, options)


def run(folder, *words: str):
    return CliRunner().invoke(
        run_command_line, ["export", str(folder), "--out", str(folder / "grid.csv"), *words]
    )


def test_command(made, tmp_path) -> None:
    """A target's name stays in its comment."""
    named = replace(made, targets=("=1+1, # x",))
    (tmp_path / "calibration.json").write_text(calibration_text(named))
    words = ["--format", "grid", "--joints", "2=-30:30,3", "--at", "q5_deg=40", "--within", "0.1"]
    ran = run(tmp_path, *words, "--json")
    assert ran.exit_code == 0, ran.output
    told = json.loads(ran.output)
    assert told["round_trip_mm"] <= 0.1
    assert "joint 5 away from 40 deg" in told["left_out"]
    text = (tmp_path / "grid.csv").read_text()
    joints, table = read(text)
    assert joints == ["q2_rad", "q3_rad"]
    np.testing.assert_allclose(np.degrees(table.grid[0][[0, -1]]), [-30, 30])
    assert [line for line in text.splitlines() if "1+1" in line and line[0] != "#"] == []


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--format", "grid", "--joints", "x"], "expected joints such as 1,2,3"),
        (["--format", "grid", "--joints", "1=2"], "expected joints such as 1,2,3"),
        (["--format", "grid", "--at", "q5_deg"], "expected NAME=NUMBER"),
        (["--format", "grid", "--at", "q5_deg=nan"], "expected NAME=NUMBER"),
        (["--format", "grid", "--within", "nan"], "expected a length"),
        (["--format", "dh", "--within", "1"], "go with --format grid"),
    ],
)
def test_refused_on_the_command_line(words, says, made, tmp_path) -> None:
    (tmp_path / "calibration.json").write_text(calibration_text(made))
    ran = run(tmp_path, *words)
    assert ran.exit_code == 2
    assert says in ran.output
    assert not (tmp_path / "grid.csv").exists()
