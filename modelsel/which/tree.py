"""Given subsets by orthogonal factors: the walk of `search` on triangles, where squared sums lose too much.

The base is projected out by QR, once a fold. What is left of a fold is the triangle T of the other folds' candidates and
response, and the fold's own rows E beyond the others' fit. Keeping a column is a slice of T and one step on E, leaving columns
out a small QR of T, for all subsets and folds at once; nothing is refitted and no condition number is squared.
"""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .._typing import Array
from ..fitting.reduction import TOLERANCE, Reduction
from .folds import DEPENDENT, Folded

Mask = NDArray[np.bool_]
TOGETHER = 4096     # subsets walked at once


def projected(folded: Folded, base: Sequence[int], rest: Sequence[int]) -> tuple[Array, list[Array]]:
    """(T (K+1, d, d), E: K of (h, d)), the response last: what the base leaves of the other folds' columns `rest`, as a triangle
    (entry K: of all rows), and of the fold's own rows under their fit."""
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
        gone = np.linalg.norm(train[:, :b], axis=0) <= 1e-12 * size        # a column that only this fold has stays as fitted
        if gone.any():
            train = train * np.r_[~gone, np.ones(d, bool)]
        R = Reduction.empty(width - 1).add(train).add(prior * np.r_[~gone, np.ones(d, bool)]).R
        T[k] = R[b:, b:]
        if k < K:
            unit = np.where(gone, np.inf, np.maximum(np.linalg.norm(R[:b, :b], axis=0), 1e-300))
            through = np.linalg.lstsq(R[:b, :b] / unit, R[:b, b:], rcond=1e-13)[0]
            E.append(blocks[k][:, b:] - (blocks[k][:, :b] / unit) @ through)
    return T, E


def large_first(groups: Sequence[Sequence[int]]) -> list[int]:
    """The groups in the order of the walk: large ones nearest the root, where there are few nodes."""
    return sorted(range(len(groups)), key=lambda g: -len(groups[g]))


def refined(folded: Folded, base: Sequence[int], groups: Sequence[Sequence[int]], members: Mask,
            known: tuple[Array, list[Array]] | None = None) -> tuple[NDArray[np.intp], Array, Array]:
    """(rank (S,), residual sum of squares (S,), held-out sums of squares (S, K)) of the subsets `members` (S, G) of `groups` on
    top of independent base columns. A column that depends on the kept ones is left out, as `identify` does; nan where one rests
    on a fold alone. `known`: what `projected` gives for the groups' columns in the order of the walk."""
    walked = large_first(groups)
    groups, members = [groups[g] for g in walked], members[:, walked]
    rest = [c for columns in groups for c in columns]
    T, E = projected(folded, base, rest) if known is None else known
    scale = np.linalg.norm(folded.blocks[:, :, rest].reshape(-1, len(rest)), axis=0)
    largest = np.linalg.norm(folded.blocks[:, :, [*base, *rest]].reshape(-1, len(base) + len(rest)), axis=0).max(initial=0)
    scale = np.append(np.where(scale > 1e-13 * largest, scale, np.inf), 1.0)
    T, rows = T / scale, np.stack([_triangle(e[None] / scale)[0] for e in E])
    order = np.lexsort(members.T[::-1]) if members.shape[1] else np.arange(len(members))      # alike beginnings side by side
    rank, rss, held_out = np.empty(len(members), np.intp), np.empty(len(members)), np.empty((len(members), len(E)))
    for start in range(0, len(members), TOGETHER):
        some = order[start:start + TOGETHER]
        rank[some], rss[some], held_out[some] = _walk(T, rows, [len(g) for g in groups], members[some])
    return rank + len(base), rss, held_out


def _walk(T: Array, E: Array, sizes: Sequence[int], members: Mask) -> tuple[NDArray[np.intp], Array, Array]:
    """The same of subsets (S, G), without the base's rank: one node per beginning that some of them share."""
    node = np.zeros(len(members), np.intp)
    T, E, rank, sure = T[None], E[None], np.zeros(1, np.intp), np.ones((1, len(E)), bool)
    for g, width in enumerate(sizes):
        step, node = np.unique(2 * node + members[:, g], return_inverse=True)
        out, kept = np.flatnonzero(step % 2 == 0), np.flatnonzero(step % 2)
        left = _left_out(T, E, rank, sure, step[out] // 2, width)
        part: Nodes = (T[step[kept] // 2], E[step[kept] // 2], rank[step[kept] // 2], sure[step[kept] // 2])
        for _ in range(width):
            part = _kept(*part)
        place = np.argsort(np.concatenate([out, kept]))
        T, E, rank, sure = (np.concatenate(both)[place] for both in zip(left, part, strict=True))
    return rank[node], np.square(T[node, -1, 0, 0]), np.where(sure, np.square(E[:, :, :, 0]).sum(2), np.nan)[node]


Nodes = tuple[Array, Array, NDArray[np.intp], Mask]     # T, E, rank, whether every fold determines what is kept


def _left_out(T: Array, E: Array, rank: NDArray[np.intp], sure: Mask, which: NDArray[np.intp], width: int) -> Nodes:
    """Some nodes without their first columns."""
    return _triangle(T[which][..., width:]), E[which][..., width:], rank[which], sure[which]


def _kept(T: Array, E: Array, rank: NDArray[np.intp], sure: Mask) -> Nodes:
    """Nodes with their first column kept, or left out where it depends on those before it."""
    pivot = T[:, :, 0, 0]
    good = np.abs(pivot[:, -1]) > TOLERANCE
    held = np.square(pivot[:, :-1]) > DEPENDENT * np.square(pivot[:, -1:])
    step = T[:, :-1, 0, 1:] * np.where(held & good[:, None], 1 / np.where(held, pivot[:, :-1], 1.0), 0.0)[:, :, None]
    shorter = T[:, :, 1:, 1:]
    if not good.all():
        shorter = shorter.copy()
        shorter[~good] = _triangle(T[~good][..., 1:])
    return shorter, E[..., 1:] - E[..., :1] * step[:, :, None, :], rank + good, sure & (held | ~good[:, None])


def _triangle(A: Array) -> Array:
    """(…, c, c) triangular factors of (…, r, c)."""
    R = np.asarray(np.linalg.qr(A, mode="r"))
    short = A.shape[-1] - R.shape[-2]
    return R if not short else np.concatenate([R, np.zeros((*R.shape[:-2], short, R.shape[-1]))], axis=-2)
