"""Exports come back: each form is read by means of the test's own and held against the exact chain;
robots from a URDF."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from builders import drawn, planted, small_arm
from click.testing import CliRunner
from dh_steps import screw_x, screw_z
from wide_calibration import wide

from modelsel.calibration.arm_alone import leave_out_instrument
from modelsel.calibration.calibration import calibrate
from modelsel.calibration.calibration_file import calibration_text
from modelsel.calibration.constant_part import (
    compute_points,
    fix_members,
    restrict_to_form,
    sample_workspace,
    split_parts,
)
from modelsel.calibration.export import FORMS, export
from modelsel.calibration.export.form import write_difference
from modelsel.calibration.export.python import read_module_data
from modelsel.calibration.loading import parse_calibration
from modelsel.calibration.prediction import predict
from modelsel.cli.main import run_command_line
from modelsel.config.study_file import parse_study
from modelsel.diagnosis.shapes.unregistered import build_cell
from modelsel.exceptions import StudyError
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.noise import Floor
from modelsel.fitting.problem import Problem
from modelsel.fitting.whitening import Whitening
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.cause_functions import FUNCTIONS
from modelsel.mechanisms.causes import Applied, Combined, Member, Named, Number, shifted
from modelsel.mechanisms.registry import build_mechanisms, mechanism
from modelsel.robot.dh import compute_dh_rows
from modelsel.robot.files import builtin_names, load_robot, read_robot, robot_from_table
from modelsel.robot.gravity import compute_joint_torques
from modelsel.robot.kinematics import Joint, Robot, forward, pose
from modelsel.robot.rigid import from_rpy, to_rpy, transform
from modelsel.robot.urdf import read_urdf_text
from modelsel.robot.urdf_writer import write_urdf
from modelsel.selection.evaluation import Split


@pytest.fixture(scope="module")
def made():
    return wide(np.random.default_rng(3))[0]


@pytest.mark.parametrize("form", [f for f in FORMS if f not in ("table", "grid", "ur-calibration")])
def test_round_trip(form, made) -> None:
    found = export(made, form)
    assert found.error_mm < 1e-6
    said = " ".join(found.left_out)
    if form in ("urdf", "dh", "mdh", "hayati"):
        assert all(
            name in said for name in ("joint-compliance:2", "approach-backlash:3", "free(q3)")
        )
        assert found.left_out_mm[1] >= found.left_out_mm[0] > 0.01
    else:
        assert not said
    # no form carries an error of the instrument, and every form says so
    assert "refraction" not in said
    assert any(note.startswith("refraction is an error of the instrument") for note in found.notes)


def test_a_file_of_the_whole_model_names_its_group(made) -> None:
    """Where groups have frames of their own; else none is named."""
    alone = replace(made, placement=tuple(part[:1] for part in made.placement), groups=("all",))
    for c, group in ((made, "mon"), (alone, None)):
        assert json.loads(export(c, "json").text)["group"] == group
        assert read_module_data(export(c, "python").text)["group"] == group


def test_table_interpolates(made) -> None:
    found = export(made, "table")
    assert found.error_mm < 0.01
    assert "odd (frame 4 rx)" in found.left_out  # three values: q2, q3 and temperature


def rotation(r: float, p: float, y: float) -> np.ndarray:
    """Fixed-axis angles, written again."""
    (a, b), (c, d), (e, f) = ((np.cos(v), np.sin(v)) for v in (r, p, y))
    return np.array(
        [
            [e * c, e * d * b - f * a, e * d * a + f * b],
            [f * c, f * d * b + e * a, f * d * a - e * b],
            [-d, c * b, c * a],
        ]
    )


@pytest.mark.parametrize("top", [1.0, -1.0, 0.0])
def test_a_share_of_nothing_is_what_its_cause_gives(top: float) -> None:
    # of target 1 alone: over the number of target 0 it is not finite, and no error
    cause = Combined("/", Number(top), Member("target", 1))
    of_first = fix_members(cause, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        expected = Combined("/", Number(top), Number(0.0)).of({})
    assert isinstance(of_first, Number)
    assert not np.isfinite(of_first.number)
    assert of_first.number == pytest.approx(expected, nan_ok=True)
    assert fix_members(cause, 1) == Number(top)


def test_urdf_read_by_hand(made) -> None:
    """Another reader: the joints in the order of the file, 4 x 4 products."""
    root, at = ET.fromstring(export(made, "urdf").text), sample_workspace(made, 1, m=20)
    place = {}
    for joint in root.iter("joint"):
        xyz, angles = (
            [float(v) for v in joint.find("origin").get(k).split()] for k in ("xyz", "rpy")
        )
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = rotation(*angles), np.array(xyz) * 1e3
        place[joint.find("child").get("link")] = T
    wanted = compute_points(at, split_parts(restrict_to_form(made, "geometry"), 1)[0])
    for q, x in zip(at.data.q, wanted, strict=True):
        T = np.eye(4)
        for k in range(6):
            T = T @ place[f"link{k + 1}"] @ screw_z(q[k], 0.0)
        np.testing.assert_allclose((T @ place["flange"] @ place["b"])[:3, 3], x, atol=1e-9)


@pytest.mark.parametrize("modified", [False, True])
def test_dh_read_by_hand(modified, made) -> None:
    table, at = (
        tomllib.loads(export(made, "mdh" if modified else "dh").text),
        sample_workspace(made, 0, m=20),
    )
    target = [
        float(v)
        for line in export(made, "dh").text.splitlines()
        if line.startswith('# target "a" ')
        for v in line.partition("= ")[2].removesuffix(" mm").split(", ")
    ]
    for q, x in zip(
        at.data.q,
        compute_points(at, split_parts(restrict_to_form(made, "geometry"), 0)[0]),
        strict=True,
    ):
        T = np.vstack([table["base_mm"], [0, 0, 0, 1]])
        for value, joint in zip(q, table["joint"], strict=True):
            d, theta = joint["dh"]["d_mm"], np.radians(joint["dh"]["theta_deg"])
            link = screw_x(np.radians(joint["dh"]["alpha_deg"]), joint["dh"]["a_mm"])
            turned = screw_z(theta + value, d)
            T = T @ link @ turned if modified else T @ turned @ link
        # the last transform stands in the last row where that can hold it
        if "last" in table:
            T = T @ np.vstack([table["last"]["transform_mm"], [0, 0, 0, 1]])
        np.testing.assert_allclose(T[:3, :3] @ target + T[:3, 3], x, atol=1e-6)


@pytest.mark.parametrize("name", builtin_names())
@pytest.mark.parametrize("form", ["standard", "modified", "hayati"])
def test_dh_of_every_robot(name, form, rng) -> None:
    """Drawn and out of true, sliding and turning, with torques of its masses."""
    from modelsel.robot.dh import dh_table, format_robot_table

    drawing = load_robot(name)
    for size in (0.0, 1e-3):
        off = [
            transform(from_rpy(*rng.normal(0, size, 3)), rng.normal(0, 300 * size, 3))
            for _ in drawing.joints
        ]
        joints = [
            replace(
                j,
                before=j.before @ off[k],
                mass=1.0 + k,
                com=(10.0, 20.0, 30.0 * k),
                prismatic=k == 2 and bool(size),
            )
            for k, j in enumerate(drawing.joints)
        ]
        robot = Robot(name, "drawn", tuple(joints), drawing.last, (0.0, 0.6, -0.8))
        back = robot_from_table(tomllib.loads(format_robot_table(dh_table(robot, form))), "file")
        q = drawing.draw(rng, 30)
        np.testing.assert_allclose(
            forward(back, q, np.array([1.0, 2, 3])),
            forward(robot, q, np.array([1.0, 2, 3])),
            atol=1e-7,
        )
        np.testing.assert_allclose(
            *(compute_joint_torques(r, pose(r, q, np.zeros(3)), q) for r in (back, robot)),
            atol=1e-6,
        )


def test_a_slide_without_limits_has_those_of_its_readings(rng) -> None:
    """URDF readers refuse a slide without limits."""
    at = drawn(small_arm(prismatic=True), rng, 40)
    bare = replace(
        at.robot, joints=(*at.robot.joints[:2], replace(at.robot.joints[2], limits=None))
    )
    at = replace(at, robot=bare)
    whole = np.ones(len(at), bool)
    found = fit(at, Model((mechanism("geometric", bare),)))
    data = Split(at, whole, ~whole, np.zeros(len(at), np.intp), True)
    out = export(calibrate("bare", data, found, Floor(0.02, "stated"), None, False, {}), "urdf")
    (limit,) = ET.fromstring(out.text).iter("limit")
    reading = at.data.q[:, 2]
    assert [float(limit.get(k)) * 1e3 for k in ("lower", "upper")] == pytest.approx(
        [reading.min(), reading.max()]
    )
    assert "joint 3 slides" in " ".join(out.notes)


def test_nearly_parallel_axes_are_said() -> None:
    tilted = [Joint(transform()), Joint(transform(from_rpy(1e-3, 0, 0), (500.0, 0, 0)))]
    assert compute_dh_rows(Robot("two", "", tuple(tilted), np.eye(4)), "standard").nearly == (
        (1, 2),
    )


def test_python_stands_alone(made, tmp_path) -> None:
    """In a process of its own, where modelsel cannot be imported."""
    made = leave_out_instrument(made)
    at = sample_workspace(made, 1, m=7)
    (tmp_path / "arm.py").write_text(export(made, "python").text)
    np.savez(
        tmp_path / "in.npz",
        q=at.data.q,
        approach3=at.value("approach3"),
        temperature_C=at.value("temperature_C"),
    )
    code = (
        "import sys; sys.modules['modelsel'] = None; import numpy as np, arm; d = np.load('in.npz'); "
        "given = dict(approach3=d['approach3'], temperature_C=d['temperature_C'], progress=0.5); "
        "np.save('out.npy', arm.position(d['q'], 'b', **given)); np.save('more.npy', arm.correction(d['q'][0], 'b', **{k: "
        "np.atleast_1d(v)[0] for k, v in given.items()}))\n"
        "try: arm.position(d['q'])\nexcept KeyError as e: print(e)"
    )
    ran = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    np.testing.assert_allclose(np.load(tmp_path / "out.npy"), predict(made, at), atol=1e-9)
    nominal = forward(made.robot, at.data.q[:1], made.tools[1]) + made.placement[1][0]
    np.testing.assert_allclose(
        np.load(tmp_path / "more.npy"), predict(made, at)[:1] - nominal, atol=1e-9
    )
    assert "give it by name" in ran.stdout


def test_python_knows_every_derived_cause(rng) -> None:
    """Moments, torques with masses and without, the direction of gravity, coordinates, range, reach,
    the target's place on the flange and every function: on three arms."""
    for name in ("puma760", "ur5", "irb120"):
        robot = load_robot(name)
        names = (
            "base-tilt",
            "lateral-compliance:2",
            "link-bending:2",
            "joint-compliance:2",
            "tool-droop",
            "settle:2",
            "backlash:2",
        )
        on_flange = Named("on_flange_x_mm", "mm")
        turned = shifted(3.0 * Named("q2", "rad"), 0.7)
        causes = [Applied(function, turned) for function in FUNCTIONS]
        causes.append(1e-2 * on_flange * Named("down_y"))
        own = build_cell((1, "tz"), (1e-3 * Named("reach_mm", "mm"), *causes))
        sized = replace(own, terms=tuple(replace(t, size=(0.01, 0.2)) for t in own.terms))
        seen = (mechanism(n, robot) for n in ("tracker-scale", "refraction"))
        # by another name they are of the arm
        of_arm = [replace(one, name=f"own {one.name}") for one in seen]
        model = Model((*(mechanism(n, robot) for n in names), *of_arm, sized))
        at = replace(drawn(robot, rng, 60), whitening=Whitening(50.0))
        theta = np.array([t.size[0] + 0.1 * (t.size[1] - t.size[0]) for t in model.terms])
        at = planted(at, model.terms, theta, rng, 0.02)
        every_row = np.ones(60, bool)
        found = fit(at, model)
        c = calibrate(
            "all",
            Split(at, every_row, ~every_row, np.zeros(60, np.intp), True),
            found,
            Floor(0.02, "stated"),
            None,
            False,
            {},
        )
        assert export(c, "python").error_mm < 1e-9


