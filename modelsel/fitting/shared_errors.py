"""Errors that rows share: their covariance, and what makes rows independent of each other again.

Whitened row by row, the errors of a campaign are e = ε + Σ_k B_k u_k. ε has unit variance; a part k
of the errors moves row i by its loading B_k(i) (c, d) times one draw u (d,) of variance `variance`,
which all rows of one level have in common (the visit of a posture, a group of rows), or which lasts
from row to row with a correlation of exp(-|t - t'| / length). The covariance of the rows is block
diagonal: rows that share a level, directly or by others, form a block, and a lasting error starts
afresh after MAX_BLOCK rows. With L a block's Cholesky factor, L⁻¹ makes its rows independent, each
of unit variance (the innovations of the block's rows, in their order)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotri, dtrtri

from .._linalg import connected_components
from .._typing import Array, Index, Rows

# rows of a block at most: of a lasting error, and of those that others share
MAX_BLOCK = 64
# and of a block that several parts join
MOST_ROWS = 256
# size of a matrix up to which numpy inverts many faster than LAPACK one by one
SMALL = 24


@dataclass(frozen=True, eq=False)
class SharedError:
    """One part of the errors that rows share.

    loading: (m, c, d) what one unit of each of its d numbers moves a row, whitened.
    level: (m,) which draw a row has; of a lasting error, the stretch in which it lasts.
    variance: of a draw, over that of ε.
    known: the variance of a draw itself, where it is given and not estimated.
    time: (m,) when a row was measured, and `length` in the same unit; None where nothing lasts.
    """

    loading: Array
    level: Index
    variance: float = 0.0
    time: Array | None = None
    length: float = np.inf
    known: float | None = None

    def take(self, rows: Rows) -> SharedError:
        """Return the part of some rows."""
        time = None if self.time is None else self.time[rows]
        return replace(self, loading=self.loading[rows], level=self.level[rows], time=time)

    def is_like(self, other: SharedError) -> bool:
        """Whether another part differs in its variance alone."""
        same_rows = self.loading is other.loading and self.level is other.level
        return same_rows and self.length == other.length

    def correlate(self, rows: Index) -> Array:
        """Compute the correlations (B, k, k) of the draws that rows (B, k) have."""
        level = self.level[rows]
        same: Array = (level[:, :, None] == level[:, None, :]).astype(float)
        if self.time is None:
            return same
        time = self.time[rows]
        apart = np.abs(time[:, :, None] - time[:, None, :])
        return np.asarray(same * np.exp(-apart / self.length))

    def spread(self, rows: Index) -> Array:
        """Compute the covariances (B, k·c, k·c) of rows (B, k) by draws of unit variance."""
        loading = self.loading[rows]
        blocks, k, c, _ = loading.shape
        by_draw = np.einsum("bicd,bjed->bicje", loading, loading, optimize=True)
        by_draw *= self.correlate(rows)[:, :, None, :, None]
        return np.asarray(by_draw.reshape(blocks, k * c, k * c))

    def multiply(self, values: Array) -> Array:
        """Compute the product (m, c, p) of the part's covariance, of unit variance, with values
        (m, c, p)."""
        _, mixed = self._share(values)
        return np.asarray(np.matmul(self.loading, mixed))

    def measure(self, values: Array) -> float:
        """Compute the sum over the columns of values (m, c, p) of their product with the part's
        covariance, of unit variance, from both sides."""
        inner, mixed = self._share(values)
        return float(np.vdot(inner, mixed))

    def _share(self, values: Array) -> tuple[Array, Array]:
        """Return values (m, c, p) by draw (m, d, p), and what the rows have of one another's."""
        inner = np.matmul(self.loading.transpose(0, 2, 1), values)
        if self.time is None:
            return inner, self._add_up(inner)
        mixed = np.empty_like(inner)
        for rows in group_blocks(self.level):
            correlation = self.correlate(rows)
            own = inner[rows].reshape(*rows.shape, -1)
            mixed[rows] = (correlation @ own).reshape(*rows.shape, *inner.shape[1:])
        return inner, mixed

    def _add_up(self, inner: Array) -> Array:
        """Return for every row the sum of values (m, ...) over the rows of its level."""
        order, starts, number = self._levels
        levels, rows = len(starts), len(order)
        if levels == rows:
            return inner
        sorted_rows = inner[order]
        totals = np.add.reduceat(sorted_rows, starts, axis=0)
        return np.asarray(totals[number])

    @cached_property
    def _levels(self) -> tuple[Index, Index, Index]:
        """(rows by level, where each level starts among them, each row's level by its number)."""
        order = np.argsort(self.level, kind="stable")
        _, starts, number = np.unique(self.level[order], return_index=True, return_inverse=True)
        of_rows = np.empty(len(order), np.intp)
        of_rows[order] = number.reshape(-1)
        return order, starts, of_rows


