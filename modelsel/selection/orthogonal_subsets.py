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
from .cross_validation import DEPENDENT, FoldedData

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
        return _Nodes(_triangulate(self.T[..., width:]), self.E[..., width:], self.rank, self.sure)

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
    return sorted(range(len(groups)), key=lambda g: -len(groups[g]))


def project_base(folded: FoldedData, base: Sequence[int], columns: Sequence[int]) -> Projection:
    """Project the base out of the columns and the response, fold by fold.

    Returns T (K+1, d, d), the triangles of what the base leaves of the other folds' rows (entry K:
    of all rows), and E, K arrays (h, d), what it leaves of the fold's own rows under their fit."""
    chosen = [*base, *columns, -1]
    blocks = folded.blocks[:, :, chosen]
    folds, _, width = blocks.shape
    prior = np.zeros((0, width)) if folded.prior is None else folded.prior[:, chosen]
    b = len(base)
    everything = blocks.reshape(-1, width)
    size = np.linalg.norm(everything[:, :b], axis=0)
    T = np.empty((folds + 1, width - b, width - b))
    E = []
    for k in range(folds):
        training = np.delete(blocks, k, axis=0).reshape(-1, width)
        R, absent = _reduce_training(training, prior, size)
        T[k] = R[b:, b:]
        E.append(_predict_fold(blocks[k], R, absent))
    T[folds] = _reduce_training(everything, prior, size)[0][b:, b:]
    return T, E


def _reduce_training(training: Array, prior: Array, size: Array) -> tuple[Array, Mask]:
    """Triangle of training rows and prior, and the mask (b,) of base columns that the training rows
    do not have; such a column stays as fitted."""
    b = len(size)
    absent = np.linalg.norm(training[:, :b], axis=0) <= 1e-12 * size
    if absent.any():
        present = np.ones(training.shape[1], bool)
        present[:b] = ~absent
        training = training * present
        prior = prior * present
    return Reduction.empty(training.shape[1] - 1).add(training).add(prior).R, absent


def _predict_fold(block: Array, R: Array, absent: Mask) -> Array:
    """What the base leaves of a fold's rows (h, d) under the fit of the training triangle R."""
    b = len(absent)
    norm = np.linalg.norm(R[:b, :b], axis=0)
    unit = np.where(absent, np.inf, np.maximum(norm, TINY))
    through = np.linalg.lstsq(R[:b, :b] / unit, R[:b, b:], rcond=ZERO_COLUMN)[0]
    return np.asarray(block[:, b:] - (block[:, :b] / unit) @ through)


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
    sizes = [len(groups[g]) for g in order]
    columns = [c for g in order for c in groups[g]]
    T, E = project_base(folded, base, columns) if projection is None else projection
    scale = _scale_columns(folded, base, columns)
    rows = np.stack([_triangulate(e[None] / scale)[0] for e in E])
    root = _Nodes((T / scale)[None], rows[None], np.zeros(1, np.intp), np.ones((1, len(E)), bool))
    subsets = OrthogonalSubsets(
        np.empty(len(members), np.intp), np.empty(len(members)), np.empty((len(members), len(E)))
    )
    alike_first = np.arange(len(members))
    if members.shape[1]:
        alike_first = np.lexsort(members.T[::-1])
    for start in range(0, len(members), BATCH):
        batch = alike_first[start : start + BATCH]
        figures = _walk(root, sizes, members[batch])
        subsets.rank[batch] = len(base) + figures.rank
        subsets.rss[batch] = figures.rss
        subsets.held_out[batch] = figures.held_out
    return subsets


def _scale_columns(folded: FoldedData, base: Sequence[int], columns: Sequence[int]) -> Array:
    """Lengths (d,) of the columns and, as one, of the response; infinite for a column of zeros."""
    norm = np.linalg.norm(folded.blocks[:, :, columns].reshape(-1, len(columns)), axis=0)
    every = [*base, *columns]
    norms = np.linalg.norm(folded.blocks[:, :, every].reshape(-1, len(every)), axis=0)
    norm = np.where(norm > ZERO_COLUMN * norms.max(initial=0), norm, np.inf)
    return np.append(norm, 1.0)


def _walk(root: _Nodes, sizes: Sequence[int], members: Mask) -> OrthogonalSubsets:
    """Figures of subsets (S, G), without the base's rank."""
    nodes = root
    node = np.zeros(len(members), np.intp)
    for g, width in enumerate(sizes):
        branch, node = np.unique(2 * node + members[:, g], return_inverse=True)
        without = np.flatnonzero(branch % 2 == 0)
        within = np.flatnonzero(branch % 2)
        left_out = nodes.take(branch[without] // 2).leave_out(width)
        kept = nodes.take(branch[within] // 2)
        for _ in range(width):
            kept = kept.keep()
        nodes = _join(left_out, kept).take(np.argsort(np.concatenate([without, within])))
    held_out = np.square(nodes.E[:, :, :, 0]).sum(2)
    return OrthogonalSubsets(
        nodes.rank[node],
        np.square(nodes.T[node, -1, 0, 0]),
        np.where(nodes.sure, held_out, np.nan)[node],
    )


def _join(first: _Nodes, second: _Nodes) -> _Nodes:
    return _Nodes(
        np.concatenate([first.T, second.T]),
        np.concatenate([first.E, second.E]),
        np.concatenate([first.rank, second.rank]),
        np.concatenate([first.sure, second.sure]),
    )


def _triangulate(matrix: Array) -> Array:
    """Triangular factors (…, c, c) of matrices (…, r, c)."""
    R = np.asarray(np.linalg.qr(matrix, mode="r"))
    missing = matrix.shape[-1] - R.shape[-2]
    if not missing:
        return R
    zeros = np.zeros((*R.shape[:-2], missing, R.shape[-1]))
    return np.concatenate([R, zeros], axis=-2)
