"""Whether the arm moved on while it was measured, how fast, and which way it went meanwhile."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..._typing import Array, Index
from .motion import Motion
from .rates import average_by_time, derive_rates

# seconds between rows, on average, above which an arm has the time to stop for each
LONGEST_INTERVAL = 10.0
# of the steps from row to row, what the rows around one leave of its readings where a motion goes on
SMOOTH = 0.25
# rows around one that tell it, two before and two after, and times from which that is known
AROUND = np.array([-2, -1, 1, 2])
FEWEST_TIMES = 12


class Speed(NamedTuple):
    """How fast each motor moved (m, n) [rad/s, mm/s], None without a clock; whether the arm was
    measured in a motion that goes on."""

    rate: Array | None
    goes_on: bool


def add_speed(
    motion: Motion, readings: Array, group: Index, time: Array | None
) -> tuple[Motion, Speed]:
    """Derive the speed of the motors from their readings (m, n) and the clock (m,) [s]. The motion
    comes back with the direction in which the arm moved in every row, where it moved on."""
    visit = motion.visit
    rate = derive_rates(readings, group, visit, time)
    still = Speed(rate, False)
    if time is None or rate is None:
        return motion, still
    moves = goes_on(readings, group, time)
    if not moves:
        return motion, still
    directed = _direct(motion, rate)
    speed = Speed(rate, True)
    return directed, speed


def goes_on(readings: Array, group: Index, time: Array) -> bool:
    """Return whether an arm moves on while it is measured: rows follow each other fast, and the rows
    around one tell its readings (m, n)."""
    left = 0.0
    stepped = 0.0
    intervals = [np.zeros(0)]
    for number in np.unique(group):
        is_own = group == number
        own = readings[is_own]
        own_time = time[is_own]
        times, _, means = average_by_time(own, own_time)
        count = len(times)
        if count < FEWEST_TIMES:
            continue
        told = _interpolate(times, means)
        apart = means[2:-2] - told
        steps = np.diff(means, axis=0)
        left += count * _mean_square(apart)
        stepped += count * _mean_square(steps)
        interval = np.diff(times)
        intervals.append(interval)
    between = np.concatenate(intervals)
    if not stepped:
        return False
    typical = float(np.median(between))
    is_fast = typical <= LONGEST_INTERVAL
    most = SMOOTH**2 * stepped
    return is_fast and left <= most


def _mean_square(values: Array) -> float:
    squares = values**2
    mean = squares.mean()
    return float(mean)


def _interpolate(times: Array, values: Array) -> Array:
    """Interpolate values (u, n) at growing times (u,) from those around each, but for two at either
    end: by the polynomial through them (Lagrange)."""
    last = len(times) - 2
    own = np.arange(2, last)
    near = own[:, None] + AROUND
    near_times = times[near]
    own_times = times[own]
    to_own = own_times[:, None] - near_times
    first = near_times[:, :, None]
    second = near_times[:, None, :]
    between = first - second
    count = len(AROUND)
    each = np.arange(count)
    between[:, each, each] = 1.0
    others = np.repeat(to_own[:, None, :], count, axis=1)
    others[:, each, each] = 1.0
    weights = others.prod(axis=2)
    weights /= between.prod(axis=2)
    near_values = values[near]
    told = np.einsum("up,upn->un", weights, near_values)
    return np.asarray(told)


def _direct(motion: Motion, rate: Array) -> Motion:
    """Give rows in which a motor turns back, between the steps before and after, the direction of its
    speed (m, n): it may have turned before the row, which its last step does not tell."""
    path = motion.path
    steps = path.steps
    after = np.zeros_like(steps)
    after[:-1] = steps[1:]
    opens = path.opens
    ends = np.append(opens[1:], True)
    after[ends] = 0.0
    product = steps * after
    turns = product < 0
    rows = motion.on_path
    is_turning = turns[rows]
    is_turning &= rate != 0
    own = np.sign(rate)
    last = motion.approach
    directed = np.where(is_turning, own, last)
    return replace(motion, approach=directed)
