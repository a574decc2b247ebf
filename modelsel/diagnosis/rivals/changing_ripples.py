"""Ripples whose size changes along the turn: two waves of a joint that are two a turn apart may be one
between them, in proportion to the gravity torque about the joint or to where it stands.

A gear's ripple that grows with its load has no tooth of the two numbers that were found."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ...fitting.problem import Problem
from ...mechanisms.causes import Cause, Combined, cos, q, shifted, sin
from ...mechanisms.terms import Mechanism
from ...mechanisms.waves import find_common_wave
from ...robot.gravity import find_gravity_joints
from ..shapes.shape_constants import find_own_wave
from ..shapes.torque_powers import scale_torque
from ..shapes.unregistered import build_cell

# how far apart two waves are, in waves a turn, of which one between them has the sides; and by how much
# less or more those may be that are looked for
APART = 2.0
TOLERANCE = 0.5
# the wave between two a turn and none
ONCE = 1.0
# angles of a half turn at which a ripple may be largest
PHASES = 12
# digits after the point of a number of waves, and of an angle
DIGITS = 3


def list_loaded_ripples(problem: Problem, found: Sequence[Mechanism]) -> list[Mechanism]:
    """List the ripple in proportion to the gravity torque about its joint that two found waves may be
    the sides of; none of any other findings."""
    joint, count = _find_middle(found)
    if not count:
        return []
    return list(_build_loaded(problem, joint, count))


def list_turning_ripples(found: Sequence[Mechanism]) -> list[Mechanism]:
    """List the ripples that two found waves may be the sides of, which are largest at some reading and
    half a turn from it; none of any other findings."""
    joint, count = _find_middle(found)
    if not count:
        return []
    return list(_build_turning(joint, count))


def generate_loaded_ripples(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate the ripple in proportion to the torque beside one whose size changes, and that of one wave a turn
    beside two, its only side that is no constant; none beside any other finding."""
    joint, count = _read_ripple(found)
    if find_own_wave(found) == (joint, APART):
        count = ONCE
    if count:
        yield from _build_loaded(problem, joint, count)


def generate_turning_ripples(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate the ripples that are largest at some reading beside one whose size changes; none beside
    any other finding."""
    joint, count = _read_ripple(found)
    if count:
        yield from _build_turning(joint, count)


def _find_middle(found: Sequence[Mechanism]) -> tuple[int, float]:
    """Find the joint and the number of the wave of which two found ones are the sides; 0 where they are
    none."""
    waves = [find_own_wave(m) for m in found]
    joint, _ = waves[0]
    counts = [count for _, count in waves]
    low = min(counts)
    high = max(counts)
    excess = high - low - APART
    if len(counts) != 2 or not low or abs(excess) > TOLERANCE:
        return joint, 0.0
    middle = 0.5 * (low + high)
    return joint, round(middle, DIGITS)


def _read_ripple(found: Mechanism) -> tuple[int, float]:
    """Read the joint and the number of waves of a ripple whose size changes; 0 of any other finding."""
    places = list(found.names_by_place())
    joint, _ = places[0]
    factors: list[Cause] = []
    sizes: set[Cause] = set()
    for term in found.terms:
        cause = term.screws[0].cause
        if isinstance(cause, Combined) and cause.operator == "*":
            sizes.add(cause.left)
            factors.append(cause.right)
    wave = find_common_wave(factors)
    is_one = places == [(joint, "rz")] and len(found.terms) == len(factors) and len(sizes) == 1
    if wave is None or not is_one or wave[0] != q(joint):
        return joint, 0.0
    _, count = wave
    return joint, count


def _build_loaded(problem: Problem, joint: int, count: float) -> Iterator[Mechanism]:
    """Build a joint's ripple in proportion to the gravity torque about it; none without load."""
    if joint not in find_gravity_joints(problem.robot):
        return
    load = scale_torque(problem, joint)
    if load is not None:
        yield _build_ripple(joint, count, load, "the gravity torque about it")


def _build_turning(joint: int, count: float) -> Iterator[Mechanism]:
    """Build a joint's ripples that are largest at each of some readings, and half a turn from it."""
    angles = np.pi * np.arange(PHASES) / PHASES
    for angle in angles.tolist():
        largest = round(angle, DIGITS)
        size = cos(shifted(q(joint), -largest))
        yield _build_ripple(joint, count, size, str(size))


def _build_ripple(joint: int, count: float, size: Cause, words: str) -> Mechanism:
    """Build a joint's ripple of so many waves a turn, times a size."""
    angle = count * q(joint)
    ripple = (sin(angle), cos(angle))
    waves = f"{count:g} waves a turn"
    return build_cell(
        place=(joint, "rz"),
        causes=tuple(size * wave for wave in ripple),
        words=f"{waves} in proportion to {words}",
        sentence=f"Joint {joint} turns unevenly, {waves}, in proportion to {words}",
    )
