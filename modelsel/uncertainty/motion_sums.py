"""How far effects move and turn the target: sums over blocks of rows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._typing import Array
from ..fitting.problem import Problem

MILLIRADIAN = 1e-3  # rad


class Motion(NamedTuple):
    """Mean and largest displacement [mm] of the target, and how far it turns [mrad]; None where no
    orientation was measured."""

    mean_mm: float
    max_mm: float
    mean_mrad: float | None
    max_mrad: float | None


class MotionSum:
    """Sum and largest length of displacements and of turns, block by block."""

    def __init__(self) -> None:
        self.total = np.zeros(2)
        self.largest = np.zeros(2)

    def add(self, change: Array) -> None:
        """Add what changes (c, m) at the rows of a block [mm, rad]."""
        for kind, own in enumerate((change[:3], change[3:])):
            if not own.size:
                continue
            size = np.linalg.norm(own, axis=0)
            block_sum = size.sum()
            block_largest = size.max()
            self.total[kind] += block_sum
            largest = max(self.largest[kind], block_largest)
            self.largest[kind] = largest

    def summarise(self, problem: Problem) -> Motion:
        """Summarise over all rows of the problem whose blocks were added."""
        rows = len(problem)
        moved, turned = self.total.tolist()
        most_moved, most_turned = self.largest.tolist()
        mean = moved / rows
        if problem.components == 3:
            return Motion(mean, most_moved, None, None)
        oriented = count_oriented(problem)
        mean_turn = turned / max(oriented, 1)
        return Motion(mean, most_moved, mean_turn / MILLIRADIAN, most_turned / MILLIRADIAN)


def count_oriented(problem: Problem) -> int:
    """Count the rows with a measured orientation."""
    measured = problem.measured
    if measured is None:
        return len(problem)
    oriented = measured[:, 3]
    return int(oriented.sum())
