"""Tables of DH parameters as people have them become the arms that they describe."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from builders import drawn
from click.testing import CliRunner

from modelsel.cli.main import run_command_line
from modelsel.exceptions import StudyError
from modelsel.robot.files import load_robot, read_robot
from modelsel.robot.kinematics import Robot, forward
from modelsel.study.tables.robot_tables import read_robot_table

TOOL = np.array([30.0, -20.0, 80.0])
# as Universal Robots publishes it
UR10 = """Kinematics,theta [rad],a [m],d [m],alpha [rad]
Joint 1,0,0,0.1273,π/2
Joint 2,0,-0.612,0,0
Joint 3,0,-0.5723,0,0
Joint 4,0,0,0.163941,π/2
Joint 5,0,0,0.1157,-π/2
Joint 6,0,0,0.0922,0
"""
# as Franka publishes it
PANDA = """Joint;a (m);d (m);alpha (rad);theta (rad)
Joint 1;0;0,333;0;θ1
Joint 2;0;0;-π/2;θ2
Joint 3;0;0,316;π/2;θ3
Joint 4;0,0825;0;π/2;θ4
Joint 5;-0,0825;0,384;-π/2;θ5
Joint 6;0;0;π/2;θ6
Joint 7;0,088;0;π/2;θ7
Flange;0;0,107;0;0
"""


def product(rows: list[list[float]], q: np.ndarray, modified: bool) -> np.ndarray:
    """Positions of the tool by the textbooks' matrices; rows of theta, d, a, alpha [rad, mm]."""
    out = []
    for readings in q:
        T = np.eye(4)
        for (theta, d, a, alpha), reading in zip(rows, readings, strict=True):
            c, s = np.cos(theta + reading), np.sin(theta + reading)
            ca, sa = np.cos(alpha), np.sin(alpha)
            standard = [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d]]
            craig = [[c, -s, 0, a], [s * ca, c * ca, -sa, -d * sa], [s * sa, c * sa, ca, d * ca]]
            T = T @ np.array([*(craig if modified else standard), [0, 0, 0, 1]])
        out.append((T @ [*TOOL, 1])[:3])
    return np.array(out)


def readings(count: int) -> np.ndarray:
    return np.random.default_rng(1).uniform(-2, 2, (9, count))


def write(folder, name: str, text: str):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_robots_takes_the_convention_that_its_message_asks_for(tmp_path) -> None:
    rows = "joint,theta,d,a,alpha\n1,0,100,0,90\n2,0,0,400,0\n3,0,0,300,0\n"
    table = str(write(tmp_path, "dh.csv", rows))
    runner = CliRunner()
    refused = runner.invoke(run_command_line, ["robots", table])
    assert (refused.exit_code, "--dh standard or --dh modified" in refused.output) == (2, True)
    shown = runner.invoke(run_command_line, ["robots", table, "--dh", "modified"])
    assert shown.exit_code == 0, shown.output
    assert "modified DH (Craig), as given" in shown.output


def test_table_of_universal_robots_is_standard(tmp_path) -> None:
    robot, text, said = read_robot_table(write(tmp_path, "ur10.csv", UR10))
    assert said == (
        "ur10.csv is read as standard DH, since by modified DH (Craig) the axes of joints 5 and 6 "
        "would coincide; angles in radians, lengths in m; gravity along -z of its base."
    )
    q, right = readings(6), np.pi / 2
    d, a = [127.3, 0, 0, 163.941, 115.7, 92.2], [0, -612, -572.3, 0, 0, 0]
    rows = [[0, *row] for row in zip(d, a, [right, 0, 0, right, -right, 0], strict=True)]
    np.testing.assert_allclose(forward(robot, q, TOOL), product(rows, q, False), atol=1e-9)
    again = read_robot(write(tmp_path, "robot.toml", text))
    np.testing.assert_allclose(forward(again, q, TOOL), forward(robot, q, TOOL), atol=1e-9)


def test_table_of_franka_is_modified_with_a_flange(tmp_path) -> None:
    robot, text, said = read_robot_table(write(tmp_path, "panda.csv", PANDA))
    assert "panda.csv is read as modified DH (Craig), since by standard DH" in said
    q, right = readings(7), np.pi / 2
    d, a = [333, 0, 316, 0, 384, 0, 0], [0, 0, 0, 82.5, -82.5, 0, 88]
    alpha = [0, -right, right, right, -right, right, right]
    rows = [[0, *row] for row in zip(d, a, alpha, strict=True)]
    flange = [[0, 107, 0, 0]]
    nominal = product(rows + flange, np.column_stack([q, np.zeros(len(q))]), True)
    np.testing.assert_allclose(forward(robot, q, TOOL), nominal, atol=1e-9)
    again = read_robot(write(tmp_path, "robot.toml", text))
    assert (again.n, robot.n) == (7, 7)
    np.testing.assert_allclose(forward(again, q, TOOL), nominal, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "joints"),
    [
        *(("bend", 3), ("Tender", 3), ("wheel", 3), ("end", 2), ("End-Effector", 2)),
        *(("tool0", 2), ("link_ee", 2), ("EE", 2), ("TCP", 2), ("Robot flange", 2)),
    ],
)
def test_last_row_is_a_joint_unless_it_is_called_the_flange(name, joints, tmp_path) -> None:
    header = "joint,theta_deg,d_mm,a_mm,alpha_deg,convention"
    rows = ("base,0,100,0,90", "shoulder,0,0,300,0", f"{name},0,0,250,0")
    lines = [header, *(f"{row},standard" for row in rows)]
    robot, _, said = read_robot_table(write(tmp_path, "arm.csv", "\n".join(lines)))
    assert robot.n == joints
    assert (f'the last row, "{name}", is not a joint' in said) is (joints == 2)


