"""A joint's whole gravity torque, of the arm's own weight and of the payload, and where measurements tell
it from that of the payload alone.

The payload must differ from row to row. About a wrist's joint the arm's own weight is next to nothing:
the payload's torque is the whole one there, and has a name already."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from ..fitting.problem import Problem
from ..mechanisms.causes import Cause, torque
from ..mechanisms.compliance import PAYLOAD, payload_torque, whole_torque
from ..mechanisms.motors import is_coupled, knows_held_masses, motor_torque
from ..robot.kinematics import Robot

# share of the payload's torque, both by how much they change, from which the arm's own is seen
LEAST_OWN = 0.1


def sees_both_loads(problem: Problem, joint: int) -> bool:
    """Return whether the masses that a drive holds are declared, the payload changes on these rows, and its
    own torque is seen beside that of the payload."""
    robot = problem.robot
    known = problem.names()
    if not knows_held_masses(robot, joint) or PAYLOAD not in known:
        return False
    payload = problem.value(PAYLOAD)
    span = np.ptp(payload)
    if not span:
        return False
    own = problem.cause(motor_torque(robot, joint))
    held = problem.cause(payload_torque(robot, joint))
    spread = np.std(own)
    least = LEAST_OWN * np.std(held)
    return bool(spread >= least)


def list_torques(robot: Robot, joint: int) -> tuple[Cause, ...]:
    """List the torques about a joint that something may depend on: of the arm's own weight, and with the
    payload's where no other drive moves the joint."""
    own = torque(joint)
    if is_coupled(robot, joint):
        return (own,)
    return own, whole_torque(robot, joint)


def find_load(robot: Robot, joint: int, names: Collection[str]) -> Cause | None:
    """Find the torque about a joint that has just these names; None where none has."""
    for load in list_torques(robot, joint):
        if load.names() == names:
            return load
    return None
