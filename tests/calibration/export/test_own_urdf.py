"""The user's own URDF comes back calibrated, whichever frames it chose; another arm's is refused."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from own_urdf import OWN, calibrated, without_origins

from modelsel.calibration.calibration_file import calibration_text
from modelsel.calibration.constant_part import (
    compute_points,
    restrict_to_form,
    sample_workspace,
    split_parts,
)
from modelsel.calibration.export import attach_urdf, export
from modelsel.calibration.loading import parse_calibration
from modelsel.cli.main import run_command_line
from modelsel.exceptions import StudyError
from modelsel.robot.alignment import align_chains
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Joint, Robot, forward
from modelsel.robot.rigid import from_rpy, inverse, rotation_matrix, transform
from modelsel.robot.urdf import read_urdf_text
from modelsel.robot.urdf_writer import write_urdf


@pytest.fixture(scope="module")
def made():
    arm = read_urdf_text(OWN, "own.urdf", tip="flange")
    return calibrated(arm, np.random.default_rng(5))


@pytest.fixture(scope="module")
def of_ur5():
    return calibrated(load_robot("ur5"), np.random.default_rng(6))


def test_own_file_comes_back(made) -> None:
    """Through calibration.json, with what it cannot carry and both figures."""
    stored = parse_calibration(calibration_text(made))
    assert stored.robot.urdf == made.robot.urdf
    found = export(stored, "urdf")
    assert without_origins(found.text) == without_origins(OWN)
    assert found.error_mm < 1e-9
    assert "joint-compliance:2 (frame 2 rz)" in found.left_out
    rows, nominal, own, whole = found.errors
    assert nominal > own > whole
    said = " ".join(found.notes)
    assert f"{rows}, the file leaves {own:.3g} mm rms, the whole model leaves {whole:.3g}" in said
    assert "fitted again without what this form cannot carry" in said


def test_target_stands_in_the_notes(made) -> None:
    """Read as a user would: the numbers of the note, on the chain of the file."""
    found = export(made, "urdf")
    (note,) = [note for note in found.notes if note.startswith("target ")]
    assert 'in link "flange"' in note
    offset = [float(v) for v in note.partition("= ")[2].removesuffix(" mm").split(", ")]
    at = sample_workspace(made, m=30)
    wanted = compute_points(at, split_parts(restrict_to_form(made, "geometry"))[0])
    back = read_urdf_text(found.text, "back", tip="flange")
    np.testing.assert_allclose(forward(back, at.data.q, np.array(offset)), wanted, atol=1e-9)


def other_frames(robot: Robot, base: np.ndarray, rng: np.random.Generator) -> Robot:
    """The same arm, its frames turned about and shifted along their axes, on another base."""
    previous = inverse(base)
    joints = []
    for joint in robot.joints:
        free = transform(rotation_matrix(2, rng.uniform(-3, 3)), (0, 0, rng.uniform(-200, 200)))
        joints.append(replace(joint, before=inverse(previous) @ joint.before @ free))
        previous = free
    return Robot("other", "", tuple(joints), inverse(previous) @ robot.last)


@pytest.mark.parametrize(
    "base",
    [
        np.eye(4),
        transform(np.diag([-1.0, -1, 1])),
        transform(from_rpy(0.3, -1.2, 2.0), (400.0, -100, 700)),
    ],
)
def test_another_file_of_the_arm(base, of_ur5, rng, tmp_path) -> None:
    """A built-in robot's calibration into a URDF whose frames stand elsewhere on the same axes."""
    arm = other_frames(of_ur5.robot, base, rng)
    path = tmp_path / "ur5.urdf"
    path.write_text(write_urdf(arm, {}, {}))
    c = attach_urdf(of_ur5, path)
    np.testing.assert_allclose(
        align_chains(c.robot, read_urdf_text(c.robot.urdf.text, "x")).base, base, atol=1e-6
    )
    found = export(c, "urdf")
    assert found.error_mm < 1e-6
    assert without_origins(found.text) == without_origins(path.read_text())
    assert any("frame 0 of the calibration" in note for note in found.notes) == (
        not np.array_equal(base, np.eye(4))
    )


def test_roundings_of_the_file_do_not_count(of_ur5, tmp_path) -> None:
    """1.5708 for a right angle, metres to four digits: the export has the calibrated numbers."""
    rounded = []
    for joint in of_ur5.robot.joints:
        before = joint.before.copy()
        before[:3, 3] = before[:3, 3].round(1)
        rounded.append(replace(joint, before=before))
    path = tmp_path / "ur5.urdf"
    text = write_urdf(replace(of_ur5.robot, joints=tuple(rounded)), {}, {})
    path.write_text(text.replace("1.5707963267948966", "1.5708"))
    assert export(attach_urdf(of_ur5, path), "urdf").error_mm < 1e-9