@pytest.mark.parametrize("stated", [None, (210.0, -90.0, 60.0)], ids=["at the targets", "stated"])
def test_python_hangs_a_payload_where_all_targets_have_it(rng, stated) -> None:
    robot = replace(load_robot("puma760"), payload_at_mm=stated)
    q = np.repeat(robot.draw(rng, 40), 3, axis=0)
    payload = np.repeat(rng.choice([0.0, 5.0, 20.0], 40), 3)
    tools = rng.uniform(-150, 150, (3, 3)) + np.array([0.0, 0.0, 100.0])
    data = build_measurements(
        q,
        np.zeros((120, 3)),
        target=np.tile(["a", "b", "c"], 40),
        covariates={"payload_kg": payload},
    )
    names = ("joint-compliance:2", "payload-deflection:3", "base-tilt")
    model = Model(tuple(mechanism(name, robot) for name in names))
    theta = np.array([t.size[1] / 10 for t in model.terms])
    at = planted(Problem(robot, data, tools), model.terms, theta, rng, 0.02)
    every_row = np.ones(120, bool)
    split = Split(at, every_row, ~every_row, np.zeros(120, np.intp), True)
    c = calibrate("hangs", split, fit(at, model), Floor(0.02, "stated"), None, False, {})
    read = parse_calibration(calibration_text(c))
    assert read.robot.payload_at_mm == stated
    assert export(read, "python").error_mm < 1e-9


