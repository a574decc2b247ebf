"""Waves between those that are looked for: once one is found, the data tell its number better than the
offered ones stand apart.

A wave of the nearest number leaves a part of the effect at the ends of the range. That part was found
as a second wave beside it, or as a joint that does not repeat."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...fitting.problem import Problem
from ...mechanisms.drives import WAVES
from ...mechanisms.terms import Mechanism
from ..shapes.shape_constants import find_own_wave
from ..shapes.slide_waves import PITCHES, build_pitch_wave
from ..shapes.unregistered import QUARTER, build_wave

# how far apart the offered waves of a slide stand, over its travel
EIGHTH = PITCHES[1] - PITCHES[0]
# rad by which neighbouring waves come apart over the measured range
APART = 0.125
# digits after the point of a number of waves
DIGITS = 3


def generate_finer_waves(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate waves of a joint whose numbers lie between those of a found one's neighbours.

    None for any other finding."""
    joint, count = find_own_wave(found)
    _, axis = next(iter(found.names_by_place()))
    if not count or len(found.terms) > 2:
        return
    column = joint - 1
    robot = problem.robot
    own = robot.joints[column]
    readings = problem.data.q[:, column]
    width = float(np.ptp(readings))
    if own.prismatic:
        turn = 2 * np.pi
        over_travel = count * width / turn
        for number in _choose_numbers(over_travel, EIGHTH, turn):
            yield build_pitch_wave(joint, number, width, axis)
        return
    if count < WAVES[0]:
        return
    for number in _choose_numbers(count, QUARTER, width):
        yield build_wave(joint, number)


def _choose_numbers(own: float, spacing: float, width: float) -> Iterator[float]:
    """Choose numbers of waves less than a spacing from one; waves that are one apart differ by
    `width` [rad] over the range."""
    if not width:
        return
    step = APART / width
    nearer = np.ceil(spacing / step) - 1
    steps = int(nearer)
    for k in range(-steps, steps + 1):
        number = own + k * step
        rounded = round(number, DIGITS)
        if k and rounded > 0:
            yield rounded
