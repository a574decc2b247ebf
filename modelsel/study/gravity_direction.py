"""Whether the direction of gravity is known, and whether it can be right where the robot was found to
stand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..fitting.problem import Problem
from ..notices import Note
from ..robot.kinematics import Robot

# from the z axis of the measurements' frame, within which gravity is said to point along it
NEAR_ANGLE = np.radians(10.0)
# of a direction's components: closer to 0 or 1 they are written as these
ROUND = 0.02


def note_gravity(robot: Robot, problem: Problem, is_stated: bool) -> list[Note]:
    """Return the warning about gravity that is not known, or that points upwards in the frame of the
    measurements; of gravity that the study states (`is_stated`) nothing."""
    if robot.gravity is None:
        return [
            Note(
                "gravity-unknown",
                f"The robot file of {robot.name} gives no direction of gravity: mechanisms that need "
                "it are left out. For an upright robot write gravity = [0, 0, -1] under [robot] in "
                "the study file.",
            )
        ]
    upwards = None if is_stated else describe_upward_gravity(robot, problem)
    return [] if upwards is None else [Note("gravity-upwards", upwards)]


def describe_upward_gravity(robot: Robot, problem: Problem) -> str | None:
    """Say that the robot's gravity points along +z of the measurements' frame, in which z usually
    points up; None where it does not. The problem has its placement."""
    if robot.gravity is None:
        return None
    R = problem.placement[0][0]
    direction = R @ np.array(robot.gravity)
    angle = float(np.arccos(np.clip(direction[2], -1.0, 1.0)))
    if angle > NEAR_ANGLE:
        return None
    down = write_direction(-R[2])
    given = write_direction(robot.gravity)
    return (
        f"Gravity is {given} in the robot's base frame, and so points along +z of the measurements' "
        f"frame ({np.degrees(angle):.2g}° from it). If that z axis points up, as it does for a "
        f"levelled instrument, the robot's gravity is {down}: write gravity = {down} under [robot] in "
        f"the study file (modelsel init: --gravity {down.strip('[]').replace(',', '')}). If it points "
        f"down, write gravity = {given} there to confirm it. Mechanisms of weight are wrong otherwise."
    )


def write_direction(direction: Sequence[float] | np.ndarray) -> str:
    """Write a direction as a study file has it: whole numbers where it is along an axis."""
    values = np.asarray(direction, float)
    near = np.abs(values - values.round()) < ROUND
    rounded = np.where(near, values.round(), values.round(3)) if near.all() else values.round(3)
    return f"[{', '.join(f'{value + 0.0:g}' for value in rounded)}]"