def test_python_bends_links_and_tilts_the_base_as_the_program_does(rng) -> None:
    """Links that bend all along under weight and payload, a flange, and the base, beside several targets."""
    robot = load_robot("ur5e")
    q = np.repeat(robot.draw(rng, 40), 2, axis=0)
    payload = np.repeat(rng.choice([0.0, 2.0, 5.0], 40), 2)
    tools = rng.uniform(-150, 150, (2, 3)) + np.array([0.0, 0.0, 100.0])
    data = build_measurements(
        q, np.zeros((80, 3)), target=np.tile(["a", "b"], 40), covariates={"payload_kg": payload}
    )
    names = ("link-bending:2:5", "payload-bending:3:6", "payload-bending:6:0", "base-tilt:2")
    built = [build_mechanisms(name, robot)[0] for name in names]
    model = Model((*built, mechanism("payload-tilt", robot)))
    theta = np.array([t.size[1] / 10 for t in model.terms])
    at = planted(Problem(robot, data, tools), model.terms, theta, rng, 0.02)
    every_row = np.ones(80, bool)
    split = Split(at, every_row, ~every_row, np.zeros(80, np.intp), True)
    c = calibrate("bends", split, fit(at, model), Floor(0.02, "stated"), None, False, {})
    assert export(c, "python").error_mm < 1e-9


