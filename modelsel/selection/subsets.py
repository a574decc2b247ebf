"""All subsets of candidate mechanisms x all folds, exactly, by a tree of sweeps: nothing is
refitted.

The base is projected out by QR, once a fold; what is left of a fold is the training Schur
complement S of candidates and response and the held-out Gram W of their residuals. Leaving a group
out is a slice of both; keeping it is a sweep of both, column by column, for all nodes and folds at
once; the leaf is the held-out sum of squares (methods.md A.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .._typing import Array
from ..fitting.identifiability import identify
from ..fitting.reduction import TOLERANCE, Reduction
from .cross_validation import DEPENDENT, FoldedData

# share of a column's squared norm that the base must leave, else its rounding would be a pivot
ABSORBED = 1e-20
DOUBT = 2e-11  # relative error beyond which a subset is worked out again
PIECE = (
    48_000  # numbers of S, and as many of W, that are walked at once: they stay in a core's cache
)
PIVOT = (
    1e-9  # of the column's own size before any sweep: below it the column depends on the kept ones
)


@dataclass(frozen=True, eq=False)
class Subsets:
    """2^G subsets: members (S, G) of booleans, rss (S,) and rank (S,) on all rows, held_out (S, K)
    sums of squares, and the smallest pivot (S,) relative to its column, which certifies the figures
    (error about eps / pivot)."""

    members: NDArray[np.bool_]
    rss: Array
    rank: NDArray[np.intp]
    held_out: Array
    pivot: Array


def _sweep(S: Array, W: Array, first: Array, columns: int) -> tuple[Array, Array, Array, Array]:
    """Keep the first `columns` columns of S, W (d, d, nodes, K), whose sizes before any sweep are
    `first` (columns, K): (S, W) of the others, columns really gained (nodes, K), smallest relative
    pivot."""
    gained = np.zeros(S.shape[2:])
    worst = np.ones(S.shape[2:])
    for j in range(columns):
        s = S[0, 0]
        relative = s / first[j]
        good = relative > PIVOT
        b = S[0, 1:] * np.where(good, 1 / np.where(good, s, 1), 0)
        w = W[0, 1:]
        other = w - b * W[0, 0]
        W = W[1:, 1:] - b[:, None] * w
        W -= other[:, None] * b
        S = S[1:, 1:] - b[:, None] * S[0, 1:]
        gained += good
        worst = np.minimum(worst, np.where(good, relative, 1))
    return S, W, gained, worst


Node = tuple[
    int, Array, Array, NDArray[np.bool_], Array, Array
]  # depth; S, W, members, gained, pivot of several subsets


def _leaves(
    root: Node, order: Sequence[int], sizes: Sequence[int], first: Array
) -> tuple[Array, Array, NDArray[np.bool_], Array, Array]:
    """(S, W, members, gained, pivot) of all subsets, S and W (subsets, K) what is left of the
    response. The subset of bits b of `order` stands at place Σ b_j 2^j; the tree is walked in
    pieces that stay in cache."""
    done = np.concatenate([[0], np.cumsum([sizes[g] for g in order])]).astype(int)
    stack, leaves = [root], []
    while stack:
        depth, S, W, members, gained, pivot = stack.pop()
        if depth == len(order):
            leaves.append((S[0, 0], W[0, 0], members, gained, pivot))
            continue
        if S.size > PIECE and len(members) > 1:
            half = len(members) // 2
            stack += [
                (
                    depth,
                    S[:, :, part].copy(),
                    W[:, :, part].copy(),
                    members[part],
                    gained[part],
                    pivot[part],
                )
                for part in (slice(half), slice(half, None))
            ]
            continue
        g = order[depth]
        width = sizes[g]
        at = np.maximum(first[done[depth] : done[depth] + width], 1e-12)
        kept_S, kept_W, more, worst = _sweep(S, W, at, width)
        with_g = members.copy()
        with_g[:, g] = True
        stack.append(
            (
                depth + 1,
                np.concatenate([S[width:, width:], kept_S], axis=2),
                np.concatenate([W[width:, width:], kept_W], axis=2),
                np.concatenate([members, with_g]),
                np.concatenate([gained, gained + more]),
                np.concatenate([pivot, np.minimum(pivot, worst)]),
            )
        )
    S, W, members, gained, pivot = (np.concatenate(parts) for parts in zip(*leaves, strict=True))
    place = np.argsort(members[:, list(order)] @ (1 << np.arange(len(order))))
    return S[place], W[place], members[place], gained[place], pivot[place]


def sweep_subsets(
    folded: FoldedData, base: Sequence[int], groups: Sequence[Sequence[int]]
) -> Subsets:
    """Every subset of `groups` (lists of column indices) on top of the base columns, with every
    fold held out in turn.

    Columns are scaled to unit length here; base columns must be independent.
    """
    order = order_groups(groups)
    rest = [c for g in order for c in groups[g]]
    T, E = project_base(folded, base, rest)
    S = T.transpose(0, 2, 1) @ T
    W = np.stack([*(e.T @ e for e in E), S[-1]])
    before = np.append(np.square(folded.blocks[:, :, rest]).sum((0, 1)), 1.0)
    size = np.sqrt(np.maximum(np.einsum("kdd->kd", S)[-1], ABSORBED * before))
    size[size == 0] = 1.0
    size[-1] = 1.0
    S, W = S / np.outer(size, size), W / np.outer(size, size)
    first = np.einsum("kdd->dk", S)
    first = np.where(
        first * size[:, None] ** 2 > ABSORBED * before[:, None], first, np.inf
    )  # the base spans it: never a pivot
    S, W = (
        np.ascontiguousarray(A.transpose(1, 2, 0))[:, :, None] for A in (S, W)
    )  # the long axes last
    root = (0, S, W, np.zeros((1, len(groups)), bool), np.zeros(S.shape[2:]), np.ones(S.shape[2:]))
    S, W, members, gained, pivot = _leaves(root, order, [len(g) for g in groups], first)
    rss = np.maximum(
        S[:, -1], np.finfo(float).eps * S[0, -1]
    )  # saturated: nothing is left but rounding
    held_out = W[:, :-1]
    found = Subsets(members, rss, len(base) + gained[:, -1].astype(np.intp), held_out, pivot.min(1))
    return _redone(folded, base, groups, found, (T, E))


def _redone(
    folded: FoldedData,
    base: Sequence[int],
    groups: Sequence[Sequence[int]],
    found: Subsets,
    known: tuple[Array, list[Array]],
) -> Subsets:
    """The doubtful subsets once more by orthogonal factors: small pivots, or sums of squares that
    are a small difference of large ones; and, where the orthogonal factors of all columns together
    see more directions than the sweeps did, every subset that left a column out as dependent."""
    whole = list(dict.fromkeys([*base, *(c for g in groups for c in g)]))
    near = identify(folded.total.select(whole)).rank > found.rank.max()
    lost = np.finfo(float).eps / np.minimum(
        found.pivot, (found.held_out / found.held_out[0]).clip(1e-300).min(1)
    )
    skipped: NDArray[np.bool_] = (
        found.rank < len(base) + found.members @ np.array([len(g) for g in groups])
    ) & np.bool_(near)
    again = np.flatnonzero(np.logical_or(lost > DOUBT, skipped))
    if not len(again):
        return found
    rank, rss, held_out = refine_subsets(folded, base, groups, found.members[again], known)
    sure = np.isfinite(held_out).all(1) & np.logical_or(rank == found.rank[again], skipped[again])
    again, out = again[sure], (found.rank.copy(), found.rss.copy(), found.held_out.copy())
    out[0][again], out[2][again] = rank[sure], held_out[sure]
    out[1][again] = np.maximum(rss[sure], np.finfo(float).eps * found.rss[0])
    return Subsets(found.members, out[1], out[0], out[2], found.pivot)


def evaluate_subsets(
    folded: FoldedData,
    base: Sequence[int],
    groups: Sequence[Sequence[int]],
    members: NDArray[np.bool_],
) -> Subsets:
    """The given subsets (S, G) alone, each by orthogonal factors; those that rest on one fold are
    held out at infinity."""
    rank, rss, held_out = refine_subsets(folded, base, groups, members)
    held_out = np.where(np.isfinite(held_out).all(1, keepdims=True), held_out, np.inf)
    return Subsets(members, rss, rank, held_out, np.ones(len(members)))


# Given subsets by orthogonal factors: the walk of `search` on triangles, where squared sums lose
# too much.

Mask = NDArray[np.bool_]
TOGETHER = 4096  # subsets walked at once


def project_base(
    folded: FoldedData, base: Sequence[int], rest: Sequence[int]
) -> tuple[Array, list[Array]]:
    """(T (K+1, d, d), E: K of (h, d)), the response last: what the base leaves of the other folds'
    columns `rest`, as a triangle (entry K: of all rows), and of the fold's own rows under their
    fit."""
    blocks = folded.blocks[:, :, [*base, *rest, -1]]
    prior = np.zeros((0, folded.blocks.shape[2])) if folded.prior is None else folded.prior
    prior = prior[:, [*base, *rest, -1]]
    K, _, width = blocks.shape
    b, d = len(base), width - len(base)
    T, E = np.empty((K + 1, d, d)), []
    everything = blocks.reshape(-1, width)
    size = np.linalg.norm(everything[:, :b], axis=0)
    for k in range(K + 1):
        train = everything if k == K else np.delete(blocks, k, axis=0).reshape(-1, width)
        gone = (
            np.linalg.norm(train[:, :b], axis=0) <= 1e-12 * size
        )  # a column that only this fold has stays as fitted
        if gone.any():
            train = train * np.r_[~gone, np.ones(d, bool)]
        R = Reduction.empty(width - 1).add(train).add(prior * np.r_[~gone, np.ones(d, bool)]).R
        T[k] = R[b:, b:]
        if k < K:
            unit = np.where(gone, np.inf, np.maximum(np.linalg.norm(R[:b, :b], axis=0), 1e-300))
            through = np.linalg.lstsq(R[:b, :b] / unit, R[:b, b:], rcond=1e-13)[0]
            E.append(blocks[k][:, b:] - (blocks[k][:, :b] / unit) @ through)
    return T, E


def order_groups(groups: Sequence[Sequence[int]]) -> list[int]:
    """The groups in the order of the walk: large ones nearest the root, where there are few
    nodes."""
    return sorted(range(len(groups)), key=lambda g: -len(groups[g]))


def refine_subsets(
    folded: FoldedData,
    base: Sequence[int],
    groups: Sequence[Sequence[int]],
    members: Mask,
    known: tuple[Array, list[Array]] | None = None,
) -> tuple[NDArray[np.intp], Array, Array]:
    """(rank (S,), residual sum of squares (S,), held-out sums of squares (S, K)) of the subsets
    `members` (S, G) of `groups` on top of independent base columns. A column that depends on the
    kept ones is left out, as `identify` does; nan where one rests on a fold alone. `known`: what
    `projected` gives for the groups' columns in the order of the walk."""
    walked = order_groups(groups)
    groups, members = [groups[g] for g in walked], members[:, walked]
    rest = [c for columns in groups for c in columns]
    T, E = project_base(folded, base, rest) if known is None else known
    scale = np.linalg.norm(folded.blocks[:, :, rest].reshape(-1, len(rest)), axis=0)
    largest = np.linalg.norm(
        folded.blocks[:, :, [*base, *rest]].reshape(-1, len(base) + len(rest)), axis=0
    ).max(initial=0)
    scale = np.append(np.where(scale > 1e-13 * largest, scale, np.inf), 1.0)
    T, rows = T / scale, np.stack([_triangle(e[None] / scale)[0] for e in E])
    order = (
        np.lexsort(members.T[::-1]) if members.shape[1] else np.arange(len(members))
    )  # alike beginnings side by side
    rank, rss, held_out = (
        np.empty(len(members), np.intp),
        np.empty(len(members)),
        np.empty((len(members), len(E))),
    )
    for start in range(0, len(members), TOGETHER):
        some = order[start : start + TOGETHER]
        rank[some], rss[some], held_out[some] = _walk(
            T, rows, [len(g) for g in groups], members[some]
        )
    return rank + len(base), rss, held_out