def test_spreadsheet_with_a_row_of_units_and_offsets(tmp_path) -> None:
    table = pd.DataFrame(
        {
            "i": ["", 1, 2, 3],
            "θ offset": ["deg", 0, -90, 5],
            "d": ["mm", 400, 0, 0],
            "a_{i-1}": ["mm", 0, 150, 600],
            "α_{i-1}": ["deg", 0, -90, 0],
            "sense": ["", 1, -1, 1],
        }
    )
    table.to_excel(tmp_path / "arm.xlsx", index=False)
    robot, _, said = read_robot_table(tmp_path / "arm.xlsx")
    assert "modified DH (Craig), as the table says; angles in degrees, lengths in mm" in said
    q = readings(3)
    rows = np.array([[0, 400, 0, 0], [-90, 0, 150, -90], [5, 0, 600, 0]], float)
    rows[:, [0, 3]] = np.radians(rows[:, [0, 3]])
    assert robot.coupling is not None
    angles = robot.coupling.joint_angles(q)
    np.testing.assert_array_equal(angles, q * [1, -1, 1])
    np.testing.assert_allclose(
        forward(robot, angles, TOOL), product(rows.tolist(), q * [1, -1, 1], True), atol=1e-9
    )


AMBIGUOUS = """theta,d,a,alpha
0,400,150,-90
-90,0,600,0
0,0,120,-90
0,640,0,90
0,0,0,-90
0,95,10,5
"""


def test_table_that_leaves_the_convention_open_is_refused_with_both(tmp_path) -> None:
    path = write(tmp_path, "arm.csv", AMBIGUOUS)
    with pytest.raises(StudyError) as refused:
        read_robot_table(path)
    (sentence,) = refused.value.problems
    assert "may be standard DH" in sentence
    assert "or modified DH" in sentence
    assert "--dh standard or --dh modified" in sentence
    q = readings(6)
    rows = np.array([line.split(",") for line in AMBIGUOUS.splitlines()[1:]], float)
    rows[:, [0, 3]] = np.radians(rows[:, [0, 3]])
    for word in ("standard", "modified"):
        robot, _, _ = read_robot_table(path, word)
        expected = product(rows.tolist(), q, word == "modified")
        np.testing.assert_allclose(forward(robot, q, TOOL), expected, atol=1e-9)
    stated = AMBIGUOUS.replace("alpha\n", "alpha,convention\n").replace("90\n", "90,MDH\n")
    stated = stated.replace(",0\n", ",0,MDH\n").replace(",5\n", ",5,MDH\n")
    robot, _, said = read_robot_table(write(tmp_path, "stated.csv", stated))
    assert "as the table says" in said
    np.testing.assert_allclose(forward(robot, q, TOOL), product(rows.tolist(), q, True), atol=1e-9)


def test_columns_in_the_order_of_their_motions(tmp_path) -> None:
    """As RoboDK has them: rx tx tz rz of modified rows, rz tx tz rx of standard ones."""
    columns = {"rz": "theta", "tz": "d", "tx": "a", "rx": "alpha"}
    table = pd.read_csv(write(tmp_path, "arm.csv", AMBIGUOUS))
    q = readings(6)
    rows = table.to_numpy(float)
    rows[:, [0, 3]] = np.radians(rows[:, [0, 3]])
    for order in (["rx", "tx", "tz", "rz"], ["rz", "tx", "tz", "rx"]):
        named = pd.DataFrame({word: table[columns[word]] for word in order})
        named.to_csv(tmp_path / "named.csv", index=False)
        robot, _, said = read_robot_table(tmp_path / "named.csv")
        assert "as the table says" in said
        expected = product(rows.tolist(), q, order[0] == "rx")
        np.testing.assert_allclose(forward(robot, q, TOOL), expected, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("theta,d,a\n0,1,2\n", "no column for alpha was found"),
        ("theta,d,a,alpha\n0,400,0,x\n0,0,300,0\n", '"x" is not a number'),
        ("theta,d,a,alpha\n0,400,0,pi/0\n0,0,300,0\n", '"pi/0" is not a number'),
        ("theta,d,a,alpha\n0,400,0,0.7\n0,0,300,0.1\n", "may be degrees or radians"),
        ("theta,d,a,alpha\n0,400,0,0\n0,0,0,0\n", "would coincide"),
        ("theta,d,a,alpha,type\n0,400,0,90,spiral\n", '"spiral" is not a kind of joint'),
    ],
)
def test_tables_that_are_none_are_refused(tmp_path, text: str, problem: str) -> None:
    with pytest.raises(StudyError, match=problem):
        read_robot_table(write(tmp_path, "arm.csv", text))


