"""Joint offsets in words: zeros and links that are off, and where to look for the mistake."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .._typing import Array
from ..exceptions import sentence_list
from ..fitting.problem import Problem
from ..robot.kinematics import Robot
from .simple_mistakes import Mistake

# smallest zero [degrees], and length of a link or a slide's zero [mm], that is called a mistake: less
# is an arm's own error, which is calibrated
MIN_DEGREES = 3.0
MIN_MM = 15.0
# range of readings [rad or mm] below which a joint rests
REST_RANGE = 2e-3

CHECK_FILE = "check the robot file"
CHECK_ROBOT = "check the robot file, and whether it describes this robot"


def describe_offsets(problem: Problem, zeros: Array, links: Array) -> Mistake | None:
    """Describe zeros (n,) and links (n, 3) that are off, without those that are too small to be a
    mistake; None where none is left."""
    robot = problem.robot
    wrong = []
    words = []
    for j, zero in enumerate(zeros):
        of_zero = _describe_zero(robot, j, zero)
        if of_zero:
            wrong.append(j)
            words.append(of_zero)
    looks = _list_looks(problem, wrong)
    for j, link in enumerate(links):
        of_link = _describe_link(j, link)
        if of_link:
            words.append(of_link)
    if not words:
        return None
    has_link = len(words) > len(wrong)
    if has_link:
        looks.append(CHECK_ROBOT if len(words) > 1 else CHECK_FILE)
    return Mistake(
        words=" and ".join(words),
        look=", and ".join(looks),
        A=np.eye(robot.n),
        c=zeros,
        B=np.eye(3),
        parts=len(words),
    )


def _describe_zero(robot: Robot, j: int, zero: float) -> str:
    """Describe a joint's zero; empty where it is too small."""
    if robot.prismatic[j]:
        offset = zero
        smallest = MIN_MM
        unit, sign = "mm", " mm"
    else:
        turn = 2 * np.pi
        wrapped = (zero + np.pi) % turn - np.pi
        offset = np.degrees(wrapped)
        smallest = MIN_DEGREES
        unit, sign = "degrees", "°"
    size = abs(offset)
    if size < smallest:
        return ""
    change = "added to" if offset > 0 else "subtracted from"
    return (
        f"joint {j + 1}'s zero is off by {size:.1f} {unit} ({size:.1f}{sign} is {change} q{j + 1})"
    )


def _describe_link(j: int, link: Array) -> str:
    """Describe the lengths of a joint's link; empty where all are too small."""
    far = [
        f"{letter}{j + 1} is off by {length:+.1f} mm"
        for letter, length in zip("abc", link, strict=True)
        if abs(length) >= MIN_MM
    ]
    return f"the nominal arm's {' and '.join(far)}" if far else ""


def _list_looks(problem: Problem, wrong: Sequence[int]) -> list[str]:
    """List where to look for the zeros of joints (counted from 0) that are off."""
    resting = [j for j in wrong if float(np.ptp(problem.data.q[:, j])) < REST_RANGE]
    moving = [j for j in wrong if j not in resting]
    looks = []
    if resting:
        verb = "rests" if len(resting) == 1 else "rest"
        looks.append(
            f"check the readings of {_name_joints(resting)}, which {verb}: 0 may mean that nothing "
            "was recorded"
        )
    if moving:
        verb = "is" if len(moving) == 1 else "are"
        looks.append(
            f"check where {_name_joints(moving)} {verb} zero in the controller and in the robot file"
        )
    return looks


def _name_joints(joints: Sequence[int]) -> str:
    names = [str(j + 1) for j in joints]
    listed = sentence_list(names)
    if len(names) == 1:
        return f"joint {listed}"
    return f"joints {listed}"
