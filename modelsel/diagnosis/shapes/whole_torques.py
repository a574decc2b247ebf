"""The whole load of a joint or a link, of the arm's own weight and of the payload, and where measurements
tell it from that of the payload alone.

The payload must differ from row to row. About a wrist's joint the arm's own weight is next to nothing:
the payload's torque is the whole one there, and has a name already."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from ...fitting.problem import Problem
from ...mechanisms.beams import name_moments
from ...mechanisms.bending import LINK_BENDING
from ...mechanisms.causes import Cause, Named, torque
from ...mechanisms.compliance import PAYLOAD, payload_torque, whole_torque
from ...mechanisms.gravity_effects import list_base_loads
from ...mechanisms.motors import is_coupled, knows_held_masses, motor_torque
from ...mechanisms.terms import Mechanism
from ...robot.gravity import declares_masses_beyond, find_gravity_joints
from ...robot.kinematics import Robot

HELD = Named(PAYLOAD, "kg")
# share of the payload's torque, both by how much they change, from which the arm's own is seen
LEAST_OWN = 0.1


def sees_both_loads(problem: Problem, joint: int) -> bool:
    """Return whether the masses that a drive holds are declared, the payload changes on these rows, and its
    own torque is seen beside that of the payload."""
    robot = problem.robot
    if not knows_held_masses(robot, joint):
        return False
    own = motor_torque(robot, joint)
    held = payload_torque(robot, joint)
    loads = {own: held}
    return _sees_own(problem, loads)


def sees_loads_of(problem: Problem, mechanism: Mechanism) -> bool:
    """Return the same of what a mechanism has yield: a drive, a link or the base."""
    robot = problem.robot
    joint = mechanism.joint
    if joint is None:
        # what turns about the vertical alone has hardly a moment on the base
        first = min(find_gravity_joints(robot), default=1)
        loads = list_base_loads(robot)
        return declares_masses_beyond(robot, first) and _sees_own(problem, loads)
    if mechanism.stem != LINK_BENDING:
        return sees_both_loads(problem, joint)
    frame = joint + 1
    target = robot.n + 1
    moments = name_moments(robot, frame)
    of_one_kg = name_moments(robot, frame, target)
    pairs = {}
    for axis, own in moments.items():
        pairs[own] = HELD * of_one_kg[axis]
    return declares_masses_beyond(robot, frame) and _sees_own(problem, pairs)


def _sees_own(problem: Problem, loads: Mapping[Cause, Cause]) -> bool:
    """Return whether the payload changes on these rows, and of loads of the arm's own masses, which are
    declared, something is seen beside those of the payload."""
    if PAYLOAD not in problem.names():
        return False
    payload = problem.value(PAYLOAD)
    if not np.ptp(payload):
        return False
    own_changes = 0.0
    held_changes = 0.0
    for own, held in loads.items():
        weight = problem.cause(own)
        own_changes += float(np.var(weight))
        load = problem.cause(held)
        held_changes += float(np.var(load))
    least = LEAST_OWN**2 * held_changes
    return bool(own_changes >= least)


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
