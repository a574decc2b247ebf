"""Causes that are zero at most rows: only their other values are kept.

Free functions of the joints have thousands of splines, of which a row sees four of each function."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._typing import Array, Index
from ...fitting.problem import Problem
from ...mechanisms.causes import Cause


@dataclass(frozen=True, eq=False)
class LocalCauses:
    """Values of causes (l, m) where they are not zero.

    Those of cause k are `values[starts[k] : starts[k + 1]]`, at the rows in the same part of `rows`;
    `count`: the number m of all rows."""

    values: Array
    rows: Index
    starts: Index
    count: int
    _known: dict[tuple[int, int, np.dtype[Any]], Any] = field(default_factory=dict, repr=False)

    @staticmethod
    def of(problem: Problem, causes: Sequence[Cause]) -> LocalCauses:
        """Evaluate causes at the rows of a problem."""
        values, rows, counts = [np.zeros(0)], [np.zeros(0, np.intp)], [0]
        for cause in causes:
            whole = np.broadcast_to(cause.of(problem.state), len(problem))
            own = np.flatnonzero(whole)
            values.append(whole[own])
            rows.append(own)
            counts.append(len(own))
        return LocalCauses(
            np.concatenate(values), np.concatenate(rows), np.cumsum(counts), len(problem)
        )

    def dot(self, which: Index | slice, vectors: NDArray[Any]) -> NDArray[Any]:
        """Compute the products (k, B) of some causes with vectors (m, B), in their precision."""
        return np.asarray(self._select(which, vectors.dtype) @ vectors)

    def gram(self, which: Index, weight: Array) -> Array:
        """Compute the products (k, k) of some causes with one another, rows weighted (m,)."""
        some = self._sparse(weight.dtype)[which]
        return np.asarray((some.multiply(weight).tocsr() @ some.T).toarray())

    def _select(self, which: Index | slice, dtype: np.dtype[Any]) -> Any:
        """Select causes as a sparse matrix (k, m); of consecutive ones it is remembered."""
        if not isinstance(which, slice):
            return self._sparse(dtype)[which]
        known = self._known
        key = which.start, which.stop, dtype
        if key in known:
            return known[key]
        every = self._sparse(dtype)
        selected = every[which]
        known[key] = selected
        return selected

    def _sparse(self, dtype: np.dtype[Any]) -> Any:
        """Return the causes as a sparse matrix (l, m)."""
        from scipy.sparse import csr_array

        values = self.values.astype(dtype, copy=False)
        shape = len(self.starts) - 1, self.count
        entries = values, self.rows, self.starts
        return csr_array(entries, shape=shape)

    def expand(self, which: Index) -> Array:
        """Return some causes (k, m) in full."""
        out = np.zeros((len(which), self.count))
        for row, k in zip(out, which, strict=True):
            own = slice(self.starts[k], self.starts[k + 1])
            row[self.rows[own]] = self.values[own]
        return out

    def sum_squares(self) -> Array:
        """Sum the squares (l,) of every cause over the rows."""
        cause = np.repeat(np.arange(len(self.starts) - 1), np.diff(self.starts))
        squares = np.bincount(cause, np.square(self.values), len(self.starts) - 1)
        return np.asarray(squares, dtype=float)
