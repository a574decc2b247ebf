"""What a row owes to what went before it by the clock: how long the arm has been at work since it last
stood for long, and the temperature as a link of the arm follows it, late."""

from __future__ import annotations

import numpy as np

from ..._typing import Array, Index

# time constants [min] of the first-order lag with which a link follows the air's temperature
LAGS = (5, 6, 8, 10, 12, 16, 20, 25, 32, 40, 50, 63, 80, 100, 125, 160)
MINUTE = 60.0  # s
# s without a row after which an arm has cooled down: several of its time constants
REST = 3 * 3600.0
# correlation with the temperature from which a lag does not show
ALIKE = 0.98


def number_clocks(group: Index, time: Array) -> Index:
    """Number the clocks (m,) of rows: one of all groups where these followed one another by it, else one
    of each."""
    if not len(group):
        return group
    groups = int(group.max()) + 1
    first = np.full(groups, np.inf)
    last = np.full(groups, -np.inf)
    np.minimum.at(first, group, time)
    np.maximum.at(last, group, time)
    by_clock = np.argsort(first, kind="stable")
    ends = last[by_clock[:-1]]
    next_starts = first[by_clock[1:]]
    if (next_starts < ends).any():
        return group
    return np.zeros_like(group)


def derive_since_rest(group: Index, time: Array | None) -> Array | None:
    """Derive the time (m,) [s] since the arm last stood for long, or since its first row. None without a
    clock."""
    if time is None or not np.isfinite(time).all():
        return None
    clocks = number_clocks(group, time)
    since = np.zeros(len(time))
    for number in np.unique(clocks):
        rows = np.flatnonzero(clocks == number)
        own_time = time[rows]
        times, place = np.unique(own_time, return_inverse=True)
        gaps = np.diff(times, prepend=-np.inf)
        begins = np.where(gaps >= REST, times, -np.inf)
        started = np.maximum.accumulate(begins)
        at_work = times - started
        since[rows] = at_work[place.reshape(-1)]
    return since


def derive_late(group: Index, time: Array | None, temperature: Array | None) -> Array | None:
    """Derive the temperature (m, L) [°C] as masses of the time constants LAGS have it. None without a
    clock or a temperature.

    Between readings the temperature goes straight on; the first one has lasted until then. Of several
    rows at one time the mean counts."""
    if time is None or temperature is None:
        return None
    if not np.isfinite(time).all() or not np.isfinite(temperature).all():
        return None
    clocks = number_clocks(group, time)
    late = np.zeros((len(time), len(LAGS)))
    for number in np.unique(clocks):
        rows = np.flatnonzero(clocks == number)
        own_time = time[rows]
        readings = temperature[rows]
        times, place = np.unique(own_time, return_inverse=True)
        place = place.reshape(-1)
        sums = np.bincount(place, readings)
        means = sums / np.bincount(place)
        followed = _follow(times, means)
        late[rows] = followed[place]
    return late


def find_lags(temperature: Array | None, late: Array | None) -> tuple[int, ...]:
    """Find the lags [min] whose temperatures (m, L) the readings (m,) do not tell already."""
    if temperature is None or late is None:
        return ()
    apart = temperature - temperature.mean()
    others = late - late.mean(axis=0)
    size = np.linalg.norm(apart) * np.linalg.norm(others, axis=0)
    product = apart @ others
    is_other = product < ALIKE * size
    return tuple(lag for lag, differs in zip(LAGS, is_other.tolist(), strict=True) if differs)


def _follow(times: Array, readings: Array) -> Array:
    """Follow readings (u,) at growing times (u,) [s] with every lag (u, L)."""
    constants = np.array(LAGS) * MINUTE
    steps = np.diff(times)
    slopes = np.diff(readings) / steps
    fading = np.exp(-steps[:, None] / constants)
    # by how much each mass is behind a temperature that has long gone on like this
    behind = slopes[:, None] * constants
    late = np.empty((len(times), len(LAGS)))
    late[0] = readings[0]
    for k in range(len(steps)):
        apart = late[k] - readings[k] + behind[k]
        late[k + 1] = readings[k + 1] - behind[k] + apart * fading[k]
    return late
