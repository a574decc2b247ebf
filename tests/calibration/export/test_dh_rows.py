"""DH rows for people: as a drawing has them, rounded, beside the nominal ones."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from builders import drawn, planted

from modelsel.calibration.calibration import calibrate
from modelsel.calibration.export import export
from modelsel.calibration.export.dh_rows import (
    DECIMALS_DEG,
    compare_rows,
    fold_last,
    round_rows,
    wrap_degrees,
)
from modelsel.calibration.export.dh_signs import turn_frames
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.noise import Floor
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.dh import dh_table
from modelsel.robot.files import load_robot, robot_from_table
from modelsel.robot.gravity import compute_joint_torques
from modelsel.robot.kinematics import Robot, forward, pose
from modelsel.robot.rigid import rotation_matrix, transform
from modelsel.selection.evaluation import Split

ROWS = (
    (0.0, -400.0, 25.0, 90.0),
    (0.0, 0.0, 455.0, 0.0),
    (-90.0, 0.0, 35.0, 90.0),
    (0.0, -420.0, 0.0, -90.0),
    (0.0, 0.0, 0.0, 90.0),
    (180.0, -80.0, 0.0, 180.0),
)
KEYS = ("theta_deg", "d_mm", "a_mm", "alpha_deg")
TABLE = {
    "name": "kr6",
    "source": "drawing",
    "convention": "standard",
    "joint": [{"dh": dict(zip(KEYS, row, strict=True))} for row in ROWS],
}
ROBOT = robot_from_table(TABLE, "drawing")


def torques(robot: Robot, q: np.ndarray) -> np.ndarray:
    return compute_joint_torques(robot, pose(robot, q, np.zeros(3)), q)


def test_rows_of_a_drawing_come_back_as_they_were() -> None:
    """The last one with what stands behind its joint."""
    table = fold_last(dh_table(ROBOT, "standard"))
    assert "last" not in table
    for joint, row in zip(table["joint"], ROWS, strict=True):
        assert [joint["dh"][key] for key in KEYS] == pytest.approx(row, abs=1e-9)
    q = ROBOT.draw(np.random.default_rng(0), 20)
    tool = np.array([10.0, 20.0, 30.0])
    back = robot_from_table(table, "file")
    np.testing.assert_allclose(forward(back, q, tool), forward(ROBOT, q, tool), atol=1e-9)


def test_what_stands_behind_the_last_joint_is_turned_into_its_row() -> None:
    turned = transform(rotation_matrix(2, 0.4), (0.0, 0.0, -80.0))
    along = transform(rotation_matrix(0, -0.7), (12.0, 0.0, 0.0))
    robot = replace(ROBOT, last=turned @ along)
    table = fold_last(dh_table(robot, "standard"))
    own = table["joint"][5]["dh"]
    assert own["theta_deg"] == pytest.approx(180 + np.degrees(0.4) - 360)
    assert [own["a_mm"], own["alpha_deg"]] == pytest.approx([12.0, -np.degrees(0.7)])
    q = robot.draw(np.random.default_rng(1), 20)
    tool = np.array([10.0, 20.0, 30.0])
    back = robot_from_table(table, "file")
    np.testing.assert_allclose(forward(back, q, tool), forward(robot, q, tool), atol=1e-9)


@pytest.mark.parametrize("form", ["standard", "modified"])
def test_an_x_axis_points_as_in_the_nominal_table(form) -> None:
    """One arm in two tables: with frames turned by 180° about their own z axis, and as drawn."""
    arm = load_robot("irb120")
    nominal = dh_table(arm, form)
    behind = 1 if form == "modified" else 0
    joints = [{**joint, "dh": dict(joint["dh"])} for joint in nominal["joint"]]
    for frame in (1, 2, 4):
        for row in (frame, frame + 1):
            joints[row]["dh"]["theta_deg"] += 180.0
        for key in ("a_mm", "alpha_deg"):
            joints[frame + behind]["dh"][key] *= -1
        x, y, z = joints[frame]["com_mm"]
        joints[frame]["com_mm"] = [-x, -y, z]
    turned = {**nominal, "joint": joints}
    q = arm.draw(np.random.default_rng(3), 20)
    tool = np.array([10.0, 20.0, 30.0])
    back = turn_frames(nominal, turned)
    for table in (turned, back):
        read = robot_from_table(table, "file")
        np.testing.assert_allclose(forward(read, q, tool), forward(arm, q, tool), atol=1e-9)
        np.testing.assert_allclose(torques(read, q), torques(arm, q), atol=1e-9)
    for own, drawn_row in zip(back["joint"], nominal["joint"], strict=True):
        for key in ("d_mm", "a_mm"):
            assert own["dh"][key] == pytest.approx(drawn_row["dh"][key], abs=1e-9)
        for key in ("theta_deg", "alpha_deg"):
            assert wrap_degrees(own["dh"][key] - drawn_row["dh"][key]) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("form", ["dh", "mdh"])
@pytest.mark.parametrize("side", [1, -1])
def test_an_exported_table_has_the_signs_of_the_drawing(form, side, rng) -> None:
    """Joints 2 and 3 are almost parallel, to either side: the common normal may point either way."""
    arm = load_robot("irb120")
    at = drawn(arm, rng, 60, (60.0, 0.0, 118.0), covariates={})
    model = Model((mechanism("geometric", arm),))
    symbols = [term.symbol for term in model.terms]
    theta = np.zeros(len(symbols))
    theta[symbols.index("α3")] = side * 7e-5
    theta[symbols.index("β3")] = 7e-4
    at = planted(at, model.terms, theta, rng, 0.001)
    rows = np.ones(60, bool)
    split = Split(at, rows, ~rows, np.zeros(60, np.intp), True)
    c = calibrate("dh", split, fit(at, model), Floor(0.001, "stated"), None, False, {})
    made = tomllib.loads(export(c, form).text)["joint"]
    nominal = fold_last(dh_table(arm, "standard" if form == "dh" else "modified"))["joint"]
    for own, drawn_row in zip(made, nominal, strict=True):
        assert own["dh"]["a_mm"] == pytest.approx(drawn_row["dh"]["a_mm"], abs=5.0)
        for key in ("theta_deg", "alpha_deg"):
            turn = wrap_degrees(own["dh"][key] - drawn_row["dh"][key])
            assert turn == pytest.approx(0, abs=10.0)


def test_a_transform_that_no_row_holds_stays() -> None:
    table = dh_table(ROBOT, "standard")
    last = np.array(table["last"]["transform_mm"])
    last[1, 3] += 0.1
    table["last"] = {"transform_mm": last.tolist()}
    assert fold_last(table) == table


def test_an_angle_stands_beside_the_same_angle() -> None:
    """-179.9 beside 180 is 180.1."""
    after = [{"dh": {**joint["dh"]}} for joint in TABLE["joint"]]
    after[5]["dh"]["theta_deg"] = -179.9
    lines = compare_rows(TABLE, {"joint": after})
    assert [line.split()[-4] for line in lines[-2:]] == ["180.0000", "180.1000"]
    assert all("-400.000" in line for line in lines[1:3])


def test_long_rows_keep_all_their_digits() -> None:
    far = {"dh": {"theta_deg": 1 / 3, "d_mm": 1135251.123456789, "a_mm": 0.0, "alpha_deg": 0.0}}
    base = {"base_mm": np.eye(4)[:3].tolist()}
    assert round_rows({**base, "joint": [far]})["joint"] == [far]
    near = {"dh": {**far["dh"], "d_mm": 11.0}}
    rounded = round_rows({**base, "joint": [near]})["joint"][0]["dh"]["theta_deg"]
    assert rounded == round(1 / 3, DECIMALS_DEG)


def test_export_says_nominal_and_calibrated_and_no_sixteen_digits(rng) -> None:
    at = drawn(ROBOT, rng, 60, (60.0, 0.0, 118.0), covariates={})
    model = Model((mechanism("geometric", ROBOT),))
    theta = rng.normal(0, [t.size[1] / 10 if t.size else 1e-4 for t in model.terms])
    at = planted(at, model.terms, theta, rng, 0.02)
    rows = np.ones(60, bool)
    split = Split(at, rows, ~rows, np.zeros(60, np.intp), True)
    c = calibrate("dh", split, fit(at, model), Floor(0.02, "stated"), None, False, {})
    made = export(c, "hayati")
    assert made.error_mm < 1e-5
    assert tomllib.loads(made.text)["joint"][5]["dh"]["d_mm"] == pytest.approx(-80.0, abs=1.0)
    assert made.table[0].split() == ["joint", "theta_deg", "d_mm", "a_mm", "alpha_deg", "beta_deg"]
    assert [line.split()[0] for line in made.table[1:4]] == ["1", "calibrated", "2"]
    assert all(f"# {line}" in made.text for line in made.table)
    assert not re.search(r"\d\.\d{13,}", made.text)
    assert "nominal" in made.table[1]
    assert "-400.000" in made.table[1]
    assert any('target "target" on the flange' in note for note in made.notes)


def test_rows_beside_the_nominal_ones_fit_a_terminal_of_80_columns() -> None:
    nominal = {"theta_deg": -179.99, "d_mm": 0.0, "a_mm": -1620.0, "alpha_deg": -90.0}
    far = {"theta_deg": 180.0, "d_mm": -400230.43, "a_mm": -1612.706, "alpha_deg": -90.0229}
    rows = [{"dh": nominal}] * 7, [{"dh": {**far, "beta_deg": -0.0023}}] * 7
    lines = compare_rows(*({"joint": joints} for joints in rows))
    assert max(map(len, lines)) <= 80
    assert lines[1].split() == ["1", "nominal", "-179.9900", "0.000", "-1,620.000", "-90.0000", "–"]
    assert lines[2].split()[:2] == ["calibrated", "-180.0000"]