@dataclass(frozen=True, eq=False)
class SharedErrors:
    """All parts of the errors that rows share. What makes the rows independent is computed once."""

    parts: tuple[SharedError, ...]
    _slices: dict[tuple[int, int], SharedErrors] = field(default_factory=dict, repr=False)

    @cached_property
    def mixing(self) -> Mixing:
        """What makes the rows independent."""
        return mix(self.parts)

    def take(self, rows: Rows) -> SharedErrors:
        """Return those of some rows, which share nothing with the others then."""
        if not isinstance(rows, slice):
            return SharedErrors(tuple(part.take(rows) for part in self.parts))
        key = rows.start, rows.stop
        if key not in self._slices:
            self._slices[key] = SharedErrors(tuple(part.take(rows) for part in self.parts))
        return self._slices[key]


@dataclass(frozen=True, eq=False)
class Mixing:
    """What makes rows independent: for every number k of rows in a block, the rows (B, k) and the
    inverse (B, k·c, k·c) of the lower Cholesky factor of their covariance."""

    rows: tuple[Index, ...]
    inverse: tuple[Array, ...]

    def apply(self, values: Array) -> Array:
        """Make the rows of values (..., c, m) independent; they are overwritten."""
        for rows, inverse in zip(self.rows, self.inverse, strict=True):
            own = _gather(values, rows)
            independent = np.matmul(inverse, own)
            _scatter(values, rows, independent)
        return values

    def apply_transposed(self, values: Array) -> Array:
        """Multiply values (..., c, m) by the transpose; they are overwritten."""
        for rows, inverse in zip(self.rows, self.inverse, strict=True):
            own = _gather(values, rows)
            _scatter(values, rows, np.matmul(inverse.transpose(0, 2, 1), own))
        return values


def _gather(values: Array, rows: Index) -> Array:
    """Gather values (..., c, m) of rows (B, k) as (B, k·c, p)."""
    *leading, c, m = values.shape
    # of no values at all, too: then no size may be left open
    count = math.prod(leading)
    flat = values.reshape(count, c, m)
    own = flat[:, :, rows].transpose(2, 3, 1, 0)
    blocks, size = rows.shape
    return np.ascontiguousarray(own).reshape(blocks, size * c, count)


def _scatter(values: Array, rows: Index, own: Array) -> None:
    c = values.shape[-2]
    blocks, k = rows.shape
    by_row = own.reshape(blocks, k, c, *values.shape[:-2])
    axes = (*range(3, by_row.ndim), 2, 0, 1)
    values[..., rows] = by_row.transpose(axes)


@dataclass(frozen=True, eq=False)
class Precision:
    """The inverse of the rows' covariance: for every number k of rows in a block, the rows (B, k) and
    `blocks` (B, k·c, k·c); the `log_determinant` of the covariance."""

    rows: tuple[Index, ...]
    blocks: tuple[Array, ...]
    log_determinant: float

    def multiply(self, values: Array) -> Array:
        """Multiply values (m, c, p)."""
        product = np.empty_like(values)
        for rows, own in zip(self.rows, self.blocks, strict=True):
            picked = values[rows].reshape(*own.shape[:2], -1)
            weighed = np.matmul(own, picked)
            product[rows] = weighed.reshape(*rows.shape, *values.shape[1:])
        return product


@dataclass(frozen=True, eq=False)
class Layout:
    """Where the rows of some parts stand, whatever the parts' variances: for every number k of rows
    in a block, the rows (B, k) and what every part of unit variance spreads them, (P, B, k·c,
    k·c)."""

    rows: tuple[Index, ...]
    spreads: tuple[Array, ...]
    parts: tuple[SharedError, ...]

    @staticmethod
    def of(parts: Sequence[SharedError]) -> Layout:
        """Lay out the rows of parts."""
        rows = list_blocks(parts)
        spreads = tuple(np.stack([part.spread(own) for part in parts]) for own in rows)
        return Layout(rows, spreads, tuple(parts))

    def mix(self, variances: Sequence[float]) -> Mixing:
        """Compute what makes rows independent, the parts having these variances."""
        inverses = []
        for own in self.spreads:
            covariance = _combine(variances, own)
            lower = np.linalg.cholesky(covariance)
            triangle = np.asarray(lower, dtype=np.float64)
            inverse = _invert_lower(triangle)
            inverses.append(inverse)
        return Mixing(self.rows, tuple(inverses))

    def invert(self, variances: Sequence[float]) -> Precision:
        """Invert the rows' covariance, the parts having these variances."""
        blocks, total = [], 0.0
        for own in self.spreads:
            inverse, log_determinant = _invert(_combine(variances, own))
            blocks.append(inverse)
            total += log_determinant
        return Precision(self.rows, tuple(blocks), total)


