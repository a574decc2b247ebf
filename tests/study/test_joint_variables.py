"""Tables of DH parameters with the joints' own variables, footnotes and titles, as makers write them."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from modelsel.exceptions import StudyError
from modelsel.robot.kinematics import forward
from modelsel.robot.rigid import rotation_matrix, transform
from modelsel.study.tables.robot_tables import read_robot_table

TOOL = np.array([30.0, -20.0, 80.0])
KUKA = """KR 6 Parameter (klassisch)
Achse;theta;d [mm];a [mm];alpha [°]
1;A1;-400;25;90
2;{second};0;455;0
3;A3 - 90°;0;35;90
4;90+A4;-420;0;-90
5;A5;0;0;90
6;A6 + 180°;-80;0;180

Basis ($ROBROOT): Drehung 180° um X, z0 nach unten
"""
# theta at reading 0, d, a, alpha
ROWS = [
    (0, -400, 25, 90),
    (0, 0, 455, 0),
    (-90, 0, 35, 90),
    (90, -420, 0, -90),
    (0, 0, 0, 90),
    (180, -80, 0, 180),
]


def multiply(angles: np.ndarray) -> np.ndarray:
    """Multiply Rz(θ) Tz(d) Tx(a) Rx(α) row by row; `angles` (6,) [deg]."""
    T = np.eye(4)
    for (theta, d, a, alpha), angle in zip(ROWS, angles, strict=True):
        T = T @ transform(rotation_matrix(2, np.radians(theta + angle)), (0, 0, d))
        T = T @ transform(rotation_matrix(0, np.radians(alpha)), (a, 0, 0))
    return (T @ [*TOOL, 1])[:3]


@pytest.mark.parametrize(("second", "sign"), [("A2", 1), ("-A2", -1), ("0", 1)])
def test_the_joints_variables_are_their_readings(tmp_path, second: str, sign: int) -> None:
    path = tmp_path / "kr6.csv"
    path.write_bytes(KUKA.format(second=second).encode("cp1252"))
    robot, _, said = read_robot_table(path)
    assert "A1 to A6 are the joints' own readings" in said
    assert ("joint 2 counts the other way" in said) == (sign < 0)
    assert 'line 10 is a remark ("Basis ($ROBROOT): Drehung 180° um X, z0 nach unten")' in said
    assert "not used" not in said
    readings = np.array([10.0, -70, 50, 20, 35, -110])
    angles = np.radians(readings * [1, sign, 1, 1, 1, 1])[None]
    assert (robot.coupling is not None) == (sign < 0)
    if robot.coupling is not None:
        np.testing.assert_allclose(robot.coupling.joint_angles(np.radians(readings))[None], angles)
    expected = multiply(np.degrees(angles[0]))
    np.testing.assert_allclose(forward(robot, angles, TOOL)[0], expected, atol=1e-9)


def test_a_footnote_of_a_spreadsheet_is_no_joint(tmp_path) -> None:
    table = pd.DataFrame(
        {
            "Achse": [1, 2, "Winkel bei Stellung null"],
            "theta": ["J1", "J2", None],
            "d [mm]": [400, 10, None],
            "a [mm]": [25, 455, None],
            "alpha [deg]": [90, 0, None],
        }
    )
    table.to_excel(tmp_path / "arm.xlsx", index=False)
    robot, _, said = read_robot_table(tmp_path / "arm.xlsx", "standard")
    assert robot.n == 2
    assert 'row 4 is a remark ("Winkel bei Stellung null").' in said


@pytest.mark.parametrize(
    ("second", "third", "problem"),
    [
        ("A2", "A2 + A3", "holds several joints' variables"),
        ("A3", "A2", "line 4: A3 stands in the row of joint 2"),
        ("A2x", "A3", '"A2x" is not a number'),
    ],
)
def test_variables_of_other_joints_are_refused(tmp_path, second, third, problem) -> None:
    path = tmp_path / "kr6.csv"
    text = KUKA.format(second=second).replace("A3 - 90°", third)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(StudyError, match=problem):
        read_robot_table(path)


def test_a_symbol_for_a_length_is_refused(tmp_path) -> None:
    """A variable is a joint's in theta and d alone: of a link's length the number is missing."""
    path = tmp_path / "kr6.csv"
    path.write_text(KUKA.format(second="A2").replace("455", "a2"), encoding="utf-8")
    with pytest.raises(StudyError, match='"a2" is not a number'):
        read_robot_table(path)