def flip(robot: Robot, number: int) -> Robot:
    """The same arm, one of its joints counted the other way round."""
    turn = transform(np.diag([1.0, -1, -1]))
    joints = list(robot.joints)
    joints[number - 1] = replace(joints[number - 1], before=joints[number - 1].before @ turn)
    joints[number] = replace(joints[number], before=turn @ joints[number].before)
    return replace(robot, joints=tuple(joints))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda r: load_robot("ur10"), r"axis of joint \d lies \d\d\d mm away"),
        (lambda r: flip(r, 3), "axis of joint 3 points 180 deg away"),
        (lambda r: replace(r, joints=r.joints[:5]), "5 joints .* where the calibrated robot has 6"),
        (
            lambda r: replace(
                r, joints=(replace(r.joints[0], prismatic=True, limits=(0, 1)), *r.joints[1:])
            ),
            r"6 joints \(slides, turns",
        ),
    ],
)
def test_another_arm_is_refused(change, says, of_ur5, tmp_path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(write_urdf(change(of_ur5.robot), {}, {}))
    with pytest.raises(StudyError, match=f"is not the calibrated arm's: .*{says}"):
        export(attach_urdf(of_ur5, path), "urdf")


def test_arms_of_slides_and_of_parallel_axes(rng) -> None:
    """A gantry, whose frames may stand anywhere, and a SCARA, whose axes are one direction."""
    slide = [Joint(transform(R), True) for R in (np.eye(3), from_rpy(np.pi / 2, 0, 0))]
    gantry = Robot("gantry", "", (*slide, Joint(transform(None, (0, 0, 300.0)))), np.eye(4))
    links = [Joint(transform(None, (x, 0, 0))) for x in (0.0, 400.0, 300.0)]
    scara = Robot("scara", "", (*links, Joint(np.eye(4), True)), np.eye(4))
    base = transform(from_rpy(0.2, 0.1, 1.0), (100.0, 200, 300))
    for robot in (gantry, scara):
        arm = other_frames(robot, base, rng)
        alignment = align_chains(robot, arm)
        before = alignment.express([joint.before for joint in robot.joints])
        back = replace(
            arm, joints=tuple(replace(j, before=b) for j, b in zip(arm.joints, before, strict=True))
        )
        q = rng.uniform(-1, 1, (20, robot.n))
        points = forward(robot, q, np.zeros(3)) @ alignment.base[:3, :3].T + alignment.base[:3, 3]
        tip = inverse(alignment.frames[-1] @ arm.last) @ robot.last
        np.testing.assert_allclose(forward(back, q, tip[:3, 3]), points, atol=1e-8)


def test_a_robot_that_a_script_changed_has_no_file(made) -> None:
    """It can be stored and loaded, and a new URDF is written of it."""
    first, *rest = made.robot.joints
    moved = replace(first, before=first.before @ transform(None, (0, 0, 0.1)))
    changed = replace(made, robot=replace(made.robot, joints=(moved, *rest)))
    stored = parse_calibration(calibration_text(changed))
    assert stored.robot.urdf is None
    found = export(stored, "urdf")
    assert 'name="joint1"' in found.text
    assert "`--urdf FILE` writes the calibration into your own URDF" in " ".join(found.notes)


def test_damaged_file_is_refused(made) -> None:
    record = json.loads(calibration_text(made))
    record["urdf"]["text"] = record["urdf"]["text"].replace("0.089159", "0.09")
    with pytest.raises(StudyError, match="its urdf is not that of its robot"):
        parse_calibration(json.dumps(record))
    record["urdf"]["text"] = "<robot"
    with pytest.raises(StudyError, match="its urdf cannot be read: urdf: not valid XML"):
        parse_calibration(json.dumps(record))


def test_command_with_a_file(of_ur5, tmp_path) -> None:
    (tmp_path / "calibration.json").write_text(calibration_text(of_ur5))
    (tmp_path / "mine.urdf").write_text(write_urdf(of_ur5.robot, {"tcp": np.eye(4)}, {}))
    words = ["export", str(tmp_path), "--out", str(tmp_path / "new.urdf"), "--format"]
    mine = ["--urdf", str(tmp_path / "mine.urdf")]
    ran = CliRunner().invoke(run_command_line, [*words, "urdf", *mine, "--tip", "tcp"])
    assert ran.exit_code == 0, ran.output
    assert 'in link "tcp"' in ran.output
    assert without_origins((tmp_path / "new.urdf").read_text()) == without_origins(
        (tmp_path / "mine.urdf").read_text()
    )
    for more, says in ((["dh", *mine], "goes with"), (["urdf", "--tip", "x"], "--urdf FILE")):
        ran = CliRunner().invoke(run_command_line, [*words, *more])
        assert ran.exit_code == 2
        assert says in ran.output