def test_python_weighs_the_payload_with_the_arm(rng) -> None:
    """A spring and a play under one torque of both: the program, the stored calibration and a prediction
    take the payload of each row."""
    robot = load_robot("ur5e")
    payload = rng.choice([0.0, 2.0, 5.0], 60)
    q = robot.draw(rng, 60)
    data = build_measurements(q, np.zeros((60, 3)), covariates={"payload_kg": payload})
    whole = [build_mechanisms(name, robot)[-1] for name in ("joint-compliance:2", "backlash:3")]
    assert all("payload_kg" in one.names() for one in whole)
    model = Model(tuple(whole))
    theta = np.array([t.size[1] / 10 for t in model.terms])
    at = planted(Problem(robot, data, np.array([40.0, 30.0, 90.0])), model.terms, theta, rng, 0.02)
    every_row = np.ones(60, bool)
    split = Split(at, every_row, ~every_row, np.zeros(60, np.intp), True)
    c = calibrate("whole", split, fit(at, model), Floor(0.02, "stated"), None, False, {})
    found = export(c, "python")
    assert found.error_mm < 1e-9
    assert "payload_kg" in read_module_data(found.text)["needs"]
    restored = parse_calibration(calibration_text(c))
    heavy = replace(at, data=replace(data, covariates={"payload_kg": payload + 3.0}))
    moved = predict(restored, heavy) - predict(restored, at)
    assert np.ptp(moved) > 0.1


