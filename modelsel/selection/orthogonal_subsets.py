"""Given subsets of candidate mechanisms by orthogonal factors, where the squared sums of the sweeps
(`subsets`) lose too many digits.

The walk is that of the sweeps, on triangles: one node per beginning that some subsets share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._linalg import TINY
from .._typing import Array, Index, Mask
from ..fitting.reduction import TOLERANCE, Reduction
from .cross_validation import FoldedData
from .moments import DEPENDENT

# subsets walked together
BATCH = 4096
# relative size of a column below which it is zero
ZERO_COLUMN = 1e-13

# (T (K+1, d, d), E: K of (h, d)): what `project_base` returns
Projection = tuple[Array, list[Array]]


@dataclass(frozen=True, eq=False)
class OrthogonalSubsets:
    """Figures of S subsets: rank and residual sum of squares (S,) of all rows, held-out sums of
    squares (S, K); NaN where a subset rests on a fold alone."""

    rank: Index
    rss: Array
    held_out: Array

    def take(self, rows: Mask) -> OrthogonalSubsets:
        """Select some subsets."""
        return OrthogonalSubsets(self.rank[rows], self.rss[rows], self.held_out[rows])


@dataclass(frozen=True, eq=False)
class _Nodes:
    """Beginnings of subsets: the groups decided so far.

    T: (nodes, K+1, d, d) triangles of the undecided columns and the response, entry K of all rows.
    E: (nodes, K, h, d) the folds' own rows under the others' fit.
    rank: (nodes,) columns kept; sure: (nodes, K) whether the others determine what is kept.
    """

    T: Array
    E: Array
    rank: Index
    sure: Mask

    def take(self, nodes: Index) -> _Nodes:
        """Select nodes, each as often as it is named."""
        return _Nodes(self.T[nodes], self.E[nodes], self.rank[nodes], self.sure[nodes])

    def leave_out(self, width: int) -> _Nodes:
        """Leave the first `width` columns out."""
        T = self.T[..., width:]
        E = self.E[..., width:]
        R = _triangulate(T)
        return _Nodes(R, E, self.rank, self.sure)

    def keep(self) -> _Nodes:
        """Keep the first column, or leave it out where it depends on those before it."""
        pivot = self.T[:, :, 0, 0]
        good = np.abs(pivot[:, -1]) > TOLERANCE
        held = np.square(pivot[:, :-1]) > DEPENDENT * np.square(pivot[:, -1:])
        inverse = np.where(held & good[:, None], 1 / np.where(held, pivot[:, :-1], 1.0), 0.0)
        step = self.T[:, :-1, 0, 1:] * inverse[:, :, None]
        shorter = self.T[:, :, 1:, 1:]
        if not good.all():
            shorter = shorter.copy()
            shorter[~good] = _triangulate(self.T[~good][..., 1:])
        residual = self.E[..., 1:] - self.E[..., :1] * step[:, :, None, :]
        sure = self.sure & (held | ~good[:, None])
        return _Nodes(shorter, residual, self.rank + good, sure)


def order_groups(groups: Sequence[Sequence[int]]) -> list[int]:
    """Order the groups for the walk: large ones nearest the root, where there are few nodes."""
    sizes = [len(group) for group in groups]
    places = range(len(groups))
    return sorted(places, key=lambda g: -sizes[g])


def project_base(folded: FoldedData, base: Sequence[int], columns: Sequence[int]) -> Projection:
    """Project the base out of the columns and the response, fold by fold.

    Returns T (K+1, d, d), the triangles of what the base leaves of the other folds' rows (entry K:
    of all rows), and E, K arrays (h, d), what it leaves of the fold's own rows under their fit."""
    chosen = [*base, *columns, -1]
    b = len(base)
    blocks = folded.blocks
    blocks = blocks[:, :, chosen]
    folds, _, width = blocks.shape
    left = width - b
    prior = np.zeros((0, width))
    if folded.prior is not None:
        prior = folded.prior
        prior = prior[:, chosen]
    everything = blocks.reshape(-1, width)
    base_columns = everything[:, :b]
    size = np.linalg.norm(base_columns, axis=0)
    T = np.empty((folds + 1, left, left))
    E = []
    for k, block in enumerate(blocks):
        others = np.delete(blocks, k, axis=0)
        training = others.reshape(-1, width)
        R, absent = _reduce_training(training, prior, size)
        residual = _predict_fold(block, R, absent)
        T[k] = R[b:, b:]
        E.append(residual)
    # all rows are the last entry
    R, _ = _reduce_training(everything, prior, size)
    T[folds] = R[b:, b:]
    return T, E


def _reduce_training(training: Array, prior: Array, size: Array) -> tuple[Array, Mask]:
    """Reduce training rows and prior to a triangle; also the mask (b,) of base columns that the
    training rows do not have, which stay as fitted."""
    width = training.shape[1]
    b = len(size)
    base = training[:, :b]
    length = np.linalg.norm(base, axis=0)
    smallest = 1e-12 * size
    absent = length <= smallest
    if absent.any():
        present = np.ones(width, bool)
        present[:b] = ~absent
        training = training * present
        prior = prior * present
    reduction = Reduction.empty(width - 1)
    reduction = reduction.add(training)
    reduction = reduction.add(prior)
    R = reduction.R
    return R, absent