def _walk(
    T: Array, E: Array, sizes: Sequence[int], members: Mask
) -> tuple[NDArray[np.intp], Array, Array]:
    """The same of subsets (S, G), without the base's rank: one node per beginning that some of them
    share."""
    node = np.zeros(len(members), np.intp)
    T, E, rank, sure = T[None], E[None], np.zeros(1, np.intp), np.ones((1, len(E)), bool)
    for g, width in enumerate(sizes):
        step, node = np.unique(2 * node + members[:, g], return_inverse=True)
        out, kept = np.flatnonzero(step % 2 == 0), np.flatnonzero(step % 2)
        left = _left_out(T, E, rank, sure, step[out] // 2, width)
        part: Nodes = (
            T[step[kept] // 2],
            E[step[kept] // 2],
            rank[step[kept] // 2],
            sure[step[kept] // 2],
        )
        for _ in range(width):
            part = _kept(*part)
        place = np.argsort(np.concatenate([out, kept]))
        T, E, rank, sure = (np.concatenate(both)[place] for both in zip(left, part, strict=True))
    return (
        rank[node],
        np.square(T[node, -1, 0, 0]),
        np.where(sure, np.square(E[:, :, :, 0]).sum(2), np.nan)[node],
    )


Nodes = tuple[
    Array, Array, NDArray[np.intp], Mask
]  # T, E, rank, whether every fold determines what is kept


def _left_out(
    T: Array, E: Array, rank: NDArray[np.intp], sure: Mask, which: NDArray[np.intp], width: int
) -> Nodes:
    """Some nodes without their first columns."""
    return _triangle(T[which][..., width:]), E[which][..., width:], rank[which], sure[which]


def _kept(T: Array, E: Array, rank: NDArray[np.intp], sure: Mask) -> Nodes:
    """Nodes with their first column kept, or left out where it depends on those before it."""
    pivot = T[:, :, 0, 0]
    good = np.abs(pivot[:, -1]) > TOLERANCE
    held = np.square(pivot[:, :-1]) > DEPENDENT * np.square(pivot[:, -1:])
    step = (
        T[:, :-1, 0, 1:]
        * np.where(held & good[:, None], 1 / np.where(held, pivot[:, :-1], 1.0), 0.0)[:, :, None]
    )
    shorter = T[:, :, 1:, 1:]
    if not good.all():
        shorter = shorter.copy()
        shorter[~good] = _triangle(T[~good][..., 1:])
    return (
        shorter,
        E[..., 1:] - E[..., :1] * step[:, :, None, :],
        rank + good,
        sure & (held | ~good[:, None]),
    )


def _triangle(A: Array) -> Array:
    """(…, c, c) triangular factors of (…, r, c)."""
    R = np.asarray(np.linalg.qr(A, mode="r"))
    short = A.shape[-1] - R.shape[-2]
    return (
        R
        if not short
        else np.concatenate([R, np.zeros((*R.shape[:-2], short, R.shape[-1]))], axis=-2)
    )