def test_python_knows_the_beam(rng) -> None:
    """Its angles, the directions across it and its direction at the target, of a tracker that stands
    anywhere."""
    robot = load_robot("ur5")
    names = ("tracker-azimuth", "tracker-zenith", "tracker-range", "reflector-incidence")
    seen = (mechanism(n, robot) for n in names)
    # by another name they are of the arm
    model = Model(tuple(replace(one, name=f"own {one.name}") for one in seen))
    at = replace(drawn(robot, rng, 60), tracker=(2500.0, -900.0, 400.0))
    theta = np.array([t.size[1] / 10 for t in model.terms])
    at = planted(at, model.terms, theta, rng, 0.02)
    every_row = np.ones(60, bool)
    split = Split(at, every_row, ~every_row, np.zeros(60, np.intp), True)
    c = calibrate("beam", split, fit(at, model), Floor(0.02, "stated"), None, False, {})
    assert np.ptp(predict(c, at) - predict(replace(c, theta=0 * c.theta), at)) > 0.01
    assert export(c, "python").error_mm < 1e-9


def test_command(made, tmp_path) -> None:
    (tmp_path / "calibration.json").write_text(calibration_text(made))
    ran = CliRunner().invoke(
        run_command_line,
        ["export", str(tmp_path), "--format", "urdf", "--out", str(tmp_path / "a.urdf")],
    )
    assert ran.exit_code == 0
    assert "µm" in ran.output
    assert "It cannot carry joint-compliance:2" in ran.output
    assert (
        CliRunner()
        .invoke(
            run_command_line, ["export", str(tmp_path / "none"), "--format", "urdf", "--out", "x"]
        )
        .exit_code
        == 2
    )


# -- URDF in
# -------------------------------------------------------------------------------------------------------------------


def rig() -> str:
    """A rail, an arm of two joints with a bolted cover, a gripper that opens; and a second arm
    beside it."""
    links = {
        "world": "",
        "rail": "",
        "b1": "",
        "tool": "",
        "a2": '<mass value="3"/>',
        "a1": '<mass value="2"/><origin xyz="0.1 0 0"/>',
        "cover": '<mass value="1"/><origin xyz="0 0 0.2"/>',
        "finger": '<mass value="0.5"/>',
    }
    joints = (
        ("slide", "prismatic", "world", "rail", "1 0 0", "0 0 0"),
        ("j1", "revolute", "rail", "a1", "0 0 1", "0 0 0.3"),
        ("bolt", "fixed", "a1", "cover", "0 0 1", "0.3 0 0"),
        ("j2", "revolute", "a1", "a2", "0 1 0", "0.5 0 0"),
        ("grip", "prismatic", "a2", "finger", "0 1 0", "0.4 0 0"),
        ("tip", "fixed", "a2", "tool", "0 0 1", "0.6 0 0"),
        ("k1", "revolute", "rail", "b1", "0 0 1", "0 1 0"),
    )
    text = "".join(
        f'<link name="{name}">' + (f"<inertial>{inside}</inertial>" if inside else "") + "</link>"
        for name, inside in links.items()
    )
    text += "".join(
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>'
        f'<origin xyz="{at}"/></joint>'
        for name, kind, parent, child, axis, at in joints
    )
    return f'<robot name="rig">{text}</robot>'


def test_chain_by_base_and_tip() -> None:
    arm = read_urdf_text(rig(), "rig.urdf", "rail", "tool")
    assert [j.prismatic for j in arm.joints] == [False, False]
    np.testing.assert_allclose(
        forward(arm, np.zeros((1, 2)), np.zeros(3)), [[1100, 0, 300]], atol=1e-9
    )
    assert read_urdf_text(rig(), "rig.urdf", tip="tool").n == 3
    assert read_urdf_text(rig(), "rig.urdf", "world", "b1").n == 2
    assert arm.joints[0].mass == 3  # the link and its cover
    np.testing.assert_allclose(arm.joints[0].com, [(2 * 100 + 1 * 300) / 3, 0, 200 / 3])
    assert arm.joints[1].mass == 3.5  # and the finger on the last
    at = pose(arm, np.zeros((1, 2)), np.zeros(3))
    np.testing.assert_allclose(
        compute_joint_torques(arm, at, np.zeros((1, 2)))[1], 0.5 * 9.81 * 0.4, rtol=1e-12
    )


