"""Shapes beyond single joints that the registry does not have: a base that gives way with the reach,
a joint that its neighbour pulls.

They are told as what they are, without a cause."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np

from .._typing import Array
from ..fitting.problem import Problem
from ..mechanisms.causes import Applied, Cause, Named, q, shifted
from ..mechanisms.terms import Mechanism
from ..robot.kinematics import Robot
from ..robot.rigid import AXES
from .candidate_kinds import CandidateKind
from .driver_functions import level_off
from .unregistered import Place, Unregistered, build_cell

# powers of the reach, counted in metres: a term is what it does at one metre
POWERS = ("the reach", "the square of the reach", "the cube of the reach")
PER_METRE = 1e-3
# what has such shapes, as far as is known
FEET = ("foundation or base plate that gives way", "column or bearing of joint 1")
PULLS = ("hose or cable that tightens", "spring or balancer between the links")
# axes that are parallel
PARALLEL = 1 - 1e-9
# places in a joint's range beyond which it may pull a neighbour, and readings that each side needs
ONSETS = (0.3, 0.5, 0.7)
MIN_READINGS = 4


def generate_arm_shapes(problem: Problem) -> Iterator[Unregistered]:
    """Generate the shapes that involve more than one joint's own reading.

    A power of the reach at one place weighs as much as a cell; so does a pull of one joint by
    another from one side, wherever it sets in."""
    yield from _generate_reaching(problem.robot)
    yield from _generate_pulled(problem)
    yield from _generate_wound(problem)


def _generate_reaching(robot: Robot) -> Iterator[Unregistered]:
    """Generate powers of the reach from axis 1, at the base and at the column that turns with it."""
    if robot.n < 2 or robot.joints[0].prismatic:
        return
    metres = PER_METRE * Named("reach_mm")
    powers: tuple[Cause, ...] = (metres, metres * metres, metres * metres * metres)
    for place in _list_foot(robot):
        for cause, words in zip(powers, POWERS, strict=True):
            motion = "shifts along" if place[1].startswith("t") else "turns about"
            sentence = f"Frame {place[0]} {motion} its {place[1][1]} axis with {words}"
            cell = replace(build_cell(place, (cause,), words, sentence), usual_causes=FEET)
            yield Unregistered(cell, CandidateKind.REACH, 1.0)


def _list_foot(robot: Robot) -> Iterator[Place]:
    """List the places of frames 1 and 2, but for the shift along axis 1 that both have."""
    yield from ((1, axis) for axis in AXES)
    upright = np.abs(robot.joints[1].before[2, :3]) > PARALLEL
    for number, axis in enumerate(AXES):
        if number > 2 or not upright[number]:
            yield 2, axis


def _generate_pulled(problem: Problem) -> Iterator[Unregistered]:
    """Generate turns of a joint with the square of a neighbour's reading beyond some angle, as a
    hose, a cable or a spring that tightens there has it."""
    robot = problem.robot
    turning = [j for j, joint in enumerate(robot.joints, 1) if not joint.prismatic]
    for joint in turning:
        for other in (joint - 1, joint + 1):
            if other not in turning:
                continue
            onsets = choose_onsets(problem.data.q[:, other - 1], ONSETS)
            for onset in onsets:
                for pull in build_pulls(joint, other, onset):
                    yield Unregistered(pull, CandidateKind.PULL, 1.0)


def choose_onsets(readings: Array, shares: Sequence[float]) -> list[float]:
    """Choose the readings, at some shares of their range, beyond which a joint may pull another one:
    with data on either side."""
    low, high = float(readings.min()), float(readings.max())
    chosen = [float(f"{low + share * (high - low):.4g}") for share in shares]
    fewest = [min((readings < onset).sum(), (readings > onset).sum()) for onset in chosen]
    return [onset for onset, few in zip(chosen, fewest, strict=True) if few >= MIN_READINGS]


def build_pulls(joint: int, other: int, onset: float) -> Iterator[Mechanism]:
    """Build the pulls of a joint by another one above and below a reading of that [rad]."""
    beyond = shifted(q(other), -onset)
    size = Applied("abs", beyond)
    for excess, side in ((size + beyond, "above"), (size - beyond, "below")):
        half = 0.5 * excess
        where = f"{side} {np.degrees(onset):.0f}°"
        sentence = f"Joint {joint} turns with joint {other} where that reads {where}"
        words = f"the square of q{other} {where}"
        cell = build_cell((joint, "rz"), (half * half,), words, sentence)
        yield replace(cell, usual_causes=PULLS)


def _generate_wound(problem: Problem) -> Iterator[Unregistered]:
    """Generate turns of a joint with its own reading, less and less towards both ends of its range,
    and more or less with another joint's, as a hose that both wind up pulls."""
    robot = problem.robot
    turning = [j for j, joint in enumerate(robot.joints, 1) if not joint.prismatic]
    levelling = {j: level_off(problem, f"q{j}") for j in turning}
    for joint, other in permutations(turning, 2):
        own = levelling[joint]
        sentence = (
            f"Joint {joint} turns with its own reading, and more or less so with joint {other}'s"
        )
        words = f"q{joint} and q{other} levelling off"
        cell = build_cell((joint, "rz"), (own, own * levelling[other]), words, sentence)
        yield Unregistered(replace(cell, usual_causes=PULLS), CandidateKind.WOUND, 1.0)