def _predict_fold(block: Array, R: Array, absent: Mask) -> Array:
    """Compute what the base leaves of a fold's rows (h, d) under the fit of the training triangle
    R."""
    b = len(absent)
    base = R[:b, :b]
    rest = R[:b, b:]
    norm = np.linalg.norm(base, axis=0)
    length = np.maximum(norm, TINY)
    unit = np.where(absent, np.inf, length)
    scaled = base / unit
    solution = np.linalg.lstsq(scaled, rest, rcond=ZERO_COLUMN)
    through = solution[0]
    own = block[:, :b] / unit
    predicted = own @ through
    left = block[:, b:] - predicted
    return np.asarray(left)


def refine_subsets(
    folded: FoldedData,
    base: Sequence[int],
    groups: Sequence[Sequence[int]],
    members: Mask,
    projection: Projection | None = None,
) -> OrthogonalSubsets:
    """Compute the figures of the subsets `members` (S, G) of `groups` on top of independent base
    columns.

    A column that depends on the kept ones is left out, as `identify` does. `projection`: what
    `project_base` gives for the groups' columns in the order of the walk."""
    order = order_groups(groups)
    members = members[:, order]
    walked = [groups[g] for g in order]
    sizes = [len(group) for group in walked]
    columns = [c for group in walked for c in group]
    if projection is None:
        projection = project_base(folded, base, columns)
    T, E = projection
    folds = len(E)
    scale = _scale_columns(folded, base, columns)
    rows = []
    for e in E:
        scaled = e[None] / scale
        triangle = _triangulate(scaled)
        rows.append(triangle[0])
    # the root: no group decided
    T = T / scale
    E_root = np.stack(rows)
    rank = np.zeros(1, np.intp)
    sure = np.ones((1, folds), bool)
    root = _Nodes(T[None], E_root[None], rank, sure)
    count = len(members)
    subsets = OrthogonalSubsets(np.empty(count, np.intp), np.empty(count), np.empty((count, folds)))
    # subsets that begin alike share a batch
    alike_first = np.arange(count)
    if members.shape[1]:
        reversed_order = members.T[::-1]
        alike_first = np.lexsort(reversed_order)
    for start in range(0, count, BATCH):
        stop = start + BATCH
        batch = alike_first[start:stop]
        decisions = members[batch]
        figures = _walk(root, sizes, decisions)
        rank = len(base) + figures.rank
        subsets.rank[batch] = rank
        subsets.rss[batch] = figures.rss
        subsets.held_out[batch] = figures.held_out
    return subsets


def _scale_columns(folded: FoldedData, base: Sequence[int], columns: Sequence[int]) -> Array:
    """Compute the lengths (d,) of the columns and, as one, of the response; infinite for a column
    of zeros."""
    blocks = folded.blocks
    count = len(columns)
    chosen = blocks[:, :, columns]
    chosen = chosen.reshape(-1, count)
    norm = np.linalg.norm(chosen, axis=0)
    # a column of zeros is known by the largest column, the base's among them
    every = [*base, *columns]
    width = len(every)
    everything = blocks[:, :, every]
    everything = everything.reshape(-1, width)
    norms = np.linalg.norm(everything, axis=0)
    largest = norms.max(initial=0)
    smallest = ZERO_COLUMN * largest
    nonzero = norm > smallest
    norm = np.where(nonzero, norm, np.inf)
    return np.append(norm, 1.0)


def _walk(root: _Nodes, sizes: Sequence[int], members: Mask) -> OrthogonalSubsets:
    """Compute the figures of subsets (S, G), without the base's rank."""
    nodes = root
    count = len(members)
    node = np.zeros(count, np.intp)
    for g, width in enumerate(sizes):
        inside = members[:, g]
        branch = 2 * node + inside
        branch, node = np.unique(branch, return_inverse=True)
        parent = branch // 2
        decision = branch % 2
        without = np.flatnonzero(decision == 0)
        within = np.flatnonzero(decision)
        left_out = nodes.take(parent[without])
        left_out = left_out.leave_out(width)
        kept = nodes.take(parent[within])
        for _ in range(width):
            kept = kept.keep()
        joined = _join(left_out, kept)
        place = np.concatenate([without, within])
        order = np.argsort(place)
        nodes = joined.take(order)
    # what is left of the response
    residual = nodes.E[:, :, :, 0]
    squares = np.square(residual)
    held_out = squares.sum(2)
    held_out = np.where(nodes.sure, held_out, np.nan)
    corner = nodes.T[node, -1, 0, 0]
    return OrthogonalSubsets(nodes.rank[node], np.square(corner), held_out[node])


def _join(first: _Nodes, second: _Nodes) -> _Nodes:
    T = np.concatenate([first.T, second.T])
    E = np.concatenate([first.E, second.E])
    rank = np.concatenate([first.rank, second.rank])
    sure = np.concatenate([first.sure, second.sure])
    return _Nodes(T, E, rank, sure)


def _triangulate(matrix: Array) -> Array:
    """Compute triangular factors (…, c, c) of matrices (…, r, c)."""
    R = np.asarray(np.linalg.qr(matrix, mode="r"))
    *leading, rows, width = R.shape
    missing = width - rows
    if not missing:
        return R
    shape = (*leading, missing, width)
    zeros = np.zeros(shape)
    return np.concatenate([R, zeros], axis=-2)
