"""DH with Hayati's rows, and the kinematics file of Universal Robots' ROS driver."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from dh_steps import screw_x, screw_z
from own_urdf import OWN, calibrated

from modelsel.calibration.calibration_file import calibration_text
from modelsel.calibration.constant_part import (
    compute_points,
    restrict_to_form,
    sample_workspace,
    split_parts,
)
from modelsel.calibration.export import export
from modelsel.cli.main import run_command_line
from modelsel.exceptions import StudyError
from modelsel.robot.dh import compute_dh_rows
from modelsel.robot.files import load_robot, robot_from_table
from modelsel.robot.kinematics import Joint, Robot, forward
from modelsel.robot.rigid import from_rpy, inverse, rotation_matrix, transform
from modelsel.robot.urdf import read_urdf_text
from modelsel.robot.urdf_writer import write_urdf


@pytest.fixture(scope="module")
def made():
    return calibrated(load_robot("ur10e"), np.random.default_rng(4))


def wanted_points(c, m=40):
    """(readings, positions of the first target in frame 0) of what a geometry carries."""
    at = sample_workspace(c, m=m)
    return at.data.q, compute_points(at, split_parts(restrict_to_form(c, "geometry"))[0])


def offset_in(notes, start: str) -> np.ndarray:
    (note,) = [note for note in notes if note.startswith(start)]
    return np.array([float(v) for v in note.partition("= ")[2].removesuffix(" mm").split(", ")])


# -- Hayati


def hayati_chain(table, q: np.ndarray) -> np.ndarray:
    """The chain of a table, row by row: Rz(θ) Tz(d) Tx(a) Rx(α) Ry(β)."""
    T = np.vstack([table["base_mm"], [0, 0, 0, 1]])
    for value, joint in zip(q, table["joint"], strict=True):
        row = joint["dh"]
        turn = screw_z(np.radians(row["theta_deg"]) + value, row["d_mm"])
        T = T @ turn @ screw_x(np.radians(row["alpha_deg"]), row["a_mm"])
        T = T @ transform(rotation_matrix(1, np.radians(row.get("beta_deg", 0.0))))
    if "last" not in table:  # it stands in the last row where that can hold it
        return T
    return T @ np.vstack([table["last"]["transform_mm"], [0, 0, 0, 1]])


def test_dh_says_how_far_it_goes(made) -> None:
    found = export(made, "dh")
    rows = [joint["dh"] for joint in tomllib.loads(found.text)["joint"]]
    largest = max(abs(row["d_mm"]) for row in rows) / 1e3
    assert largest > 100
    (note,) = [note for note in found.notes if "almost parallel" in note]
    assert f"rows have a d of up to {largest:,.0f} m" in note


def test_hayati_has_no_long_way_round(made) -> None:
    """Axes 2, 3 and 4 are parallel but for a mrad: their rows have β and no d; DH goes far out."""
    found = export(made, "hayati")
    assert found.error_mm < 1e-9
    assert "joints 2 and 3 are almost parallel: row 2 has the angle beta, and no d" in found.notes
    rows = [joint["dh"] for joint in tomllib.loads(found.text)["joint"]]
    assert ["beta_deg" in row for row in rows] == [False, True, True, False, False, False]
    assert [row["d_mm"] for row in rows[1:3]] == [0, 0]
    drawn = compute_dh_rows(made.robot, "standard").rows
    # the flange is 116.55 mm beyond the last axis, in its row
    to_flange = [0.0] * 5 + [116.55]
    for row, nominal, d in zip(rows, drawn, to_flange, strict=True):
        assert row["d_mm"] == pytest.approx(nominal.d + d, abs=10)
        assert row["a_mm"] == pytest.approx(nominal.a, abs=10)
        assert row["theta_deg"] == pytest.approx(np.degrees(nominal.theta), abs=1)
        assert row["alpha_deg"] == pytest.approx(np.degrees(nominal.alpha), abs=1)
    far = [joint["dh"] for joint in tomllib.loads(export(made, "dh").text)["joint"]]
    assert max(abs(row["d_mm"]) for row in far) > 1e4


def test_hayati_read_by_hand(made) -> None:
    found = export(made, "hayati")
    target = offset_in(
        [line[2:] for line in found.text.splitlines() if line.startswith("# target ")], "target "
    )
    table = tomllib.loads(found.text)
    q, wanted = wanted_points(made)
    for readings, x in zip(q, wanted, strict=True):
        T = hayati_chain(table, readings)
        np.testing.assert_allclose(T[:3, :3] @ target + T[:3, 3], x, atol=1e-8)


@pytest.mark.integration
def test_rounded_tables() -> None:
    """Angles to 0.0001 deg, lengths to a µm, of four drawn arms: the figures of the page on exports
    (docs/how-to/other-programs.md)."""
    farthest: dict[str, list[float]] = {"dh": [], "hayati": []}
    errors: dict[str, list[float]] = {"dh": [], "hayati": []}
    for seed in range(4, 8):
        arm = calibrated(load_robot("ur10e"), np.random.default_rng(seed))
        q = arm.robot.draw(np.random.default_rng(1), 300)
        for form in ("dh", "hayati"):
            table = tomllib.loads(export(arm, form).text)
            exact = robot_from_table(table, "table")
            farthest[form].append(max(abs(joint["dh"]["d_mm"]) for joint in table["joint"]))
            for joint in table["joint"]:
                joint["dh"] = {
                    key: round(v, 4 if key.endswith("deg") else 3) for key, v in joint["dh"].items()
                }
            rounded = robot_from_table(table, "table")
            difference = forward(rounded, q, np.zeros(3)) - forward(exact, q, np.zeros(3))
            errors[form].append(np.linalg.norm(difference, axis=1).max())
    assert 300e3 < min(farthest["dh"]) < max(farthest["dh"]) < 600e3
    assert max(farthest["hayati"]) < 200
    assert [round(f(errors["dh"]), 1) for f in (min, max)] == [0.1, 0.3]
    assert round(max(errors["hayati"]) * 1e3) == 2


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_beta_is_read(convention, rng) -> None:
    """Ry(β) after the link's own turn α, in either convention."""
    theta, d, a, alpha, beta = rng.normal(0, 30, 5)
    row = {"theta_deg": theta, "d_mm": d, "a_mm": a, "alpha_deg": alpha, "beta_deg": beta}
    robot = robot_from_table({"convention": convention, "joint": [{"dh": row}]}, "robot.toml")
    link = screw_x(np.radians(alpha), a) @ transform(rotation_matrix(1, np.radians(beta)))
    q = 0.4
    turned = screw_z(np.radians(theta) + q, d)
    whole = link @ turned if convention == "modified" else turned @ link
    point = rng.normal(0, 100, 3)
    np.testing.assert_allclose(
        forward(robot, np.array([[q]]), point)[0], whole[:3, :3] @ point + whole[:3, 3]
    )


