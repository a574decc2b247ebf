"""Whether the arm moved on while it was measured, how fast, and which way it went meanwhile."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .._typing import Array, Index
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
    rate = derive_rates(readings, group, motion.visit, time)
    if time is None or rate is None or not goes_on(readings, group, time):
        return motion, Speed(rate, False)
    return _direct(motion, rate), Speed(rate, True)


def goes_on(readings: Array, group: Index, time: Array) -> bool:
    """Return whether an arm moves on while it is measured: rows follow each other fast, and the rows
    around one tell its readings (m, n)."""
    left = 0.0
    stepped = 0.0
    intervals = [np.zeros(0)]
    for number in np.unique(group):
        is_own = group == number
        times, _, means = average_by_time(readings[is_own], time[is_own])
        if len(times) < FEWEST_TIMES:
            continue
        apart = means[2:-2] - _interpolate(times, means)
        steps = np.diff(means, axis=0)
        left += float(np.mean(apart**2)) * len(times)
        stepped += float(np.mean(steps**2)) * len(times)
        intervals.append(np.diff(times))
    between = np.concatenate(intervals)
    if not len(between) or not stepped:
        return False
    is_fast = bool(np.median(between) <= LONGEST_INTERVAL)
    return is_fast and left <= SMOOTH**2 * stepped


def _interpolate(times: Array, values: Array) -> Array:
    """Interpolate values (u, n) at growing times (u,) from those around each, but for two at either
    end: by the polynomial through them (Lagrange)."""
    own = np.arange(2, len(times) - 2)
    near = own[:, None] + AROUND
    near_times = times[near]
    to_own = times[own, None] - near_times
    between = near_times[:, :, None] - near_times[:, None, :]
    count = len(AROUND)
    each = np.arange(count)
    between[:, each, each] = 1.0
    others = np.repeat(to_own[:, None, :], count, axis=1)
    others[:, each, each] = 1.0
    weights = others.prod(axis=2) / between.prod(axis=2)
    near_values = values[near]
    return np.asarray(np.einsum("up,upn->un", weights, near_values))


def _direct(motion: Motion, rate: Array) -> Motion:
    """Give rows in which a motor turns back, between the steps before and after, the direction of its
    speed (m, n): it may have turned before the row, which its last step does not tell."""
    path = motion.path
    steps = path.steps
    after = np.zeros_like(steps)
    after[:-1] = steps[1:]
    ends = np.append(path.opens[1:], True)
    after[ends] = 0.0
    turns = steps * after < 0
    is_turning = turns[motion.on_path] & (rate != 0)
    directed = np.where(is_turning, np.sign(rate), motion.approach)
    return replace(motion, approach=directed)
