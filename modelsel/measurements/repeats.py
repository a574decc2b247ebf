"""Repeats: rows in which the arm stood at equal joint readings, and what they say of the noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._typing import Array, Index, Mask
from .measurements import Measurements
from .near_readings import compute_spread
from .visits import SAME_READING


@dataclass(frozen=True, eq=False)
class Repeats:
    """Rows grouped by posture.

    posture (m,): the number of the group of each row; count (k,): the rows of each group; still (k,):
    whether the readings of its rows are equal. An arm that is read anew has moved its target."""

    posture: Index
    count: Index
    still: Mask

    @property
    def freedom(self) -> int:
        """Degrees of freedom of positions about their group's mean: three for each row measured again."""
        again = self.count[self.still] - 1
        return 3 * int(again.sum())

    @property
    def is_repeated(self) -> Mask:
        """Mask (m,) of the rows whose posture was measured more than once."""
        several = self.still & (self.count > 1)
        return np.asarray(several[self.posture])

    def deviate(self, position: Array) -> Array:
        """Compute how far positions (m, 3) are from their group's mean; zero where nothing repeats."""
        posture = self.posture
        totals = [np.bincount(posture, position[:, axis]) for axis in range(3)]
        mean = np.stack(totals, axis=1) / self.count[:, None]
        from_mean = position - mean[posture]
        return np.where(self.is_repeated[:, None], from_mean, 0.0)


def find_repeats(data: Measurements, placed: Index) -> Repeats:
    """Find the rows of one target that repeat a posture.

    `placed` (m,): the number of the instrument's placement in each row; positions are compared within a
    placement alone."""
    labels = np.stack([placed, data.block, data.target])
    _, posture, count = np.unique(labels, axis=1, return_inverse=True, return_counts=True)
    posture = posture.reshape(-1)
    spread = compute_spread(data.q, posture)
    return Repeats(posture, count, spread <= SAME_READING)
