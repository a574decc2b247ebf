"""Repeats: rows in which the arm stood at equal joint readings, and what they say of the noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._typing import Array, Index, Mask
from .campaign.near_readings import are_near, compute_spread
from .campaign.visits import SAME_READING
from .measurements import Measurements


@dataclass(frozen=True, eq=False)
class Repeats:
    """Rows grouped by posture.

    posture (m,): the number of the group of each row; count (k,): the rows of each group; alike (k,):
    whether the readings of its rows are."""

    posture: Index
    count: Index
    alike: Mask

    @property
    def freedom(self) -> int:
        """Degrees of freedom of positions about their group's mean: three for each row measured again."""
        again = self.count[self.alike] - 1
        return 3 * int(again.sum())

    @property
    def is_repeated(self) -> Mask:
        """Mask (m,) of the rows whose posture was measured more than once."""
        several = self.alike & (self.count > 1)
        return np.asarray(several[self.posture])

    def deviate(self, position: Array) -> Array:
        """Compute how far positions (m, 3) are from their group's mean; zero where nothing repeats."""
        posture = self.posture
        totals = [np.bincount(posture, position[:, axis]) for axis in range(3)]
        mean = np.stack(totals, axis=1) / self.count[:, None]
        from_mean = position - mean[posture]
        return np.where(self.is_repeated[:, None], from_mean, 0.0)


def find_repeats(data: Measurements, placed: Index, is_predicted: bool = False) -> Repeats:
    """Find the rows of one target that repeat a posture.

    `placed` (m,): the number of the instrument's placement in each row; positions are compared within a
    placement alone. Readings are equal, for an arm that is read anew has moved its target; what is left
    of positions that a model predicted (`is_predicted`) knows of that, and readings may differ as those
    of returns do."""
    labels = np.stack([placed, data.block, data.target])
    _, posture, count = np.unique(labels, axis=1, return_inverse=True, return_counts=True)
    posture = posture.reshape(-1)
    if is_predicted:
        return Repeats(posture, count, are_near(data.q, posture, data.prismatic))
    spread = compute_spread(data.q, posture)
    return Repeats(posture, count, spread <= SAME_READING)
