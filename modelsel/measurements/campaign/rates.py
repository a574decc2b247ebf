"""How fast the motors moved when a row was measured, from the clock of a continuous motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ..._typing import Array, Index, Mask

# successive times through which a polynomial of one degree less is laid
POINTS = 5
# a pause: an interval that is so many times the median of those around it, and how many these are
PAUSE, INTERVALS_AROUND = 3.0, 9
# successive times without a pause that tell a speed by themselves
FEWEST_IN_RUN = 3


@dataclass(frozen=True, eq=False)
class Runs:
    """Rows that follow one another without a pause, of each of growing times (u,): where its run
    begins, and where the next one does."""

    begin: Index
    end: Index

    @property
    def is_long(self) -> Mask:
        """Whether a run tells a speed by itself (u,)."""
        length = self.end - self.begin
        return length >= FEWEST_IN_RUN


def derive_rates(readings: Array, group: Index, visit: Index, time: Array | None) -> Array | None:
    """Derive how fast each motor moved (m, n) [rad/s, mm/s] from its readings (m, n) and the clock
    (m,) [s], group by group; 0 where the arm stands still: a visit that lasts. None without a clock.

    The derivative of the polynomial through a row and its neighbours in time (Fornberg 1988), whose
    times need not be even. No neighbour lies beyond a pause, in which the arm may have gone elsewhere,
    but of a row or two alone between pauses. Of several rows at one time the mean reading counts."""
    if time is None:
        return None
    rates = np.zeros(readings.shape)
    for number in np.unique(group):
        rows = np.flatnonzero(group == number)
        some = readings[rows]
        own_time = time[rows]
        rates[rows] = _derive_in_group(some, own_time)
    resting = _find_lasting(visit, time)
    rates[resting] = 0.0
    return rates


def _derive_in_group(readings: Array, time: Array) -> Array:
    """Derive the rates (m, n) of one group's rows."""
    times, place, means = average_by_time(readings, time)
    is_single = len(times) < 2
    if is_single:
        return np.zeros(readings.shape)
    rates = _differentiate(times, means)
    return rates[place]


def average_by_time(readings: Array, time: Array) -> tuple[Array, Index, Array]:
    """Average the readings (m, n) of rows at one time: the distinct times (u,), the place (m,) of each
    row among them, the mean readings (u, n)."""
    times, place = np.unique(time, return_inverse=True)
    place = place.reshape(-1)
    count = len(times)
    joints = readings.shape[1]
    shape = count, joints
    sums = np.zeros(shape)
    np.add.at(sums, place, readings)
    rows = np.bincount(place)
    means = sums / rows[:, None]
    return times, place, means


def find_runs(times: Array) -> Runs:
    """Find the runs of growing times (u,) without a pause: an interval far longer than most of those
    around it. Where the clock ticks slower from some time on, these are as long as it."""
    intervals = np.diff(times)
    usual = _take_local_median(intervals)
    is_pause = intervals > PAUSE * usual
    before = np.flatnonzero(is_pause)
    starts = np.append(0, before + 1)
    count = len(times)
    ends = np.append(starts[1:], count)
    lengths = ends - starts
    begin = np.repeat(starts, lengths)
    end = np.repeat(ends, lengths)
    return Runs(begin, end)


def _take_local_median(values: Array) -> Array:
    """Take the median of the values (u,) around each, of all where they are few."""
    count = len(values)
    if not count:
        return values
    width = min(INTERVALS_AROUND, count)
    windows = sliding_window_view(values, width)
    medians = np.median(windows, axis=1)
    number = np.arange(count)
    centred = number - width // 2
    last = count - width
    first = np.clip(centred, 0, last)
    return np.asarray(medians[first])


def _differentiate(times: Array, values: Array) -> Array:
    """Differentiate values (u, n) at growing times (u,)."""
    number = np.arange(len(times))
    near, is_beyond = _find_windows(times)
    own = np.argmax(near == number[:, None], axis=1)
    window = np.arange(POINTS)
    near_times = times[near]
    gaps = near_times[:, :, None] - near_times[:, None, :]
    gaps[:, window, window] = 1.0
    is_left_out = is_beyond[:, :, None] | is_beyond[:, None, :]
    gaps[is_left_out] = 1.0
    products = gaps.prod(axis=2)
    # the derivative of each Lagrange polynomial at the row's own time
    to_own = gaps[number, own]
    of_own = products[number, own]
    weights = of_own[:, None] / products
    weights /= to_own
    weights[number, own] = 0.0
    weights[is_beyond] = 0.0
    others = weights.sum(1)
    weights[number, own] = -others
    near_values = values[near]
    rates = np.einsum("up,upn->un", weights, near_values)
    return np.asarray(rates)


def _find_windows(times: Array) -> tuple[Index, Mask]:
    """Find the times through which the polynomial of each goes (u, POINTS): of its run where that is
    long, of all times otherwise; and which places are beyond its end, as in a run of fewer."""
    count = len(times)
    runs = find_runs(times)
    is_long = runs.is_long
    begin = np.where(is_long, runs.begin, 0)
    end = np.where(is_long, runs.end, count)
    last = np.maximum(end - POINTS, begin)
    number = np.arange(count)
    centred = number - POINTS // 2
    first = np.clip(centred, begin, last)
    window = np.arange(POINTS)
    places = first[:, None] + window
    is_beyond = places >= end[:, None]
    near = np.minimum(places, count - 1)
    return near, is_beyond


def _find_lasting(visit: Index, time: Array) -> Index:
    """Find the rows of visits that have several times."""
    count = int(visit.max(initial=-1)) + 1
    begins = np.full(count, np.inf)
    ends = np.full(count, -np.inf)
    np.minimum.at(begins, visit, time)
    np.maximum.at(ends, visit, time)
    lasts = ends > begins
    is_of_lasting = lasts[visit]
    return np.flatnonzero(is_of_lasting)
