"""Whitening: residuals and columns in units of their standard uncertainty, rows made independent."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .._linalg import multiply_by_row
from .._typing import Array, Rows
from .shared_errors import SharedErrors


@dataclass(frozen=True, eq=False)
class Whitening:
    """What turns the components of all rows [mm, rad] into independent numbers of unit variance.

    First row by row: one `weight` [1/mm] for all, times, where rows differ, a matrix (c, c) of each
    in `matrices` (m, c, c). Then, where rows share errors, the covariance of `shared` is taken out,
    block of rows by block of rows. `stated`: the whitening before parts of the
    errors were estimated, None where none were; `others`: the whitening by all parts but those that
    are the instrument's own, None where it has none."""

    weight: float = 1.0
    matrices: Array | None = None
    shared: SharedErrors | None = None
    stated: Whitening | None = None
    others: Whitening | None = None

    @property
    def uniform(self) -> bool:
        """Whether one weight holds for every component of every row."""
        return self.matrices is None and self.shared is None

    def take(self, rows: Rows) -> Whitening:
        """Return the whitening of some rows."""
        if self.uniform:
            return self
        matrices = None if self.matrices is None else self.matrices[rows]
        shared = None if self.shared is None else self.shared.take(rows)
        stated = None if self.stated is None else self.stated.take(rows)
        others = None if self.others is None else self.others.take(rows)
        return Whitening(self.weight, matrices, shared, stated, others)

    def apply(self, values: Array) -> Array:
        """Return values (..., c, m) whitened; they are overwritten where one weight does."""
        return self.mix(self.apply_by_row(values))

    def apply_by_row(self, values: Array) -> Array:
        """Return values (..., c, m) in units of their standard uncertainty, whatever rows share;
        they are overwritten where one weight does."""
        if self.weight != 1.0:
            values *= self.weight
        if self.matrices is None:
            return values
        return multiply_by_row(self.matrices, values)

    def mix(self, values: Array) -> Array:
        """Return values (..., c, m) that are whitened row by row, the rows made independent; they
        are overwritten."""
        return values if self.shared is None else self.shared.mixing.apply(values)

    def apply_transposed(self, values: Array) -> Array:
        """Return values (c, m) times the transpose of what whitens them."""
        if self.shared is not None:
            values = self.shared.mixing.apply_transposed(values.copy())
        if self.matrices is not None:
            values = np.einsum("mij,im->jm", self.matrices, values)
        return np.asarray(values * self.weight)

    def log_determinant(self) -> float:
        """Return the logarithm of the determinant of the rows' covariance, over that of what is
        stated."""
        if self.stated is None:
            return 0.0
        total = 0.0
        if self.shared is not None:
            for inverse in self.shared.mixing.inverse:
                total -= 2 * float(np.log(np.diagonal(inverse, 0, 1, 2)).sum())
            return total
        assert self.matrices is not None
        total = -2 * float(np.linalg.slogdet(self.matrices)[1].sum())
        if self.stated.matrices is not None:
            total += 2 * float(np.linalg.slogdet(self.stated.matrices)[1].sum())
        return total

    def by_row(self) -> Whitening:
        """Return the whitening row by row, whatever rows share."""
        return replace(self, shared=None)

    def as_stated(self) -> Whitening:
        """Return the whitening before parts of the errors were estimated."""
        return self if self.stated is None else self.stated

    def beside_instrument(self) -> Whitening:
        """Return the whitening by all parts but those of the instrument, of which a stated
        uncertainty is the whole."""
        return self if self.others is None else self.others

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
