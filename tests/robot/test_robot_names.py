"""Built-in robots by any spelling; what is close is offered, nothing is guessed."""

from __future__ import annotations

import pytest

from modelsel.exceptions import StudyError
from modelsel.robot.dh import dh_table
from modelsel.robot.files import builtin_names, list_full_names, load_robot
from modelsel.robot.robot_names import find_robot_name


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ("UR10", "ur10"),
        ("ur-10e", "ur10e"),
        ("Universal Robots UR5e", "ur5e"),
        ("Puma 760", "puma760"),
        ("Unimation PUMA-560", "puma560"),
        ("ABB IRB 120", "irb120"),
        ("IRB_1600", "irb1600"),
        ("KUKA LBR iiwa 14 R820", "iiwa14"),
        ("Franka Research 3", "fr3"),
        ("ABB IRB 1600-10/1.45", "irb1600"),
        ("irb 120-3/0.58", "irb120"),
        ("ur10", "ur10"),
    ],
)
def test_any_spelling(given, name) -> None:
    assert load_robot(given).name == name


def test_what_modelsel_robots_prints_is_read() -> None:
    full_names = list_full_names()
    assert full_names.keys() == {"iiwa14", "irb120", "irb1600"}
    for name, full in full_names.items():
        assert load_robot(full).name == name


@pytest.mark.parametrize(
    "given", ["ur", "irb", "puma", "UR16e", "iiwa 7", "", "KUKA", "ABB IRB 1600-6/1.2"]
)
def test_nothing_is_guessed(given) -> None:
    assert find_robot_name(given, builtin_names()) is None
    with pytest.raises(StudyError, match="unknown robot"):
        load_robot(given)


def test_all_that_are_close_are_offered() -> None:
    with pytest.raises(StudyError, match='Did you mean "ur5e", "ur10e" or "ur5"'):
        load_robot("UR15e")
    with pytest.raises(StudyError, match='Did you mean "irb120" or "irb1600"'):
        load_robot("IRB 1200")
    with pytest.raises(StudyError, match=r"Known: fr3, .* takes a file: TOML, URDF, or a table"):
        load_robot("Motoman")


@pytest.mark.parametrize("given", ["KR 10", "KR10 R1100", "Motoman 10"])
def test_a_number_alone_makes_no_other_robot(given) -> None:
    with pytest.raises(StudyError, match=r'unknown robot "[^"]*"\. Known: fr3, '):
        load_robot(given)


def test_limits_of_exported_rows_are_as_people_write_them() -> None:
    """Degrees that went through radians: 120, not 119.99999999999999."""
    robot = load_robot("irb1600")
    written = dh_table(robot, "standard")
    assert [joint["limits_deg"] for joint in written["joint"]][1] == [-90.0, 120.0]