def test_parallel_axes_of_one_line() -> None:
    """Two axes on one line, and two that look opposite ways."""
    befores = [
        np.eye(4),
        transform(None, (0, 0, 50.0)),
        transform(np.diag([1.0, -1, -1]), (9, 0, 5)),
    ]
    robot = Robot("line", "", tuple(map(Joint, befores)), np.eye(4))
    rows = compute_dh_rows(robot, "hayati").rows
    assert (rows[0].a, rows[0].d, rows[0].beta) == (0, 0, 0)
    assert abs(rows[1].alpha) == pytest.approx(np.pi)
    back = robot_from_table({"joint": [{"dh": row.to_table()} for row in rows]}, "x")
    q = np.array([[0.1, 0.2, 0.3]])
    # what the last link leaves along its axis is in the last row
    np.testing.assert_allclose(
        forward(back, q, np.zeros(3)), forward(robot, q, np.zeros(3)), atol=1e-9
    )


# -- ur_calibration


def read_kinematics(text: str) -> dict:
    yaml = pytest.importorskip("yaml")
    return yaml.safe_load(text)["kinematics"]


def ur_chain(kinematics: dict, q: np.ndarray) -> np.ndarray:
    """The chain of ur_description from base_link_inertia: every origin in metres and fixed-axis
    angles, every axis z."""
    T = np.eye(4)
    for link, angle in zip(
        ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3"), q, strict=True
    ):
        x, y, z, roll, pitch, yaw = (
            kinematics[link][key] for key in ("x", "y", "z", "roll", "pitch", "yaw")
        )
        T = T @ transform(from_rpy(roll, pitch, yaw), (x, y, z)) @ screw_z(angle, 0.0)
    return T


def test_ur_calibration_read_by_hand(made) -> None:
    found = export(made, "ur-calibration")
    assert found.error_mm < 1e-9
    assert "joint-compliance:2 (frame 2 rz)" in found.left_out
    kinematics = read_kinematics(found.text)
    assert re.fullmatch("modelsel_[0-9a-f]{16}", kinematics.pop("hash"))
    assert all(type(v) is float for row in kinematics.values() for v in row.values())
    target = offset_in(found.notes, "target ")
    q, wanted = wanted_points(made)
    for readings, x in zip(q, wanted, strict=True):
        T = ur_chain(kinematics, readings)
        np.testing.assert_allclose(T[:3, :3] @ target + T[:3, 3] * 1e3, x, atol=1e-8)


