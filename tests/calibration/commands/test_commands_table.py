"""A table of corrected commands has the form of its targets, so that it can be read back; programs
name their points as the targets do."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from wide_calibration import wide

from modelsel.calibration.arm_alone import leave_out_instrument
from modelsel.calibration.calibration_file import calibration_text
from modelsel.calibration.commands.commands_table import FIGURE_COLUMNS
from modelsel.calibration.commands.compensation import compensate_commands, predict_nominal
from modelsel.calibration.export.robot_programs import write_program
from modelsel.calibration.prediction import predict_poses
from modelsel.cli.main import run_command_line
from modelsel.measurements.formats.table import hash_source
from modelsel.measurements.quantities.orientation_columns import (
    CONVENTIONS,
    choose_orientation_names,
    write_orientations,
)
from modelsel.robot.rigid import from_rotation_vector

ROWS = np.r_[70:80, 81:96]  # at 80 the model jumps
KUKA = ["kuka_a_deg", "kuka_b_deg", "kuka_c_deg"]


@pytest.fixture(scope="module")
def made():
    return wide(np.random.default_rng(3))


@pytest.fixture(scope="module")
def cell(made, tmp_path_factory) -> Path:
    """A folder with a calibration of two groups, and targets in both, with names and orientations
    as a KUKA says them."""
    c, at = made
    folder = tmp_path_factory.mktemp("cell")
    (folder / "calibration.json").write_text(calibration_text(c))
    data = at.data.take(ROWS)
    data = replace(data, position=predict_nominal(c.problem(data)))
    posed = replace(data, rotation=np.tile(np.eye(3), (len(data), 1, 1)))
    rotation = c.problem(posed).pose(slice(0, len(data))).rotation.transpose(2, 0, 1)
    frame = data.to_frame().drop(columns=["configuration"])
    frame = frame.assign(**write_orientations(rotation, KUKA))
    frame.insert(0, "point", [f"P {k}" for k in range(len(frame))])
    frame["remark"] = "Ä slow"
    frame.to_csv(folder / "plan.csv", index=False)
    return folder


def compensate(cell: Path, plan: Path, out: Path, *words: str) -> pd.DataFrame | str:
    command = ["compensate", cell, plan, "--out", out, "--bound", 1e3, 1e3, *words]
    ran = CliRunner().invoke(run_command_line, [str(word) for word in command])
    assert ran.exit_code == 0, ran.output
    return pd.read_csv(out) if out.suffix == ".csv" else out.read_text()


def test_commands_are_read_back_with_their_groups_points_and_orientations(cell, tmp_path) -> None:
    plan = pd.read_csv(cell / "plan.csv")
    wrote = compensate(cell, cell / "plan.csv", tmp_path / "out.csv")
    for name in ("point", "remark", "group", "target", "order"):
        assert wrote[name].tolist() == plan[name].tolist()
    assert set(wrote["group"]) == {"mon", "tue"}
    np.testing.assert_allclose(wrote[KUKA], plan[KUKA], rtol=0, atol=1e-7)
    assert set(FIGURE_COLUMNS) - set(wrote) == {"orientation_uncertainty_mrad"}
    landed = compensate(cell, tmp_path / "out.csv", tmp_path / "back.csv", "--forward")
    assert landed["point"].tolist() == plan["point"].tolist()
    assert not FIGURE_COLUMNS & set(landed)
    place = ["x_mm", "y_mm", "z_mm"]
    np.testing.assert_allclose(landed[place], plan[place], rtol=0, atol=1e-3)
    np.testing.assert_allclose(landed[KUKA], plan[KUKA], rtol=0, atol=1e-3)


def test_what_is_left_of_orientations_is_no_rounding(cell, tmp_path) -> None:
    """Digits of a millionth of a milliradian say nothing of an arm."""
    words = ["compensate", cell, cell / "plan.csv", "--out", tmp_path / "out.csv", "--bound"]
    ran = CliRunner().invoke(run_command_line, [*map(str, words), "1000", "1000"])
    left = pd.read_csv(tmp_path / "out.csv")["orientation_left_mrad"]
    assert left.mean() < 1e-6
    assert "with it, less than 0.000001 mrad on average" in " ".join(ran.output.split())


def test_forward_wants_nothing_of_the_measurements_that_made_the_calibration(
    made, cell, tmp_path
) -> None:
    plan = cell / "plan.csv"
    own = replace(made[0], provenance={"data_sha256": hash_source(plan)})
    (tmp_path / "calibration.json").write_text(calibration_text(own))
    words = ["compensate", tmp_path, plan, "--out", tmp_path / "out.csv", "--bound", "1000", "1000"]
    for more, is_said in (([], True), (["--forward"], False)):
        ran = CliRunner().invoke(run_command_line, [*map(str, words), *more])
        assert ("these are the measurements that made the calibration" in ran.output) == is_said


def test_forward_says_where_the_target_points(made) -> None:
    """As the residual of a measured orientation has it: none is left of the predicted one."""
    c, at = made
    data = at.data.take(ROWS)
    assert predict_poses(c, data).rotation is None
    known = replace(c, tool_rotations=from_rotation_vector(np.array([[0.1, 0, 0], [0, 0.2, 0]])))
    real = predict_poses(known, data)
    np.testing.assert_allclose(real.position, leave_out_instrument(c).predict(data), atol=1e-9)
    found = compensate_commands(known, real)
    assert found.before_mm.max() < 1e-6
    assert found.before_rad.max() < 1e-9


@pytest.mark.parametrize("convention", CONVENTIONS, ids=lambda each: each.name)
def test_angles_are_read_off_what_they_make(convention, rng) -> None:
    angles = rng.uniform(-1.5, 1.5, (20, 3))
    angles[:, 1] += 1.5 * (convention.name == "kawasaki")  # O A T: A from 0 to 180 degrees
    R = convention.rotate(angles)
    np.testing.assert_allclose(convention.read_angles(R), angles, atol=1e-12)
    upright = convention.rotate(np.array([[0.3, np.pi / 2, 0.2]]))
    again = convention.rotate(convention.read_angles(upright))
    np.testing.assert_allclose(again, upright, atol=1e-7)
    names = tuple(f"{name}_rad" for name in convention.columns)
    assert choose_orientation_names(["x_mm", *names]) == names
    columns = write_orientations(R, names)
    np.testing.assert_allclose(np.stack(list(columns.values()), 1), angles, atol=1e-12)


POINTS = ["Griff 1", "griff_1", "", "Ecke°ü", "move", "while", "pick", "3a", "x" * 40, "x" * 40]
SHAPES = {
    "robodk": r'\("([^"]*)", \[',
    "urscript": r"v=0\.25\)(?:  # (.*))?",
    "krl": r"PTP \{.*\}(?: ; (.*))?",
    "rapid": r"CONST jointtarget (\w+):=",
    "ls": r'P\[\d+(?::"([^"]*)")?\]\{',
}
TEXTS = ["Griff 1", "griff_1", "", "Ecke u", "move", "while", "pick", "3a", "x" * 32, "x" * 32]


@pytest.mark.parametrize("form", SHAPES)
def test_programs_name_points_as_the_targets_do(form) -> None:
    q = np.zeros((len(POINTS), 6))
    text = write_program(form, Path("pick.x"), q, (False,) * 6, [], POINTS).replace("\r\n", "\n")
    found = re.findall(SHAPES[form], text)
    if form == "rapid":
        expected = ["Griff_1", "griff_1_2", "p3", "Ecke_u", "move", "pt_while", "pt_pick", "pt_3a"]
        assert found == [*expected, "x" * 32, "x" * 30 + "_2"]
        assert re.findall(r"MoveAbsJ (\w+)\\", text) == found
    elif form == "robodk":
        assert found == [*TEXTS[:2], "pick_3", *TEXTS[3:9], "x" * 30 + "_2"]
    elif form == "ls":
        assert found == [name[:16] for name in TEXTS]
        assert "J P[1:Griff 1] 10% FINE" in text
    else:
        assert found == TEXTS


@pytest.mark.parametrize("form", SHAPES)
def test_no_name_of_a_point_breaks_a_program(form) -> None:
    """A hostile name leaves no character that a language gives a meaning to."""
    names = ['"]); import os #', "a\r\nHALT", "{0}]:\\", ";ENDFOLD ! */", "p2"]
    text = write_program(form, Path("pick.x"), np.zeros((5, 6)), (False,) * 6, [], names)
    found = re.findall(SHAPES[form], text.replace("\r\n", "\n"))
    assert len(set(found)) == 5
    assert all(re.fullmatch(r"[A-Za-z0-9 ._-]+", name) for name in found)
    assert "HALT" not in [line.strip() for line in text.splitlines()]


def test_a_program_of_named_targets_has_their_names(cell, tmp_path) -> None:
    text = compensate(cell, cell / "plan.csv", tmp_path / "pick.mod", "--format", "rapid")
    named = re.findall(SHAPES["rapid"], text)
    assert named == [f"P_{k}" for k in range(25)]
