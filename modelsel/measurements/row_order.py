"""The place of every row in the campaign that it was measured in."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .._typing import Array

Index = NDArray[np.intp]


def compute_progress(group: Index, order: Array, time: Array | None = None) -> Array:
    """Compute the place (m,) of every row in the campaign, 0 to 1: groups by the clock where one clock runs
    through all of them, else in the order of their first rows; each in order of motion."""
    rank = np.empty(len(group))
    rank[np.lexsort((np.arange(len(group)), order, _after_one_another(group, time)))] = np.arange(
        len(group)
    )
    return rank / max(len(group) - 1, 1)


def _after_one_another(group: Index, time: Array | None) -> Index:
    """Number the groups as one followed another: by the clock where their times do not overlap,
    else as they are."""
    if time is None or not len(group):
        return group
    first, last = np.full(group.max() + 1, np.inf), np.full(group.max() + 1, -np.inf)
    np.minimum.at(first, group, time)
    np.maximum.at(last, group, time)
    by_clock = np.argsort(first, kind="stable")
    if (first[by_clock[1:]] < last[by_clock[:-1]]).any():
        return group
    return np.asarray(np.argsort(by_clock)[group], dtype=np.intp)
