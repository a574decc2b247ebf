"""Whether the arm moved on while it was measured, how fast, and which way it went meanwhile."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..._typing import Array, Index, Mask
from .motion import Motion
from .rates import Runs, average_by_time, derive_rates, find_runs

# seconds between rows, on average, above which an arm has the time to stop for each
LONGEST_INTERVAL = 10.0
# of the steps from row to row, what the rows around one leave of its readings where a motion goes on
SMOOTH = 0.25
# rows around one that tell it, up to two before and two after, and times from which that is known
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
    moving = rate.any(axis=1)  # a visit that lasts is no motion, though readings creep in it
    moves = goes_on(readings[moving], group[moving], time[moving])
    if not moves:
        return motion, still
    directed = _direct(motion, rate)
    speed = Speed(rate, True)
    return directed, speed


def goes_on(readings: Array, group: Index, time: Array) -> bool:
    """Return whether an arm moves on while it is measured: rows follow each other fast, and the rows
    around one tell its readings (m, n). What lies beyond a pause tells nothing."""
    apart = [np.zeros(0)]
    steps = [np.zeros(0)]
    intervals = [np.zeros(0)]
    counted = 0
    for number in np.unique(group):
        is_own = group == number
        own = readings[is_own]
        own_time = time[is_own]
        times, _, means = average_by_time(own, own_time)
        runs = find_runs(times)
        told, is_told = _interpolate(times, means, runs)
        off = means - told
        apart.append(off[is_told].ravel())
        is_long = runs.is_long
        counted += int(is_long.sum())
        is_same = runs.begin[1:] == runs.begin[:-1]
        is_step = is_same & is_long[1:]
        step = np.diff(means, axis=0)
        steps.append(step[is_step].ravel())
        interval = np.diff(times)
        intervals.append(interval[is_step])
    left = _mean_square(apart)
    stepped = _mean_square(steps)
    if counted < FEWEST_TIMES or not stepped:
        return False
    between = np.concatenate(intervals)
    typical = float(np.median(between))
    is_fast = typical <= LONGEST_INTERVAL
    most = SMOOTH**2 * stepped
    return is_fast and left <= most


def _mean_square(parts: Sequence[Array]) -> float:
    values = np.concatenate(parts)
    if not len(values):
        return 0.0
    squares = values**2
    mean = squares.mean()
    return float(mean)


def _interpolate(times: Array, values: Array, runs: Runs) -> tuple[Array, Mask]:
    """Interpolate values (u, n) at growing times (u,) from those around each in its run: by the
    polynomial through them (Lagrange). Whether there is one on either side (u,) comes with them."""
    count = len(times)
    own = np.arange(count)
    places = own[:, None] + AROUND
    begins = places >= runs.begin[:, None]
    is_near = begins & (places < runs.end[:, None])
    near = np.clip(places, 0, count - 1)
    near_times = times[near]
    to_near = times[:, None] - near_times
    to_own = np.where(is_near, to_near, 1.0)
    first = near_times[:, :, None]
    second = near_times[:, None, :]
    between = first - second
    size = len(AROUND)
    each = np.arange(size)
    between[:, each, each] = 1.0
    are_near = is_near[:, :, None] & is_near[:, None, :]
    between[~are_near] = 1.0
    others = np.repeat(to_own[:, None, :], size, axis=1)
    others[:, each, each] = 1.0
    weights = others.prod(axis=2)
    weights /= between.prod(axis=2)
    weights[~is_near] = 0.0
    near_values = values[near]
    told = np.einsum("up,upn->un", weights, near_values)
    before, after = is_near[:, 1], is_near[:, 2]
    return np.asarray(told), before & after


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