def mix(parts: Sequence[SharedError]) -> Mixing:
    """Compute what makes rows independent that share errors."""
    return Layout.of(parts).mix([part.variance for part in parts])


def _combine(variances: Sequence[float], spreads: Array) -> Array:
    """Combine spreads (P, B, n, n) of unit variance to covariances, with one for every row itself."""
    total = np.tensordot(np.array(variances), spreads, 1)
    np.einsum("bii->bi", total)[...] += 1.0
    return np.asarray(total)


def _invert(matrices: Array) -> tuple[Array, float]:
    """Invert positive matrices (B, n, n), which are overwritten: (their inverses, the sum of the
    logarithms of their determinants)."""
    size = matrices.shape[1]
    if size <= SMALL:
        lower = np.linalg.cholesky(matrices)
        half = np.linalg.inv(lower)
        inverse = np.matmul(half.transpose(0, 2, 1), half)
        return np.asarray(inverse), _sum_logs(lower)
    for one in matrices:
        # the transpose is contiguous by columns: LAPACK works in it, and nothing is copied
        _, info = dpotrf(one.T, lower=1, overwrite_a=1)
        if info:
            raise np.linalg.LinAlgError("a covariance of rows is not positive")
    total = _sum_logs(matrices)
    for one in matrices:
        dpotri(one.T, lower=1, overwrite_c=1)
        beyond = np.triu(one, 1)
        np.add(one, beyond.T, out=one)
    return matrices, total


def _sum_logs(lower: NDArray[Any]) -> float:
    """Sum twice the logarithms of the diagonals of triangles (B, n, n)."""
    diagonal = np.diagonal(lower, 0, 1, 2)
    return 2 * float(np.log(diagonal).sum())


def _invert_lower(lower: Array) -> Array:
    """Invert lower triangles (B, n, n)."""
    size = lower.shape[1]
    if size <= SMALL:
        return np.asarray(np.linalg.inv(lower))
    return np.stack([dtrtri(one, lower=1)[0] for one in lower])


def list_blocks(parts: Sequence[SharedError]) -> tuple[Index, ...]:
    """List the rows (B, k) of all blocks, by their number k of rows."""
    block = parts[0].level
    for part in parts[1:]:
        block = _join(block, part.level)
    return group_blocks(block)


def _join(first: Index, second: Index) -> Index:
    """Number rows (m,) alike that share a level of either, directly or by others."""
    own = int(first.max()) + 1
    other = int(second.max()) + 1
    pairs = np.unique(np.stack([first, second + own], axis=1), axis=0)
    return np.asarray(connected_components(own + other, pairs)[first])


def group_blocks(block: Index) -> tuple[Index, ...]:
    """Group rows by block (m,): for every number k of rows, the rows (B, k), in order."""
    order = np.argsort(block, kind="stable")
    _, start, count = np.unique(block[order], return_index=True, return_counts=True)
    groups = []
    for k in np.unique(count):
        first = start[count == k]
        groups.append(order[first[:, None] + np.arange(k)])
    return tuple(groups)


def keep_within(parts: Sequence[SharedError]) -> tuple[SharedError, ...]:
    """Return the parts with blocks that are not too large: no level goes beyond the stretches of a
    lasting part, which stay blocks.

    Where levels of several parts join more than MOST_ROWS rows, such as rounds in which all postures
    are measured again, rows farther apart share nothing."""
    if any(part.time is not None for part in parts):
        return tuple(confine(part, parts) for part in parts)
    if not parts or len(list_blocks(parts)[-1][0]) <= MOST_ROWS:
        return tuple(parts)
    stretch = np.arange(len(parts[0].level)) // MOST_ROWS
    return tuple(_cut_levels(part, stretch) for part in parts)


def confine(part: SharedError, parts: Sequence[SharedError]) -> SharedError:
    """Return a part with no level beyond a stretch of the lasting one among `parts`."""
    all_lasting = (own for own in parts if own.time is not None)
    lasting = next(all_lasting, part)
    if lasting is part:
        return part
    return _cut_levels(part, lasting.level)


def _cut_levels(part: SharedError, stretch: Index) -> SharedError:
    """Number a part's levels anew wherever a stretch of the rows (m,) ends."""
    pairs = np.stack([part.level, stretch], axis=1)
    level = np.unique(pairs, axis=0, return_inverse=True)[1].reshape(-1)
    return replace(part, level=np.asarray(level, dtype=np.intp))
