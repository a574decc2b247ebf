"""Warm-ups with any time constant: once one is found, the data tell its constant better than the four
that are looked for stand apart.

What the nearest of these leaves was found as a drift beside it, or stayed in the errors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from ..._typing import Array
from ...fitting.problem import Problem
from ...mechanisms.terms import Mechanism
from ..shapes.campaign_clocks import (
    WARM_UP_SHARES,
    Clock,
    build_warm_ups,
    choose_clock,
    choose_rest_clock,
)
from ..shapes.distinct_places import Place
from ..shapes.shape_constants import find_time_constant
from ..shapes.unregistered import build_cell

# time constants in shares of the campaign: so near one another that what lies between two of them leaves
# less than a thousandth of its variance
WARM_UPS = tuple(np.geomspace(0.02, 2.0, 41).tolist())
# factor between two of these, into how many finer steps it is parted around a found one, and how many times
# these are parted again: a large warm-up tells its constant to a few thousandths
FACTOR = WARM_UPS[1] / WARM_UPS[0]
FINER = 4
ROUNDS = 3
# largest factor between two that are looked for
APART = max(np.divide(WARM_UP_SHARES[1:], WARM_UP_SHARES[:-1]).tolist())


def generate_finer_warm_ups(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate warm-ups whose constants lie between those of a found one's neighbours. None for any
    other finding."""
    own = find_time_constant(found)
    clock, duration = _choose_clock_of(problem, found)
    if own is None or not duration:
        return
    share = own / duration
    near = [other for other in WARM_UPS if 1 / APART < other / share < APART]
    for depth, step in product(range(1, ROUNDS + 1), range(1, FINER)):
        factor = FACTOR ** (step / FINER**depth)
        near += [share * factor, share / factor]
    (place,) = found.names_by_place()
    for warm_up in _generate(problem, place, sorted(near), (clock, duration)):
        if warm_up != found:
            yield warm_up


def _choose_clock_of(problem: Problem, found: Mechanism) -> Clock:
    """Choose the clock by which a warm-up settles."""
    rested = choose_rest_clock(problem)
    if rested is not None and found.names() == rested[0].names():
        return rested
    return choose_clock(problem)


def fit_warm_up(problem: Problem, place: Place, course: Array) -> Mechanism | None:
    """Fit a warm-up of one place, beside a constant, to a course (m,) in time: its time constant to a few
    thousandths. It may start afresh where the arm stood for long. None where there is no time."""
    clocks = [choose_clock(problem)]
    rested = choose_rest_clock(problem)
    if rested is not None:
        clocks.append(rested)
    fitted = [_fit_by_clock(problem, place, course, clock) for clock in clocks if clock[1]]
    return min(fitted, key=lambda one: _measure_misfit(problem, one, course), default=None)


def _fit_by_clock(problem: Problem, place: Place, course: Array, clock: Clock) -> Mechanism:
    """Fit a warm-up of one place by one clock."""
    shares: Sequence[float] = WARM_UPS
    for digits in range(ROUNDS + 1):
        warm_ups = list(_generate(problem, place, shares, clock))
        misfits = [_measure_misfit(problem, one, course) for one in warm_ups]
        nearest = int(np.argmin(misfits))
        best = warm_ups[nearest]
        step = FACTOR ** (1 / FINER ** (digits + 1))
        shares = [shares[nearest] * step**k for k in range(-FINER, FINER + 1)]
    return best


def _measure_misfit(problem: Problem, warm_up: Mechanism, course: Array) -> float:
    """Measure what a warm-up and a constant leave of a course (m,)."""
    term = warm_up.terms[0]
    cause = term.screws[0].cause
    own = cause.of(problem.state)
    values = np.asarray(own)
    ones = np.ones_like(course)
    columns = np.column_stack([values, ones])
    coefficients, *_ = np.linalg.lstsq(columns, course, rcond=None)
    fitted = columns @ coefficients
    left = course - fitted
    square = left @ left
    return float(square)


def _generate(
    problem: Problem, place: Place, shares: Sequence[float], clock: Clock
) -> Iterator[Mechanism]:
    """Generate the warm-ups of a place by a clock."""
    for cause in build_warm_ups(problem, shares, clock):
        yield build_cell(place, (cause,))
