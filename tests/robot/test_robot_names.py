"""Built-in robots by any spelling; what is close is offered, nothing is guessed."""

from __future__ import annotations

import pytest

from modelsel.exceptions import StudyError
from modelsel.robot.files import builtin_names, load_robot
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
        ("ur10", "ur10"),
    ],
)
def test_any_spelling(given, name) -> None:
    assert load_robot(given).name == name


@pytest.mark.parametrize("given", ["ur", "irb", "puma", "UR16e", "iiwa 7", "", "KUKA"])
def test_nothing_is_guessed(given) -> None:
    assert find_robot_name(given, builtin_names()) is None
    with pytest.raises(StudyError, match="unknown robot"):
        load_robot(given)


def test_all_that_are_close_are_offered() -> None:
    with pytest.raises(StudyError, match='Did you mean "ur5e", "ur10e" or "ur5"'):
        load_robot("UR15e")
    with pytest.raises(StudyError, match=r"Known: fr3, .* takes a file: TOML, URDF, or a table"):
        load_robot("Motoman")
