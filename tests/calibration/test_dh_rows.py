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
from modelsel.calibration.export.dh_rows import DECIMALS_DEG, compare_rows, fold_last, round_rows
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.noise import Floor
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.dh import dh_table
from modelsel.robot.files import robot_from_table
from modelsel.robot.kinematics import forward
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
