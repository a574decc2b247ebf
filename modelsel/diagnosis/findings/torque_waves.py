"""Joints whose own gravity torque is a wave once a turn, as that of a level axis behind an upright one is.

What such a joint winds up under its weight goes as an eccentric gear or encoder does, so that one finding has
the sum of both."""

from __future__ import annotations

import numpy as np

from ..._typing import Array
from ...fitting.problem import Problem
from ...mechanisms.bodies import list_main_bodies
from ...mechanisms.causes import Cause, cos, sin
from ...mechanisms.motors import (
    find_gravity_motors,
    knows_held_masses,
    motor_reading,
    motor_torque,
    moved_joints,
)
from ...mechanisms.terms import Mechanism
from ...robot.gravity import G

# what goes once a turn of a joint, and what goes with its torque
WAVE, SPRING = "gear-eccentricity", "joint-compliance"
# share of a torque's changes that no wave once a turn has, up to which it is one: masses are rarely known better
MAX_LEFT = 0.15
# N m: a torque that changes less does not wind a joint up
LEAST_TORQUE = 1e-6 * G


def find_mixed_joint(problem: Problem, mechanism: Mechanism) -> int | None:
    """Find the joint of which a mechanism may be an uneven turning and a wind-up under the arm's own weight
    at once; None where it is neither, or where these rows tell them apart."""
    joint = mechanism.joint
    if joint is None or mechanism.stem not in (WAVE, SPRING):
        return None
    robot = problem.robot
    if joint not in find_gravity_motors(robot):
        return None
    load = motor_torque(robot, joint)
    if mechanism.stem == SPRING and mechanism.names() != load.names():
        return None
    reading = motor_reading(robot, joint)
    own = np.asarray(problem.cause(load))
    for torque in (own, _weigh_main_links(problem, joint)):
        if _is_one_wave(problem, torque, reading):
            return joint
    return None


def _weigh_main_links(problem: Problem, motor: int) -> Array:
    """Weigh the torque (m,) that a motor holds of 1 kg at the end of each main link beyond it, where not all masses
    there are declared: a forearm weighs more than what its wrist has. Nothing where they are."""
    robot = problem.robot
    torque = np.zeros(len(problem))
    if knows_held_masses(robot, motor):
        return torque
    first = min(moved_joints(robot, motor))
    for body in list_main_bodies(robot, first):
        load = motor_torque(robot, motor, body)
        torque += np.asarray(problem.cause(load))
    return torque


def _is_one_wave(problem: Problem, torque: Array, reading: Cause) -> bool:
    """Return whether a torque (m,) that changes is a wave once a turn of a reading."""
    changes = torque - torque.mean()
    largest = np.abs(changes).max()
    if largest <= LEAST_TORQUE:
        return False
    ones = np.ones(len(torque))
    columns = [ones]
    for wave in (sin, cos):
        cause = wave(reading)
        values = problem.cause(cause)
        columns.append(np.asarray(values))
    waves = np.stack(columns, axis=1)
    fitted, *_ = np.linalg.lstsq(waves, changes, rcond=None)
    left = changes - waves @ fitted
    most = MAX_LEFT * np.linalg.norm(changes)
    return bool(np.linalg.norm(left) <= most)
