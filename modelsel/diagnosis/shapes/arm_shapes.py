"""Shapes beyond single joints that the registry does not have: a base that gives way with the reach,
a joint that its neighbour pulls.

They are told as what they are, without a cause."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations, permutations, product

import numpy as np

from ..._typing import Array
from ...fitting.problem import Problem
from ...mechanisms.causes import Applied, Cause, Named, q, shifted
from ...mechanisms.terms import Mechanism, describe_frame_motion
from ...robot.kinematics import Robot
from ...robot.rigid import AXES
from .candidate_kinds import CandidateKind
from .distinct_places import Place
from .driver_functions import STILL, level_off
from .unregistered import Unregistered, build_cell

# joints of an arm
FEWEST_JOINTS = 3
# the reach is counted in metres: a term is what it does at one metre
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
    another from one side that sets in at one angle. None for fewer than three joints: a table that
    turns and tilts does not reach out."""
    robot = problem.robot
    if robot.n < FEWEST_JOINTS:
        return
    yield from _generate_reaching(robot)
    yield from _generate_pulled(problem)
    yield from _generate_wound(problem)
    yield from _generate_products(problem)


def _generate_reaching(robot: Robot) -> Iterator[Unregistered]:
    """Generate powers of the reach from axis 1, at the base and at the column that turns with it."""
    if robot.joints[0].prismatic:
        return
    metres = PER_METRE * Named("reach_mm")
    square = metres * metres
    cube = square * metres
    powers = (
        (metres, "the reach"),
        (square, "the square of the reach"),
        (cube, "the cube of the reach"),
    )
    for frame, axis in _list_foot(robot):
        moves = describe_frame_motion(frame, axis)
        for cause, words in powers:
            cell = build_cell(
                place=(frame, axis), causes=(cause,), words=words, sentence=f"{moves} with {words}"
            )
            told = replace(cell, usual_causes=FEET)
            yield Unregistered(told, CandidateKind.REACH, weight=1.0)


def _list_foot(robot: Robot) -> Iterator[Place]:
    """List the places of frames 1 and 2, but for the shift along axis 1 that both have."""
    for axis in AXES:
        yield 1, axis
    second = robot.joints[1].before
    # the direction of axis 1 in frame 2
    direction = second[2, :3]
    for number, axis in enumerate(AXES):
        shifts = number < len(direction)
        if shifts and abs(direction[number]) > PARALLEL:
            continue
        yield 2, axis


def _generate_pulled(problem: Problem) -> Iterator[Unregistered]:
    """Generate turns of a joint with the square of a neighbour's reading beyond some angle, as a
    hose, a cable or a spring that tightens there has it."""
    turning = list_turning(problem.robot)
    neighbours = [
        (joint, other) for joint, other in permutations(turning, 2) if abs(joint - other) == 1
    ]
    for joint, other in neighbours:
        readings = problem.data.q[:, other - 1]
        for onset in choose_onsets(readings, ONSETS):
            for pull in build_pulls(joint, other, onset):
                yield Unregistered(pull, CandidateKind.PULL, weight=1.0)


def list_turning(robot: Robot) -> list[int]:
    """List the joints that turn."""
    turning = []
    for number, joint in enumerate(robot.joints, 1):
        if not joint.prismatic:
            turning.append(number)
    return turning


def choose_onsets(readings: Array, shares: Sequence[float]) -> list[float]:
    """Choose the readings, at some shares of their range, beyond which a joint may pull another one:
    with data on either side."""
    low = float(readings.min())
    width = float(np.ptp(readings))
    chosen: list[float] = []
    if width <= STILL:
        return chosen
    for share in shares:
        middle = low + share * width
        rounded = f"{middle:.4g}"
        onset = float(rounded)
        below = (readings < onset).sum()
        above = (readings > onset).sum()
        if min(below, above) >= MIN_READINGS:
            chosen.append(onset)
    return chosen


def find_turning_reading(robot: Robot, found: Mechanism) -> tuple[int, int] | None:
    """Find the joint that a finding turns off its reading, and the joint by whose reading alone, its own or
    another's; None of any other finding."""
    places = list(found.names_by_place())
    drivers = list(found.names())
    if len(places) != 1 or len(drivers) != 1:
        return None
    joint, axis = places[0]
    turning = list_turning(robot)
    if axis != "rz" or joint not in turning:
        return None
    for other in turning:
        if drivers == [f"q{other}"]:
            return joint, other
    return None


def build_excesses(joint: int, onset: float) -> dict[str, Cause]:
    """Build how far a joint's reading is above an angle [rad], and how far below it."""
    beyond = shifted(q(joint), -onset)
    size = Applied("abs", beyond)
    return {"above": 0.5 * (size + beyond), "below": 0.5 * (size - beyond)}


def build_pulls(joint: int, other: int, onset: float) -> Iterator[Mechanism]:
    """Build the pulls of a joint by another one above and below a reading of that [rad]."""
    degrees = np.degrees(onset)
    for side, excess in build_excesses(other, onset).items():
        square = excess * excess
        where = f"{side} {degrees:.0f}°"
        cell = build_cell(
            place=(joint, "rz"),
            causes=(square,),
            words=f"the square of q{other} {where}",
            sentence=f"Joint {joint} turns with joint {other} where that reads {where}",
        )
        yield replace(cell, usual_causes=PULLS)


def _generate_wound(problem: Problem) -> Iterator[Unregistered]:
    """Generate turns of a joint with its own reading, less and less towards both ends of its range,
    and more or less with another joint's, as a hose that both wind up pulls."""
    moving = _list_moving(problem)
    levelling = {j: level_off(problem, f"q{j}") for j in moving}
    for joint, other in permutations(moving, 2):
        own = levelling[joint]
        both = own * levelling[other]
        begin = f"Joint {joint} turns with its own reading"
        cell = build_cell(
            place=(joint, "rz"),
            causes=(own, both),
            words=f"q{joint} and q{other} levelling off",
            sentence=f"{begin}, and more or less so with joint {other}'s",
        )
        told = replace(cell, usual_causes=PULLS)
        yield Unregistered(told, CandidateKind.WOUND, weight=1.0)


def _generate_products(problem: Problem) -> Iterator[Unregistered]:
    """Generate turns of a joint with the product of two joints' readings, wherever these count as
    zero: with either reading by itself, too.

    All pairs at a joint weigh as much together as the single readings."""
    moving = _list_moving(problem)
    weight = 2 / max(len(moving) - 1, 1)
    for joint, pair in product(list_turning(problem.robot), combinations(moving, 2)):
        first, second = pair
        one, other = q(first), q(second)
        both = f"the product of joint {first}'s and joint {second}'s readings"
        cell = build_cell(
            place=(joint, "rz"),
            causes=(one * other, one, other),
            words=f"q{first} times q{second}",
            sentence=f"Joint {joint} turns with {both}",
        )
        yield Unregistered(cell, CandidateKind.PRODUCT, weight)


def find_still_readings(problem: Problem) -> frozenset[str]:
    """Find the names of the joints' readings that stayed the same in the campaign: "q4"."""
    widths = np.ptp(problem.data.q, axis=0)
    return frozenset(f"q{j}" for j, width in enumerate(widths.tolist(), 1) if width <= STILL)


def _list_moving(problem: Problem) -> list[int]:
    """List the turning joints that did not stand still in the campaign."""
    still = find_still_readings(problem)
    return [j for j in list_turning(problem.robot) if f"q{j}" not in still]
