"""All subsets of candidate mechanisms and all folds, exactly, by a tree of sweeps: nothing is
refitted.

The base is projected out by QR, once a fold; what is left of a fold is the training Schur
complement S of candidates and response and the held-out Gram W of their residuals. Leaving a group
out is a slice of both; keeping it is a sweep of both, column by column, for all nodes and folds at
once; the leaf is the held-out sum of squares (methods.md A.2). Subsets whose figures rounding may
have spoilt are worked out again from orthogonal factors (`orthogonal_subsets`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .._linalg import TINY
from .._typing import Array, Index, Mask
from ..fitting.identifiability import identify
from .cross_validation import FoldedData
from .orthogonal_subsets import (
    OrthogonalSubsets,
    Projection,
    order_groups,
    project_base,
    refine_subsets,
)

# share of a column's squared norm that the base must leave; below it rounding would be a pivot
MIN_SHARE = 1e-20
# relative error beyond which a subset is worked out again
MAX_ERROR = 2e-11
# numbers of S, and as many of W, that are swept together: they stay in a core's cache
CACHED_NUMBERS = 48_000
# pivot, relative to the column's size before any sweep, below which the column depends on those kept
MIN_PIVOT = 1e-9


@dataclass(frozen=True, eq=False)
class Subsets:
    """Figures of S subsets of G groups.

    members: mask (S, G) of the groups of every subset.
    rss, rank: (S,) residual sum of squares and rank on all rows.
    held_out: (S, K) sums of squares of every fold under the fit without it.
    pivot: (S,) smallest pivot relative to its column; the figures' error is about eps / pivot.
    """

    members: Mask
    rss: Array
    rank: Index
    held_out: Array
    pivot: Array


@dataclass(frozen=True, eq=False)
class _Nodes:
    """Subsets that agree on which groups are decided so far: `depth` groups.

    S, W: (d, d, nodes, K) matrices of the undecided columns and the response, the long axes last.
    members: (nodes, G); gained, pivot: (nodes, K) columns gained and smallest relative pivot.
    """

    depth: int
    S: Array
    W: Array
    members: Mask
    gained: Array
    pivot: Array

    def part(self, nodes: slice) -> _Nodes:
        """Copy some of the nodes."""
        return _Nodes(
            self.depth,
            self.S[:, :, nodes].copy(),
            self.W[:, :, nodes].copy(),
            self.members[nodes],
            self.gained[nodes],
            self.pivot[nodes],
        )


def sweep_subsets(
    folded: FoldedData, base: Sequence[int], groups: Sequence[Sequence[int]]
) -> Subsets:
    """Compute the figures of every subset of `groups` (lists of column indices) on top of the base
    columns, with every fold held out in turn.

    Columns are scaled to unit length here; base columns must be independent. Subset of bits b
    stands at place Σ b_j 2^j, j the groups in the order of `order_groups`."""
    order = order_groups(groups)
    columns = [c for g in order for c in groups[g]]
    projection = project_base(folded, base, columns)
    sizes = [len(group) for group in groups]
    root, first = _root(folded, columns, projection, len(groups))
    leaves = _walk(root, order, sizes, first)
    residual = leaves.S[0, 0]
    validated = leaves.W[0, 0]
    rss = residual[:, -1]
    # nothing is left but rounding
    epsilon = np.finfo(float).eps
    saturated = epsilon * residual[0, -1]
    gained = leaves.gained[:, -1].astype(np.intp)
    subsets = Subsets(
        leaves.members,
        np.maximum(rss, saturated),
        len(base) + gained,
        validated[:, :-1],
        leaves.pivot.min(1),
    )
    return _refine_doubtful(folded, base, groups, subsets, projection)


def _root(
    folded: FoldedData, columns: Sequence[int], projection: Projection, groups: int
) -> tuple[_Nodes, Array]:
    """Build the root of the tree, columns scaled to unit length, and their sizes (columns, K+1)
    before any sweep; infinite where the base spans the column, so that it is never a pivot."""
    T, E = projection
    # Gram matrices (K+1, d, d) of training and held-out rows
    transposed = T.transpose(0, 2, 1)
    S = transposed @ T
    validated = [e.T @ e for e in E]
    W = np.stack([*validated, S[-1]])
    # squared sizes of the columns, with the base and without it
    blocks = folded.blocks[:, :, columns]
    before = np.square(blocks)
    before = before.sum((0, 1))
    before = np.append(before, 1.0)
    spanned = MIN_SHARE * before
    first = np.einsum("kdd->dk", S)
    largest = np.maximum(first[:, -1], spanned)
    size = np.sqrt(largest)
    size[size == 0] = 1.0
    size[-1] = 1.0
    scale = np.outer(size, size)
    S = S / scale
    W = W / scale
    first = np.einsum("kdd->dk", S)
    square = size**2
    remaining = first * square[:, None]
    alive = remaining > spanned[:, None]
    first = np.where(alive, first, np.inf)
    folds = S.shape[0]
    S = S.transpose(1, 2, 0)
    W = W.transpose(1, 2, 0)
    S = np.ascontiguousarray(S)
    W = np.ascontiguousarray(W)
    members = np.zeros((1, groups), bool)
    gained = np.zeros((1, folds))
    pivot = np.ones((1, folds))
    root = _Nodes(0, S[:, :, None], W[:, :, None], members, gained, pivot)
    return root, first


def _walk(root: _Nodes, order: Sequence[int], sizes: Sequence[int], first: Array) -> _Nodes:
    """Walk the tree in pieces that stay in cache; return the leaves of all subsets, by their
    place."""
    groups = len(order)
    widths = [sizes[g] for g in order]
    edges = np.append(0, np.cumsum(widths))
    edges = edges.astype(int)
    stack = [root]
    leaves = []
    while stack:
        nodes = stack.pop()
        count = len(nodes.members)
        depth = nodes.depth
        large = nodes.S.size > CACHED_NUMBERS
        if depth == groups:
            leaves.append(nodes)
        elif large and count > 1:
            half = count // 2
            former = slice(half)
            latter = slice(half, None)
            stack.append(nodes.part(former))
            stack.append(nodes.part(latter))
        else:
            columns = slice(edges[depth], edges[depth + 1])
            size = np.maximum(first[columns], 1e-12)
            group = order[depth]
            children = _branch(nodes, group, size)
            stack.append(children)
    return _gather(leaves, order)


def _branch(nodes: _Nodes, group: int, first: Array) -> _Nodes:
    """Decide the next group: every node without it, then every node with it."""
    width = len(first)
    kept_S, kept_W, gained, pivot = _sweep(nodes.S, nodes.W, first)
    left_S = nodes.S[width:, width:]
    left_W = nodes.W[width:, width:]
    without_group = nodes.members
    with_group = without_group.copy()
    with_group[:, group] = True
    gained_with = nodes.gained + gained
    pivot_with = np.minimum(nodes.pivot, pivot)
    depth = nodes.depth + 1
    S = np.concatenate([left_S, kept_S], axis=2)
    W = np.concatenate([left_W, kept_W], axis=2)
    members = np.concatenate([without_group, with_group])
    gained = np.concatenate([nodes.gained, gained_with])
    pivot = np.concatenate([nodes.pivot, pivot_with])
    return _Nodes(depth, S, W, members, gained, pivot)


def _sweep(S: Array, W: Array, first: Array) -> tuple[Array, Array, Array, Array]:
    """Keep the first columns of S and W (d, d, nodes, K), one per row of `first` (columns, K),
    their sizes before any sweep.

    Returns S and W of the other columns, the columns really gained (nodes, K), and the smallest
    relative pivot (nodes, K)."""
    gained = np.zeros(S.shape[2:])
    smallest = np.ones(S.shape[2:])
    for size in first:
        pivot = S[0, 0]
        relative = pivot / size
        good = relative > MIN_PIVOT
        inverse = np.where(good, 1 / np.where(good, pivot, 1), 0)
        b = S[0, 1:] * inverse
        w = W[0, 1:]
        other = w - b * W[0, 0]
        W = W[1:, 1:] - b[:, None] * w
        W -= other[:, None] * b
        S = S[1:, 1:] - b[:, None] * S[0, 1:]
        gained += good
        smallest = np.minimum(smallest, np.where(good, relative, 1))
    return S, W, gained, smallest


def _gather(leaves: Sequence[_Nodes], order: Sequence[int]) -> _Nodes:
    """Concatenate leaves and sort them by place."""
    members = np.concatenate([leaf.members for leaf in leaves])
    gained = np.concatenate([leaf.gained for leaf in leaves])
    pivot = np.concatenate([leaf.pivot for leaf in leaves])
    S = np.concatenate([leaf.S for leaf in leaves], axis=2)
    W = np.concatenate([leaf.W for leaf in leaves], axis=2)
    depth = len(order)
    bits = 1 << np.arange(depth)
    decided = members[:, list(order)]
    number = decided @ bits
    place = np.argsort(number)
    S = S[:, :, place]
    W = W[:, :, place]
    members = members[place]
    gained = gained[place]
    pivot = pivot[place]
    return _Nodes(depth, S, W, members, gained, pivot)


def _refine_doubtful(
    folded: FoldedData,
    base: Sequence[int],
    groups: Sequence[Sequence[int]],
    subsets: Subsets,
    projection: Projection,
) -> Subsets:
    """Work out the doubtful subsets again by orthogonal factors.

    Doubtful are small pivots, and sums of squares that are a small difference of large ones; and,
    where the orthogonal factors of all columns together have a higher rank than the sweeps found,
    every subset that left a column out as dependent."""
    columns = [c for group in groups for c in group]
    every = dict.fromkeys([*base, *columns])
    total = folded.total.select(list(every))
    rank = identify(total).rank
    # sums of squares that are a small difference of large ones
    held_out = subsets.held_out
    first = held_out[0]
    share = held_out / first
    share = share.clip(TINY)
    share = share.min(1)
    epsilon = np.finfo(float).eps
    least = np.minimum(subsets.pivot, share)
    error = epsilon / least
    imprecise = error > MAX_ERROR
    skipped = np.zeros(len(error), bool)
    largest = subsets.rank.max()
    if rank > largest:
        sizes = [len(group) for group in groups]
        added = subsets.members @ np.array(sizes)
        full = len(base) + added
        skipped = subsets.rank < full
    doubtful = np.flatnonzero(imprecise | skipped)
    if not len(doubtful):
        return subsets
    members = subsets.members[doubtful]
    refined = refine_subsets(folded, base, groups, members, projection)
    swept_rank = subsets.rank[doubtful]
    same_rank = refined.rank == swept_rank
    same_rank = same_rank | skipped[doubtful]
    finite = np.isfinite(refined.held_out)
    determined = finite.all(1)
    # a subset that rests on one fold keeps the figures of the sweep
    sure = determined & same_rank
    rows = doubtful[sure]
    refined = refined.take(sure)
    return _replace_rows(subsets, rows, refined)


def _replace_rows(subsets: Subsets, rows: Index, refined: OrthogonalSubsets) -> Subsets:
    """Replace the figures of some subsets."""
    epsilon = np.finfo(float).eps
    saturated = epsilon * subsets.rss[0]
    rss = subsets.rss.copy()
    rank = subsets.rank.copy()
    held_out = subsets.held_out.copy()
    rss[rows] = np.maximum(refined.rss, saturated)
    rank[rows] = refined.rank
    held_out[rows] = refined.held_out
    return replace(subsets, rss=rss, rank=rank, held_out=held_out)


def evaluate_subsets(
    folded: FoldedData, base: Sequence[int], groups: Sequence[Sequence[int]], members: Mask
) -> Subsets:
    """Compute the figures of the given subsets (S, G) alone, each by orthogonal factors.

    The held-out sums of squares of a subset that rests on one fold are infinite."""
    refined = refine_subsets(folded, base, groups, members)
    finite = np.isfinite(refined.held_out)
    determined = finite.all(1, keepdims=True)
    held_out = np.where(determined, refined.held_out, np.inf)
    count = len(members)
    pivot = np.ones(count)
    return Subsets(members, refined.rss, refined.rank, held_out, pivot)