# config/ur10e/default_kinematics.yaml of ur_description
UR10E = {
    "shoulder": ((0, 0, 0.1807), (0, 0, 0)),
    "upper_arm": ((0, 0, 0), (np.pi / 2, 0, 0)),
    "forearm": ((-0.6127, 0, 0), (0, 0, 0)),
    "wrist_1": ((-0.57155, 0, 0.17415), (0, 0, 0)),
    "wrist_2": ((0, -0.11985, 0), (np.pi / 2, 0, 0)),
    "wrist_3": ((0, 0.11655, 0), (np.pi / 2, np.pi, np.pi)),
}


@pytest.mark.parametrize("turned", [False, True])
def test_frames_are_those_of_ur_description(turned, made) -> None:
    """The nominal arm gives Universal Robots' own numbers; so does one on base_link, which looks
    the other way."""
    nominal = replace(made, theta=np.zeros_like(made.theta), refits=None)
    if turned:
        half = transform(np.diag([-1.0, -1, 1]))
        first, *rest = made.robot.joints
        joints = (replace(first, before=half @ first.before), *rest)
        nominal = replace(nominal, robot=replace(made.robot, joints=joints))
    found = export(nominal, "ur-calibration")
    assert any("frame 0 of the calibration" in note for note in found.notes) == turned
    kinematics = read_kinematics(found.text)
    for link, (xyz, rpy) in UR10E.items():
        row = kinematics[link]
        R = from_rpy(row["roll"], row["pitch"], row["yaw"])
        np.testing.assert_allclose([row["x"], row["y"], row["z"]], xyz, atol=1e-12)
        np.testing.assert_allclose(R, from_rpy(*rpy), atol=1e-12)


def test_from_other_frames(made) -> None:
    """The same arm, described with other frames on its axes."""
    joints = []
    previous = np.eye(4)
    for k, joint in enumerate(made.robot.joints):
        free = transform(rotation_matrix(2, 0.3 * k), (0, 0, 40.0 * k))
        joints.append(replace(joint, before=inverse(previous) @ joint.before @ free))
        previous = free
    other = Robot("other", "", tuple(joints), inverse(previous) @ made.robot.last)
    nominal = replace(made, theta=np.zeros_like(made.theta), refits=None)
    one, two = (
        read_kinematics(export(replace(nominal, robot=robot), "ur-calibration").text)
        for robot in (made.robot, other)
    )
    for link in UR10E:
        rotations = [from_rpy(*(k[link][a] for a in ("roll", "pitch", "yaw"))) for k in (one, two)]
        np.testing.assert_allclose(*rotations, atol=1e-9)
        places = [[k[link][a] for a in "xyz"] for k in (one, two)]
        np.testing.assert_allclose(*places, atol=1e-9)


@pytest.mark.parametrize(
    ("robot", "says"),
    [
        (lambda: load_robot("puma760"), '"puma760" is not an arm of Universal Robots'),
        (lambda: load_robot("iiwa14"), "it has 7 joints"),
        (lambda: read_urdf_text(OWN, "own.urdf", tip="flange"), "axis of joint"),
    ],
)
def test_other_arms_are_refused(robot, says) -> None:
    c = calibrated(robot(), np.random.default_rng(2))
    with pytest.raises(StudyError, match=says):
        export(replace(c, refits=None), "ur-calibration")


def test_a_name_stays_in_its_comment(made, tmp_path) -> None:
    """Foreign text in the notes: one line each, whatever it holds."""
    hostile = replace(made, study="x: y # z\\n''' {evil: !!python/object}", targets=("a: 'b' #",))
    (tmp_path / "calibration.json").write_text(calibration_text(hostile))
    path = tmp_path / "out"
    words = ["export", str(tmp_path), "--out", str(path), "--format"]
    for form in ("hayati", "ur-calibration"):
        ran = CliRunner().invoke(run_command_line, [*words, form])
        assert ran.exit_code == 0, ran.output
        if form == "hayati":
            assert tomllib.loads(path.read_text())["source"].endswith(hostile.study)
    text = path.read_text()
    assert hostile.study in text
    assert read_kinematics(text) == read_kinematics(export(made, "ur-calibration").text)


def test_a_ros_file_of_the_arm(made, tmp_path) -> None:
    """By way of a URDF of the study: the frames of the file do not matter."""
    arm = read_urdf_text(write_urdf(made.robot, {}, {}), "ur.urdf", tip="flange")
    found = export(replace(made, robot=arm), "ur-calibration")
    assert found.error_mm < 1e-9