def simulated(robot: Robot, rng: np.random.Generator) -> pd.DataFrame:
    data = drawn(robot, rng, 40).data
    columns = {f"A{j + 1}": np.degrees(data.q[:, j]) for j in range(robot.n)}
    points = forward(robot, data.q, TOOL) + rng.normal(0, 0.05, (len(data), 3))
    return pd.DataFrame(columns | dict(zip("XYZ", points.T, strict=True)))


@pytest.mark.slow
def test_init_writes_the_robot_file_and_study_runs_it(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path, "ur.csv", UR10)
    ur10, _, _ = read_robot_table(tmp_path / "ur.csv")
    simulated(ur10, np.random.default_rng(2)).to_csv("day.csv", index=False)

    def run(*words: str):
        return CliRunner().invoke(run_command_line, list(words))

    result = run("init", "day.csv", "--robot", "ur.csv", "--yes")
    assert result.exit_code == 0, result.output
    assert "ur.csv is read as standard DH" in result.output
    assert 'file = "ur.toml"' in (tmp_path / "day" / "study.toml").read_text()
    np.testing.assert_allclose(
        load_robot(tmp_path / "day" / "ur.toml").joints[3].before, ur10.joints[3].before
    )
    mapped = [f"--column=q{k}_deg=A{k}" for k in range(1, 7)]
    mapped += [f"--column={axis.lower()}_mm={axis}" for axis in "XYZ"]
    checked = run("check", "day.csv", "--robot", "ur.csv", *mapped)
    assert checked.exit_code == 0, checked.output
    assert "ur.csv is read as standard DH" in checked.output
    study = (tmp_path / "day" / "study.toml").read_text().replace("ur.toml", "../ur.csv")
    (tmp_path / "day" / "study.toml").write_text(study)
    studied = run("study", "day", "--out", "out", "--no-report", "--no-sampling")
    assert studied.exit_code == 0, studied.output
    refused = run("check", "day.csv", "--robot", "ur10", "--dh", "standard")
    assert refused.exit_code == 2
    assert "--dh says the convention of a table" in refused.output


def test_robots_shows_a_table_and_its_senses(tmp_path) -> None:
    text = UR10.replace("alpha [rad]\n", "alpha [rad],sense\n")
    text = text.replace("π/2\n", "π/2,1\n").replace(",0\n", ",0,-1\n")
    path = write(tmp_path, "ur.csv", text)
    shown = CliRunner().invoke(run_command_line, ["robots", str(path)])
    assert shown.exit_code == 0, shown.output
    assert "ur: 6 joints" in shown.output
    assert "angles of the joints per reading of the motors" in shown.output
    assert "-1.0000" in shown.output.split("motors")[1]


def test_limits_are_the_joints_own(tmp_path) -> None:
    """A joint that counts the other way has its limits the other way; inside, angles are joints'."""
    table = (
        "Axis,theta [deg],d [mm],a [mm],alpha [deg],Direction,Min [deg],Max [deg]\n"
        "A1,0,400,25,-90,-1,-170,160\nA2,0,0,455,0,1,-190,45\nA3,-90,0,35,-90,1,-120,156\n"
    )
    robot, text, said = read_robot_table(write(tmp_path, "arm.csv", table), "standard")
    limits = [np.degrees(joint.limits or (0, 0)).tolist() for joint in robot.joints]
    assert np.allclose(limits, [[-160, 170], [-190, 45], [-120, 156]])
    assert "limits of the joints as the table has them" in said
    assert "limits_deg" in text


@pytest.mark.parametrize(
    ("heads", "column", "expected"),
    [
        (
            "theta_deg,d_rad,a_mm,alpha_deg",
            "d_rad",
            "a length is expected in mm or m, found radians",
        ),
        (
            "theta_deg,d_mm,a_mm,alpha_m",
            "alpha_m",
            "an angle is expected in degrees or radians, found m",
        ),
        (
            "theta_mm,d_mm,a_mm,alpha_deg",
            "theta_mm",
            "an angle is expected in degrees or radians, found mm",
        ),
        ("theta,d,a,alpha\ndeg,deg,mm,deg", "d", "a length is expected in mm or m, found degrees"),
    ],
)
def test_units_of_another_kind_are_refused(tmp_path, heads, column, expected) -> None:
    """A length in radians was read as one in mm, 57 times as long."""
    path = write(tmp_path, "arm.csv", f"{heads}\n0,100,0,90\n0,0,300,0\n0,0,250,0\n")
    with pytest.raises(StudyError, match=f"line 1, column {column}: {expected}"):
        read_robot_table(path, "standard")


def test_limits_the_wrong_way_round_are_refused(tmp_path) -> None:
    table = "theta [deg],d [mm],a [mm],alpha [deg],Lower,Upper\n0,400,25,-90,170,-170\n0,0,455,0,-90,90\n"
    with pytest.raises(StudyError, match="not below the greatest"):
        read_robot_table(write(tmp_path, "arm.csv", table), "standard")
