"""A constant difference between two clocks, found from the times of points and of readings."""

from __future__ import annotations

import numpy as np

from ..._typing import Array
from ...exceptions import write_rounded

# pairs of times that are compared
MAX_PAIRS = 4_000_000
# share of the points that have readings at one difference, and of these that may have them at
# another
MIN_SHARE = 0.5
MAX_OTHER_SHARE = 0.5
MILLISECOND = 1e-3  # s; a smaller gap is told as less than this


def find_clock_offset(points: Array, log: Array, max_gap: float) -> tuple[float, int] | None:
    """Find (the seconds by which the log's clock is ahead, the pairs of a point and readings that
    agree in it to `max_gap` s); None where no difference is common, or several are."""
    count = len(points)
    if not 0 < count * len(log) <= MAX_PAIRS:
        return None
    difference = np.subtract.outer(log, points)
    ordered = np.sort(difference, axis=None)
    ends = np.searchsorted(ordered, ordered + 2 * max_gap, side="right")
    agreeing = ends - np.arange(len(ordered))
    best = int(agreeing.argmax())
    most = int(agreeing[best])
    is_other = np.abs(ordered - ordered[best]) > 4 * max_gap
    others = int(agreeing[is_other].max(initial=0))
    if most < MIN_SHARE * count or others > MAX_OTHER_SHARE * most:
        return None
    window = ordered[best : best + most]
    middle = (window[0] + window[-1]) / 2
    return float(middle), most


def write_seconds(seconds: float) -> str:
    """Write a time [s]; less than a millisecond is told as one."""
    if seconds < MILLISECOND:
        return f"{MILLISECOND:g} s"
    return f"{write_rounded(seconds)} s"
