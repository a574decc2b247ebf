"""The clocks of two files, and which readings are nearest in time to every point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..._typing import Array, Index
from ..formats.table import Table
from .joined_blanks import find_filled_times

DAY_SECONDS = 86400.0


@dataclass(frozen=True, eq=False)
class Clocks:
    """Times of the points (m,) and of the readings (n,) in seconds from one beginning, the rows of the
    tables that these are of, and the columns they are from, in words."""

    points: Array
    log: Array
    point_rows: Index
    log_rows: Index
    columns: str


def read_clocks(points: Table, log: Table, clock_offset: float = 0.0) -> Clocks | str:
    """Read the times of two files, those of the log without the `clock_offset` by which its clock is
    ahead [s]; the reason where they cannot be compared."""
    times, point_rows = find_filled_times(points)
    readings, log_rows = find_filled_times(log)
    if times is None or readings is None:
        lacking = points if times is None else log
        return f"{lacking.where.file} has no column of times that is filled"
    if times.absolute != readings.absolute:
        return "one file has the time of day, the other a time that begins at zero"
    of_points = times.seconds
    of_log = readings.seconds - clock_offset
    both_dated = times.dated and readings.dated
    if times.absolute and not both_dated:
        of_points = of_points % DAY_SECONDS
        of_log = of_log % DAY_SECONDS
    columns = f'"{times.column}" and "{readings.column}"'
    return Clocks(of_points, of_log, point_rows, log_rows, columns)


def find_nearest_times(sorted_times: Array, times: Array) -> Index:
    """Find the place of the nearest of `sorted_times` (n,) to each of `times` (m,)."""
    last = len(sorted_times) - 1
    place = np.searchsorted(sorted_times, times)
    after = np.minimum(place, last)
    before = np.maximum(place - 1, 0)
    since = times - sorted_times[before]
    until = sorted_times[after] - times
    nearest = np.where(np.abs(since) <= np.abs(until), before, after)
    return np.asarray(nearest, np.intp)
