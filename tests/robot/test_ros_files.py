"""Robot files of ROS: a xacro file, expanded on the command line alone, and the YAML file of
ur_calibration."""

from __future__ import annotations

import shutil
import stat
import sys

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from modelsel.cli.main import run_command_line
from modelsel.exceptions import StudyError
from modelsel.measurements.measurements import build_measurements
from modelsel.robot import xacro_files
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward
from modelsel.robot.urdf import read_urdf_text
from modelsel.robot.xacro_files import expand_xacro
from modelsel.study.simulation import simulate_points

XACRO = """<?xml version="1.0"?>
<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="arm">
  <xacro:arg name="column" default="0.3"/>
  <link name="base_link"/>
  <xacro:macro name="segment" params="n parent z axis">
    <link name="link_${n}"/>
    <joint name="joint_${n}" type="revolute">
      <parent link="${parent}"/><child link="link_${n}"/>
      <origin xyz="0 0 ${z}"/><axis xyz="${axis}"/>
      <limit lower="${-radians(170)}" upper="${radians(170)}" effort="1" velocity="1"/>
    </joint>
  </xacro:macro>
  <xacro:segment n="1" parent="base_link" z="$(arg column)" axis="0 0 1"/>
  <xacro:segment n="2" parent="link_1" z="0.2" axis="0 1 0"/>
  <xacro:segment n="3" parent="link_2" z="0.4" axis="0 1 0"/>
</robot>
"""


def urdf(column: float) -> str:
    """What the file expands to."""
    parts = ['<robot name="arm"><link name="base_link"/>']
    links = ["base_link", "link_1", "link_2", "link_3"]
    for n, (z, axis) in enumerate([(column, "0 0 1"), (0.2, "0 1 0"), (0.4, "0 1 0")], 1):
        parts.append(
            f'<link name="{links[n]}"/><joint name="joint_{n}" type="revolute">'
            f'<parent link="{links[n - 1]}"/><child link="{links[n]}"/><origin xyz="0 0 {z}"/>'
            f'<axis xyz="{axis}"/><limit lower="-2.96706" upper="2.96706" effort="1" velocity="1"/>'
            "</joint>"
        )
    return "".join([*parts, "</robot>"])