@pytest.mark.parametrize(
    ("base", "tip", "says"),
    [
        ("rial", "tool", 'Did you mean "rail"'),
        ("rail", "toll", 'Did you mean "tool"'),
        ("a1", "b1", "must hang on the base"),
        ("a2", "tool", "no moving joint"),
    ],
)
def test_refused_chains(base, tip, says) -> None:
    with pytest.raises(StudyError, match=says):
        read_urdf_text(rig(), "rig.urdf", base, tip)


def test_study_names_base_and_tip(tmp_path) -> None:
    text = '{}\n[robot]\n{}\ntool_mm = [0, 0, 0]\n[measurements]\nfile = "m.csv"\n'
    table = parse_study(
        text.format('name = "x"', 'file = "rig.urdf"\nbase = "rail"\ntip = "tool"'), "study.toml"
    ).robot
    (tmp_path / "rig.urdf").write_text(rig())
    assert read_robot(tmp_path / table.file, table.base, table.tip).n == 2
    with pytest.raises(StudyError, match="links of a URDF"):
        parse_study(text.format('name = "x"', 'name = "ur5"\nbase = "rail"'), "study.toml")
    with pytest.raises(StudyError, match="have one chain"):
        read_robot(tmp_path / "robot.toml", "rail")


@pytest.mark.slow
def test_check_takes_a_chain(tmp_path, rng) -> None:
    (tmp_path / "rig.urdf").write_text(rig())
    rows = "\n".join(",".join(map(str, rng.uniform(-1, 1, 5))) for _ in range(12))
    (tmp_path / "m.csv").write_text(f"q1_rad,q2_rad,x_mm,y_mm,z_mm\n{rows}\n")
    words = ["check", str(tmp_path / "m.csv"), "--robot", str(tmp_path / "rig.urdf")]
    assert (
        CliRunner().invoke(run_command_line, words).exit_code == 3
    )  # the whole chain has a rail: q1_mm is missing
    ran = CliRunner().invoke(run_command_line, [*words, "--base", "rail", "--tip", "tool"])
    assert ran.exit_code == 0, ran.output
    assert "12 configurations" in ran.output


def test_rpy_at_the_pole(rng) -> None:
    for angles in (
        rng.uniform(-3, 3, 3),
        (0.3, np.pi / 2, -1.2),
        (0.3, -np.pi / 2 + 1e-9, 2.0),
        (np.pi, 0, np.pi),
    ):
        R = rotation(*angles)
        np.testing.assert_allclose(rotation(*to_rpy(R)), R, atol=1e-14)


def mounted(turn: str, kind: str = "fixed", axis: str = "0 0 1", more: str = "") -> str:
    """A small arm whose base link hangs on the world by one joint."""
    links = "".join(
        f'<link name="{name}"/>'
        for name in ("world", "foot", "l1", "l2", *(["r1", "r2"] if more else []))
    )
    joint = '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/><axis xyz="{}"/><origin xyz="{}" rpy="{}"/></joint>'
    joints = [
        ("mount", kind, "world", "foot", axis, "1 2 3", turn),
        ("a", "revolute", "foot", "l1", "0 0 1", "0 0 0.3", "0 0 0"),
        ("b", "revolute", "l1", "l2", "0 1 0", "0.4 0 0", "0 0 0"),
    ]
    return f'<robot name="wall">{links}{"".join(joint.format(*j) for j in joints)}{more}</robot>'


@pytest.mark.parametrize("base", [None, "foot"])
def test_gravity_turns_with_the_base_link(base, rng) -> None:
    """Torques of a wall mount are those of the whole chain from the world, wherever the chain
    starts."""
    angles = rng.uniform(-3, 3, 3)
    text = mounted(" ".join(map(repr, angles.tolist())))
    arm = read_urdf_text(text, "wall.urdf", base)
    down = np.array([0, 0, -1.0])
    np.testing.assert_allclose(
        arm.gravity, down if base is None else rotation(*angles).T @ down, atol=1e-12
    )
    upright = read_urdf_text(text, "wall.urdf")
    q = rng.uniform(-2, 2, (20, 2))
    np.testing.assert_allclose(
        compute_joint_torques(arm, pose(arm, q, np.zeros(3)), q),
        compute_joint_torques(upright, pose(upright, q, np.zeros(3)), q),
        atol=1e-12,
    )


