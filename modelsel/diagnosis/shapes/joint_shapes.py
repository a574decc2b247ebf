"""Shapes of single joints that the registry does not have, at the joint's own motion.

An error of its own angle that grows along the campaign, a jump at one angle, a ramp or a bump, a compliance that is
not in proportion to the torque, a pattern that repeats on a turn. They are told as what they are, without a cause."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np

from ..._typing import Array
from ...fitting.problem import Problem
from ...mechanisms.causes import Applied, Cause, Named, cos, q, shifted, sign, sin
from ...mechanisms.drives import RIPPLING_PARTS
from ...mechanisms.motors import joint_axis
from ...mechanisms.terms import Mechanism
from ...robot.gravity import find_gravity_joints
from ...robot.kinematics import Robot
from .candidate_kinds import CandidateKind
from .driver_functions import STILL
from .joint_bumps import describe_reading, generate_likely_bumps
from .torque_powers import SQUARE, build_powers
from .unregistered import Causes, Unregistered, build_cell
from .whole_torques import list_torques, sees_both_loads

# angles at which a jump is looked for, and readings that each side needs
JUMPS = 96
MIN_READINGS = 4
# angles about which a ramp is looked for, and its widths as shares of the joint's range
RAMPS = 24
WIDTHS = (0.125, 0.25, 0.5)
# repetitions a turn of a pattern that is no single wave, and its harmonics
PERIODS = tuple(range(2, 21))
HARMONICS = 3


def generate_joint_shapes(problem: Problem) -> Iterator[Unregistered]:
    """Generate the shapes of every joint; each kind of a joint weighs as much as a cell."""
    yield from _generate_growing(problem)
    yield from _generate_jumps(problem)
    yield from _generate_ramps(problem)
    for bump, count in generate_likely_bumps(problem):
        yield Unregistered(bump, CandidateKind.BUMP, 1 / count)
    yield from _generate_powers(problem)
    yield from _generate_periods(problem.robot)


def _generate_growing(problem: Problem) -> Iterator[Unregistered]:
    """Generate functions of a joint's own reading that grow along the campaign."""
    robot = problem.robot
    progress = Named("progress")
    for j in range(1, robot.n + 1):
        reading = q(j, robot.unit(j))
        every: list[Causes] = [(progress * reading,)]
        if not robot.joints[j - 1].prismatic:
            every.append((progress * sin(reading), progress * cos(reading)))
        sentence = (
            f"Joint {j} is off its reading, depending on it, and more so as the campaign goes on"
        )
        for causes in every:
            yield Unregistered(_build(robot, j, causes, sentence), CandidateKind.GROWTH, 1.0)


def _generate_jumps(problem: Problem) -> Iterator[Unregistered]:
    robot = problem.robot
    for j, joint in enumerate(robot.joints, 1):
        places = _choose_places(problem.data.q[:, j - 1], JUMPS)
        for place in places:
            jump = sign(shifted(q(j, robot.unit(j)), -float(place)))
            where = describe_reading(joint, float(place))
            mechanism = _build(robot, j, (jump,), f"Joint {j} jumps where it reads about {where}")
            yield Unregistered(mechanism, CandidateKind.JUMP, 1 / len(places))


def _generate_ramps(problem: Problem) -> Iterator[Unregistered]:
    """Generate steps that a joint takes over a part of its range: what a jump is at one angle."""
    robot = problem.robot
    for j, joint in enumerate(robot.joints, 1):
        readings = problem.data.q[:, j - 1]
        travel = np.ptp(readings)
        places = _choose_places(readings, RAMPS)
        weight = 1 / max(len(places) * len(WIDTHS), 1)
        own = q(j, robot.unit(j))
        for place, share in product(places, WIDTHS):
            half = 0.5 * share * travel
            low, high = (float(f"{end:.6g}") for end in (place - half, place + half))
            ramp = Applied("abs", shifted(own, -low)) - Applied("abs", shifted(own, -high))
            begin = describe_reading(joint, low)
            end = describe_reading(joint, high)
            sentence = (
                f"Joint {j} errs by one amount where it reads less than {begin}, by another where "
                f"it reads more than {end}, and changes evenly between"
            )
            mechanism = _build(robot, j, (ramp,), sentence)
            yield Unregistered(mechanism, CandidateKind.RAMP, weight)


def _choose_places(readings: Array, most: int) -> Array:
    """Choose at most so many readings at which something may set in, between those that were
    measured."""
    if np.ptp(readings) <= STILL:
        return np.zeros(0)
    distinct = np.unique(readings)
    between = 0.5 * (distinct[1:] + distinct[:-1])
    between = between[MIN_READINGS - 1 : len(between) - MIN_READINGS + 1]
    count = min(most, len(between))
    chosen = np.linspace(0, max(len(between) - 1, 0), count).round().astype(np.intp)
    return np.array([float(f"{place:.6g}") for place in between[chosen]])


def _generate_powers(problem: Problem) -> Iterator[Unregistered]:
    for j in find_gravity_joints(problem.robot):
        loads = list_torques(problem.robot, j)
        seen = len(loads) if sees_both_loads(problem, j) else 1
        for load in loads[:seen]:
            powers = build_powers(problem, j, load)
            if not powers:
                continue
            square = powers[SQUARE]
            yield Unregistered(square, CandidateKind.POWER, 1.0)


def _generate_periods(robot: Robot) -> Iterator[Unregistered]:
    """Generate patterns that repeat a whole number of times a turn: three harmonics, any phases."""
    weight = 1 / len(PERIODS)
    for j, joint in enumerate(robot.joints, 1):
        if joint.prismatic:
            continue
        for count in PERIODS:
            causes = _list_harmonics(j, count)
            often = f"repeats {count} times a turn"
            sentence = f"Joint {j} turns unevenly, in a pattern that {often}"
            mechanism = _build(robot, j, causes, sentence)
            mechanism = replace(mechanism, usual_causes=RIPPLING_PARTS)
            yield Unregistered(mechanism, CandidateKind.PERIOD, weight)


def _list_harmonics(joint: int, count: int) -> Causes:
    causes: list[Cause] = []
    for harmonic in range(1, HARMONICS + 1):
        waves = float(harmonic * count)
        angle = waves * q(joint)
        causes += [sin(angle), cos(angle)]
    return tuple(causes)


def _build(robot: Robot, joint: int, causes: Causes, sentence: str) -> Mechanism:
    """Build a mechanism of a joint's own motion."""
    return build_cell((joint, joint_axis(robot, joint)), causes, sentence=sentence)
