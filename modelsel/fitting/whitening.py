"""Whitening: residuals and columns in units of their standard uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .._typing import Array, Rows


@dataclass(frozen=True, eq=False)
class Whitening:
    """What turns the components of a row [mm, rad] into numbers of unit variance: one `weight`
    [1/mm] for all, times, where rows differ, a matrix (c, c) of each in `matrices` (m, c, c)."""

    weight: float = 1.0
    matrices: Array | None = None

    @property
    def uniform(self) -> bool:
        """Whether one weight holds for every component of every row."""
        return self.matrices is None

    def take(self, rows: Rows) -> Whitening:
        """Return the whitening of some rows."""
        if self.matrices is None:
            return self
        return replace(self, matrices=self.matrices[rows])

    def apply(self, values: Array) -> Array:
        """Return values (..., c, m) whitened; they are overwritten where one weight does."""
        if self.weight != 1.0:
            values *= self.weight
        if self.matrices is None:
            return values
        return np.asarray(np.einsum("mij,...jm->...im", self.matrices, values))

    def apply_transposed(self, values: Array) -> Array:
        """Return values (c, m) times the transpose of what whitens them."""
        if self.matrices is not None:
            values = np.einsum("mij,im->jm", self.matrices, values)
        return np.asarray(values * self.weight)

    def without_weight(self) -> Whitening:
        """Return the whitening with a weight of one, as the triangle of many rows may be scaled
        instead."""
        return replace(self, weight=1.0)

    def typical_weight(self, components: int | None = 3) -> float:
        """Return the weight [1/mm] of one coordinate of a typical row: the median over rows, and
        over the first `components` of each (None: over all)."""
        matrices = self.matrices
        if matrices is None:
            return self.weight
        diagonal = np.diagonal(matrices, 0, 1, 2)
        judged = diagonal[:, :components]
        median = float(np.median(judged))
        return self.weight * median


UNIT = Whitening()
