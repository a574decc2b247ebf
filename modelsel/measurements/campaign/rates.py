"""How fast the motors moved when a row was measured, from the clock of a continuous motion."""

from __future__ import annotations

import numpy as np

from ..._typing import Array, Index

# successive times through which a polynomial of one degree less is laid
POINTS = 5


def derive_rates(readings: Array, group: Index, visit: Index, time: Array | None) -> Array | None:
    """Derive how fast each motor moved (m, n) [rad/s, mm/s] from its readings (m, n) and the clock
    (m,) [s], group by group; 0 where the arm stands still: a visit that lasts. None without a clock.

    The derivative of the polynomial through a row and its neighbours in time (Fornberg 1988), whose
    times need not be even. Of several rows at one time the mean reading counts."""
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


def _differentiate(times: Array, values: Array) -> Array:
    """Differentiate values (u, n) at growing times (u,)."""
    count = len(times)
    width = min(POINTS, count)
    number = np.arange(count)
    centred = number - width // 2
    last = count - width
    first = np.clip(centred, 0, last)
    window = np.arange(width)
    near = first[:, None] + window
    own = number - first
    near_times = times[near]
    gaps = near_times[:, :, None] - near_times[:, None, :]
    gaps[:, window, window] = 1.0
    products = gaps.prod(axis=2)
    # the derivative of each Lagrange polynomial at the row's own time
    to_own = gaps[number, own]
    of_own = products[number, own]
    weights = of_own[:, None] / products
    weights /= to_own
    weights[number, own] = 0.0
    others = weights.sum(1)
    weights[number, own] = -others
    near_values = values[near]
    rates = np.einsum("up,upn->un", weights, near_values)
    return np.asarray(rates)


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