@pytest.fixture
def arm(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "arm.urdf.xacro"
    path.write_text(XACRO)
    return path


@pytest.fixture
def program(tmp_path, monkeypatch):
    """Stand-in for ROS' program: it prints its arguments, or what the file expands to."""
    folder = tmp_path / "bin"
    folder.mkdir()
    file = folder / "xacro"
    text = urdf(0.5).replace("<robot ", "<!-- from {0} {1} --><robot ", 1)
    file.write_text(
        f"#!{sys.executable}\nimport sys\nprint('''{text}'''.format(*sys.argv[1:], ''))\n"
    )
    file.chmod(file.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", str(folder), prepend=":")


def place(text: str) -> np.ndarray:
    robot = read_urdf_text(text, "arm.urdf")
    return forward(robot, np.array([[0.3, -0.4, 1.1]]), np.zeros(3))


def campaign(path) -> None:
    """Rows of the arm with a column of 500 mm."""
    rng = np.random.default_rng(2)
    q = rng.uniform(-2, 2, (30, 3))
    at = build_measurements(q, np.zeros((30, 3)))
    robot = read_urdf_text(urdf(0.5), "arm.urdf")
    points = simulate_points(robot, np.array([30.0, 20, 80]), [], at=at, noise_mm=0.05, rng=rng)
    frame = pd.DataFrame(np.degrees(q), columns=["J1", "J2", "J3"])
    frame[["X", "Y", "Z"]] = points[["x_mm", "y_mm", "z_mm"]].to_numpy()
    frame.to_csv(path, index=False)


def test_expanded_by_xacro_itself(arm) -> None:
    pytest.importorskip("xacro")
    expanded = expand_xacro(arm, {"column": "0.5"})
    assert np.allclose(place(expanded), place(urdf(0.5)), atol=1e-9)
    assert np.allclose(place(expand_xacro(arm, {})), place(urdf(0.3)), atol=1e-9)
    assert str(arm.parent) not in expanded
    arm.write_text(XACRO.replace("${z}", "${height}"))
    with pytest.raises(StudyError, match=r"arm\.urdf\.xacro: xacro says: .*height"):
        expand_xacro(arm, {})


def test_the_program_is_run_with_the_arguments(arm, program) -> None:
    assert f"from {arm.name} column:=0.5" in expand_xacro(arm, {"column": "0.5"})


def test_init_writes_the_urdf_that_a_study_runs(arm, program, tmp_path) -> None:
    campaign(tmp_path / "m.csv")
    words = ["init", "m.csv", "--robot", arm.name, "--xacro", "column:=0.5", "--yes"]
    ran = CliRunner().invoke(run_command_line, words)
    assert ran.exit_code == 0, ran.output
    written = tmp_path / "m" / "arm.urdf"
    assert np.allclose(place(written.read_text()), place(urdf(0.5)), atol=1e-9)
    assert 'file = "arm.urdf"' in (tmp_path / "m" / "study.toml").read_text()
    dry = CliRunner().invoke(run_command_line, ["study", "m", "--dry-run"])
    assert dry.exit_code == 0, dry.output
    check = CliRunner().invoke(
        run_command_line,
        ["check", "m/m.csv", "--robot", arm.name]
        + [f"--column=q{k}_deg=J{k}" for k in (1, 2, 3)]
        + [f"--column={a}_mm={a.upper()}" for a in "xyz"],
    )
    assert check.exit_code == 0, check.output


def test_a_study_file_never_runs_one(arm, program) -> None:
    with pytest.raises(StudyError, match="a program that makes a URDF: modelsel init and check"):
        load_robot(arm)


def test_without_xacro_it_is_explained(arm, monkeypatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setattr(xacro_files, "find_spec", lambda name: None)
    with pytest.raises(
        StudyError, match=r"xacro is not installed\. .*pip install xacro, or expand"
    ):
        expand_xacro(arm, {})


def test_arguments_go_with_a_xacro_file() -> None:
    ran = CliRunner().invoke(
        run_command_line, ["check", "m.csv", "--robot", "ur5", "--xacro", "a:=1"]
    )
    assert (ran.exit_code, "FILE.xacro" in ran.stderr) == (2, True)
    ran = CliRunner().invoke(
        run_command_line, ["check", "m.csv", "--robot", "ur5", "--xacro", "a=1"]
    )
    assert (ran.exit_code, "not name:=value" in ran.stderr) == (2, True)


# -- ur_calibration
# --------------------------------------------------------------------------------------------

# the nominal chain in the form of ur_calibration, from the DH parameters of the maker's page
UR10E = {
    "shoulder": (0, 0, 0.1807, 0, 0, 0),
    "upper_arm": (0, 0, 0, np.pi / 2, 0, 0),
    "forearm": (-0.6127, 0, 0, 0, 0, 0),
    "wrist_1": (-0.57155, 0, 0.17415, 0, 0, 0),
    "wrist_2": (0, -0.11985, 0, np.pi / 2, 0, 0),
    "wrist_3": (0, 0.11655, 0, np.pi / 2, np.pi, np.pi),
}


def kinematics(change: str = "", to: str = "") -> str:
    lines = ["kinematics:"]
    for link, values in UR10E.items():
        lines.append(f"  {link}:")
        keys = ("x", "y", "z", "roll", "pitch", "yaw")
        lines += [f"    {key}: {value!r}" for key, value in zip(keys, values, strict=True)]
    return "\n".join([*lines, "  hash: calib_123", ""]).replace(change, to, 1)


def test_ur_calibration_of_the_nominal_arm_is_the_nominal_arm(tmp_path) -> None:
    pytest.importorskip("yaml")
    path = tmp_path / "ur10e_calibration.yaml"
    path.write_text(kinematics())
    robot = load_robot(path)
    assert (robot.name, robot.n) == ("ur10e_calibration", 6)
    assert "calib_123" in robot.source
    q = np.random.default_rng(1).uniform(-3, 3, (50, 6))
    tool = np.array([40.0, -25, 120])
    assert np.allclose(forward(robot, q, tool), forward(load_robot("ur10e"), q, tool), atol=1e-6)


def test_numbers_that_yaml_takes_for_words(tmp_path) -> None:
    pytest.importorskip("yaml")
    path = tmp_path / "c.yaml"
    path.write_text(kinematics("y: 0", "y: 1e-05"))
    assert load_robot(path).joints[0].before[1, 3] == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (kinematics("  forearm:", "  underarm:"), "kinematics.forearm is missing"),
        (kinematics("0.1807", "high"), "kinematics.shoulder.z: a number is expected"),
        (kinematics("kinematics:", "links:"), "no table kinematics"),
        ("a: [", "not valid YAML"),
        ("- 1\n", "a table kinematics is expected"),
    ],
)
def test_what_is_wrong_is_told(text, said, tmp_path) -> None:
    pytest.importorskip("yaml")
    path = tmp_path / "c.yaml"
    path.write_text(text)
    with pytest.raises(StudyError, match=f"c.yaml: .*{said}"):
        load_robot(path)


def test_a_misspelt_argument_is_refused_with_the_names_there_are(arm, program) -> None:
    with pytest.raises(StudyError, match=r"colum:=.* no such argument.*Its arguments: column\."):
        expand_xacro(arm, {"colum": "0.5"})
    arm.write_text(
        XACRO.replace("<xacro:arg", '<xacro:include filename="$(find x)/a.xacro"/><xacro:arg')
    )
    assert expand_xacro(arm, {"elsewhere": "1"})


@pytest.mark.integration
def test_init_says_how_a_xacro_file_was_expanded(arm, program, tmp_path) -> None:
    campaign(tmp_path / "m.csv")
    words = ["init", "m.csv", "--robot", arm.name, "--yes"]
    ran = CliRunner().invoke(run_command_line, words)
    assert ran.exit_code == 0, ran.output
    assert "arm.urdf.xacro was expanded by xacro, with column:=0.3 (default)." in ran.stdout
    assert "The chain goes from base_link to link_3: 3 joints; no masses were read." in ran.stdout
    study = tmp_path / "m" / "study.toml"
    study.write_text(study.read_text() + '\n[model]\ncandidates = ["encoder-scale"]\n')
    words = ["study", "m", "--no-sampling", "--no-report", "--quiet", "--out", "r"]
    assert CliRunner().invoke(run_command_line, words).exit_code == 0
    words = ["export", "r", "--format", "urdf", "--urdf", arm.name, "--out", "o.urdf"]
    ran = CliRunner().invoke(run_command_line, words)
    assert ran.exit_code == 0, ran.output
    assert "arm.urdf.xacro was expanded by xacro, with column:=0.3 (default)." in ran.stdout
    assert "<robot" in (tmp_path / "o.urdf").read_text()