def test_a_right_angle_of_few_digits_is_one() -> None:
    assert read_urdf_text(mounted("0 1.571 0"), "wall.urdf", "foot").gravity == (1.0, 0.0, 0.0)
    assert read_urdf_text(mounted("3.1416 0 0"), "wall.urdf", "foot").gravity == (0.0, 0.0, 1.0)


@pytest.mark.parametrize(
    ("kind", "axis", "known"),
    [
        ("prismatic", "1 0 0", True),
        ("revolute", "0 0 2", True),
        ("revolute", "1 0 0", False),
        ("floating", "0 0 1", False),
    ],
)
def test_gravity_below_a_joint_that_turns_the_base(kind, axis, known) -> None:
    assert read_urdf_text(mounted("0 0 1", kind, axis), "wall.urdf", "foot").gravity == (
        (0.0, 0.0, -1.0) if known else None
    )


def test_an_exported_wall_mount_hangs_as_it_did(rng) -> None:
    robot = replace(load_robot("ur5"), gravity=(0.6, 0.0, 0.8))
    text = write_urdf(robot, {"t": transform(None, (0, 0, 50.0))}, {})
    back = read_urdf_text(text, "file", "base", "flange")
    np.testing.assert_allclose(back.gravity, robot.gravity, atol=1e-12)
    whole = read_urdf_text(text, "file", tip="flange")
    q = robot.draw(rng, 10)
    for one in (back, whole):
        np.testing.assert_allclose(
            compute_joint_torques(one, pose(one, q, np.zeros(3)), q),
            compute_joint_torques(robot, pose(robot, q, np.zeros(3)), q),
            atol=1e-9,
        )


def test_two_arms_are_refused_with_the_list() -> None:
    joint = '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><axis xyz="0 0 1"/></joint>'
    twin = joint.format("c", "foot", "r1") + joint.format("d", "r1", "r2")
    text = mounted("0 0 0", more=twin)
    with pytest.raises(
        StudyError,
        match=r'2 chains have 2 moving joints each.* "l2" by a, b; "r2" by c, d\. Say which: tip =',
    ):
        read_urdf_text(text, "two.urdf")
    assert read_urdf_text(text, "two.urdf", tip="r2").n == 2
    assert read_urdf_text(text, "two.urdf", tip="l2").joints[1].before[0, 3] == 400


@pytest.mark.parametrize(("other", "taken"), [("0 0 0", True), ("0 0 0.1", False)])
def test_two_flanges_are_refused_where_they_differ(other, taken) -> None:
    fixed = '<joint name="{0}" type="fixed"><parent link="l2"/><child link="{0}"/><origin xyz="{1}"/></joint><link name="{0}"/>'
    text = mounted("0 0 0").replace(
        "</robot>", fixed.format("tool0", "0 0 0") + fixed.format("ee", other) + "</robot>"
    )
    if taken:
        assert read_urdf_text(text, "two.urdf").n == 2
    else:
        with pytest.raises(StudyError, match=r'"ee" by a, b; "tool0" by a, b.*tip = "…"'):
            read_urdf_text(text, "two.urdf")


def test_written_urdf_keeps_masses() -> None:
    robot = load_robot("ur5")
    back = read_urdf_text(write_urdf(robot, {}, {}), "file")
    np.testing.assert_allclose([j.mass for j in back.joints], [j.mass for j in robot.joints])
    np.testing.assert_allclose(
        [j.com for j in back.joints], [j.com for j in robot.joints], atol=1e-9
    )


def test_small_differences_are_in_micrometres_and_no_others() -> None:
    """310 µm stood beside 0.31 mm."""
    assert write_difference(0.0031) == "3.1 µm"
    assert write_difference(0.31) == "0.31 mm"
