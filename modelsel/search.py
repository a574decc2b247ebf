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

from .errors import NotEstimable
from .folds import Folded, cross_validate
from .identify import identify, solve
from .reduce import Reduction
from .rigid import Array

ABSORBED = 1e-20   # share of a column's squared norm that the base must leave, else its rounding would be a pivot
DOUBT = 2e-11      # relative error beyond which a subset is worked out again
REDONE = 64
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


def _projected(folded: Folded, base: Sequence[int], rest: Sequence[int]) -> tuple[Array, Array]:
    """(S, W), each (K+1, d, d) with the response last: entry K is all rows, trained and held out alike."""
    blocks = folded.blocks[:, :, [*base, *rest, -1]]
    K, _, width = blocks.shape
    b, d = len(base), width - len(base)
    S, W = np.empty((K + 1, d, d)), np.empty((K + 1, d, d))
    everything = blocks.reshape(-1, width)
    for k in range(K + 1):
        train = everything if k == K else np.delete(blocks, k, axis=0).reshape(-1, width)
        R = Reduction.empty(width - 1).add(train).R
        inner = R[b:, b:]
        S[k] = inner.T @ inner
        test = everything if k == K else blocks[k]
        unit = np.maximum(np.linalg.norm(R[:b, :b], axis=0), 1e-300)
        left = test[:, b:] - (test[:, :b] / unit) @ np.linalg.lstsq(R[:b, :b] / unit, R[:b, b:], rcond=1e-13)[0]
        W[k] = left.T @ left
    return S, W


def _sweep(S: Array, W: Array, first: Array, columns: int) -> tuple[Array, Array, Array, Array]:
    """Keep the first `columns` columns: (S, W) of the others, columns really gained (nodes, K), smallest relative pivot."""
    gained = np.zeros(S.shape[:2])
    worst = np.ones(S.shape[:2])
    for j in range(columns):
        s = S[..., 0, 0]
        relative = s / first[..., j]
        good = relative > PIVOT
        b = np.where(good[..., None], S[..., 0, 1:] / np.where(good, s, 1)[..., None], 0)
        cross = b[..., :, None] * W[..., None, 0, 1:]
        W = (W[..., 1:, 1:] - cross - cross.swapaxes(-1, -2)
             + (b * W[..., :1, 0])[..., :, None] * b[..., None, :])
        S = S[..., 1:, 1:] - b[..., :, None] * S[..., None, 0, 1:] * good[..., None, None]
        gained += good
        worst = np.minimum(worst, np.where(good, relative, 1))
    return S, W, gained, worst


def all_subsets(folded: Folded, base: Sequence[int], groups: Sequence[Sequence[int]]) -> Subsets:
    """Every subset of `groups` (lists of column indices) on top of the base columns, with every fold held out in turn.

    Columns are scaled to unit length here; base columns must be independent.
    """
    order = sorted(range(len(groups)), key=lambda g: -len(groups[g]))           # large groups nearest the root
    rest = [c for g in order for c in groups[g]]
    S, W = _projected(folded, base, rest)
    before = np.append(np.square(folded.blocks[:, :, rest]).sum((0, 1)), 1.0)
    size = np.sqrt(np.maximum(np.einsum("kdd->kd", S)[-1], ABSORBED * before))
    size[size == 0] = 1.0
    size[-1] = 1.0
    S, W = S / np.outer(size, size), W / np.outer(size, size)
    first = np.einsum("kdd->kd", S)[None]
    first = np.where(first * size ** 2 > ABSORBED * before, first, np.inf)       # the base spans it: never a pivot
    S, W = S[None], W[None]
    members = np.zeros((1, len(groups)), bool)
    gained, pivot = np.zeros((1, S.shape[1])), np.ones((1, S.shape[1]))
    done = 0
    for g in order:
        width = len(groups[g])
        at = np.maximum(first[:, :, done:done + width], 1e-12)
        kept_S, kept_W, more, worst = _sweep(S, W, at, width)
        S = np.concatenate([S[..., width:, width:], kept_S])
        W = np.concatenate([W[..., width:, width:], kept_W])
        gained = np.concatenate([gained, gained + more])
        pivot = np.concatenate([pivot, np.minimum(pivot, worst)])
        with_g = members.copy()
        with_g[:, g] = True
        members = np.concatenate([members, with_g])
        done += width
    rss = np.maximum(S[:, -1, 0, 0], np.finfo(float).eps * S[0, -1, 0, 0])     # saturated: nothing is left but rounding
    held_out = W[:, :-1, 0, 0]
    found = Subsets(members, rss, len(base) + gained[:, -1].astype(np.intp), held_out, pivot.min(1))
    return _redone(folded, base, groups, found)


def _redone(folded: Folded, base: Sequence[int], groups: Sequence[Sequence[int]], found: Subsets) -> Subsets:
    """The doubtful subsets once more by orthogonal factors: small pivots, or sums of squares that are a small difference of
    large ones; the most doubtful first, and no more than REDONE."""
    lost = np.finfo(float).eps / np.minimum(found.pivot, (found.held_out / found.held_out[0]).clip(1e-300).min(1))
    worst = np.argsort(-lost, kind="stable")[:REDONE]
    held_out, rss = found.held_out.copy(), found.rss.copy()
    for s in worst[lost[worst] > DOUBT]:
        columns = list(dict.fromkeys([*base, *(c for g in np.flatnonzero(found.members[s]).tolist() for c in groups[g])]))
        kept = [columns[k] for k in identify(folded.total().select(columns)).kept]
        if len(kept) != found.rank[s]:
            continue
        try:
            held_out[s] = cross_validate(folded, kept).held_out
        except NotEstimable:
            continue
        rss[s] = max(solve(folded.total(), kept)[2], float(np.finfo(float).eps * found.rss[0]))
    return Subsets(found.members, rss, found.rank, held_out, found.pivot)
