"""All subsets of candidate mechanisms x all folds, exactly, by a tree of sweeps: nothing is refitted.

The base is projected out by QR, once a fold; what is left of a fold is the training Schur complement S of candidates and
response and the held-out Gram W of their residuals. Leaving a group out is a slice of both; keeping it is a sweep of
both, column by column, for all nodes and folds at once; the leaf is the held-out sum of squares (methods.md A.2).
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .._typing import Array
from ..fitting.identifiability import identify
from .folds import Folded
from .tree import large_first, projected, refined

ABSORBED = 1e-20   # share of a column's squared norm that the base must leave, else its rounding would be a pivot
DOUBT = 2e-11      # relative error beyond which a subset is worked out again
PIECE = 48_000     # numbers of S, and as many of W, that are walked at once: they stay in a core's cache
PIVOT = 1e-9       # of the column's own size before any sweep: below it the column depends on the kept ones


@dataclass(frozen=True, eq=False)
class Subsets:
    """2^G subsets: members (S, G) of booleans, rss (S,) and rank (S,) on all rows, held_out (S, K) sums of squares, and the
    smallest pivot (S,) relative to its column, which certifies the figures (error about eps / pivot)."""

    members: NDArray[np.bool_]
    rss: Array
    rank: NDArray[np.intp]
    held_out: Array
    pivot: Array


def _sweep(S: Array, W: Array, first: Array, columns: int) -> tuple[Array, Array, Array, Array]:
    """Keep the first `columns` columns of S, W (d, d, nodes, K), whose sizes before any sweep are `first` (columns, K): (S, W)
    of the others, columns really gained (nodes, K), smallest relative pivot."""
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


Node = tuple[int, Array, Array, NDArray[np.bool_], Array, Array]   # depth; S, W, members, gained, pivot of several subsets


def _leaves(root: Node, order: Sequence[int], sizes: Sequence[int], first: Array
            ) -> tuple[Array, Array, NDArray[np.bool_], Array, Array]:
    """(S, W, members, gained, pivot) of all subsets, S and W (subsets, K) what is left of the response. The subset of bits b of
    `order` stands at place Σ b_j 2^j; the tree is walked in pieces that stay in cache."""
    done = np.concatenate([[0], np.cumsum([sizes[g] for g in order])]).astype(int)
    stack, leaves = [root], []
    while stack:
        depth, S, W, members, gained, pivot = stack.pop()
        if depth == len(order):
            leaves.append((S[0, 0], W[0, 0], members, gained, pivot))
            continue
        if S.size > PIECE and len(members) > 1:
            half = len(members) // 2
            stack += [(depth, S[:, :, part].copy(), W[:, :, part].copy(), members[part], gained[part], pivot[part])
                      for part in (slice(half), slice(half, None))]
            continue
        g = order[depth]
        width = sizes[g]
        at = np.maximum(first[done[depth]:done[depth] + width], 1e-12)
        kept_S, kept_W, more, worst = _sweep(S, W, at, width)
        with_g = members.copy()
        with_g[:, g] = True
        stack.append((depth + 1, np.concatenate([S[width:, width:], kept_S], axis=2),
                      np.concatenate([W[width:, width:], kept_W], axis=2), np.concatenate([members, with_g]),
                      np.concatenate([gained, gained + more]), np.concatenate([pivot, np.minimum(pivot, worst)])))
    S, W, members, gained, pivot = (np.concatenate(parts) for parts in zip(*leaves, strict=True))
    place = np.argsort(members[:, list(order)] @ (1 << np.arange(len(order))))
    return S[place], W[place], members[place], gained[place], pivot[place]


def all_subsets(folded: Folded, base: Sequence[int], groups: Sequence[Sequence[int]]) -> Subsets:
    """Every subset of `groups` (lists of column indices) on top of the base columns, with every fold held out in turn.

    Columns are scaled to unit length here; base columns must be independent.
    """
    order = large_first(groups)
    rest = [c for g in order for c in groups[g]]
    T, E = projected(folded, base, rest)
    S = T.transpose(0, 2, 1) @ T
    W = np.stack([*(e.T @ e for e in E), S[-1]])
    before = np.append(np.square(folded.blocks[:, :, rest]).sum((0, 1)), 1.0)
    size = np.sqrt(np.maximum(np.einsum("kdd->kd", S)[-1], ABSORBED * before))
    size[size == 0] = 1.0
    size[-1] = 1.0
    S, W = S / np.outer(size, size), W / np.outer(size, size)
    first = np.einsum("kdd->dk", S)
    first = np.where(first * size[:, None] ** 2 > ABSORBED * before[:, None], first, np.inf)    # the base spans it: never a pivot
    S, W = (np.ascontiguousarray(A.transpose(1, 2, 0))[:, :, None] for A in (S, W))             # the long axes last
    root = (0, S, W, np.zeros((1, len(groups)), bool), np.zeros(S.shape[2:]), np.ones(S.shape[2:]))
    S, W, members, gained, pivot = _leaves(root, order, [len(g) for g in groups], first)
    rss = np.maximum(S[:, -1], np.finfo(float).eps * S[0, -1])     # saturated: nothing is left but rounding
    held_out = W[:, :-1]
    found = Subsets(members, rss, len(base) + gained[:, -1].astype(np.intp), held_out, pivot.min(1))
    return _redone(folded, base, groups, found, (T, E))


def _redone(folded: Folded, base: Sequence[int], groups: Sequence[Sequence[int]], found: Subsets,
            known: tuple[Array, list[Array]]) -> Subsets:
    """The doubtful subsets once more by orthogonal factors: small pivots, or sums of squares that are a small difference of
    large ones; and, where the orthogonal factors of all columns together see more directions than the sweeps did, every subset
    that left a column out as dependent."""
    whole = list(dict.fromkeys([*base, *(c for g in groups for c in g)]))
    near = identify(folded.total.select(whole)).rank > found.rank.max()
    lost = np.finfo(float).eps / np.minimum(found.pivot, (found.held_out / found.held_out[0]).clip(1e-300).min(1))
    skipped: NDArray[np.bool_] = (found.rank < len(base) + found.members @ np.array([len(g) for g in groups])) & np.bool_(near)
    again = np.flatnonzero(np.logical_or(lost > DOUBT, skipped))
    if not len(again):
        return found
    rank, rss, held_out = refined(folded, base, groups, found.members[again], known)
    sure = np.isfinite(held_out).all(1) & np.logical_or(rank == found.rank[again], skipped[again])
    again, out = again[sure], (found.rank.copy(), found.rss.copy(), found.held_out.copy())
    out[0][again], out[2][again] = rank[sure], held_out[sure]
    out[1][again] = np.maximum(rss[sure], np.finfo(float).eps * found.rss[0])
    return Subsets(found.members, out[1], out[0], out[2], found.pivot)


def some_subsets(folded: Folded, base: Sequence[int], groups: Sequence[Sequence[int]], members: NDArray[np.bool_]) -> Subsets:
    """The given subsets (S, G) alone, each by orthogonal factors; those that rest on one fold are held out at infinity."""
    rank, rss, held_out = refined(folded, base, groups, members)
    held_out = np.where(np.isfinite(held_out).all(1, keepdims=True), held_out, np.inf)
    return Subsets(members, rss, rank, held_out, np.ones(len(members)))
