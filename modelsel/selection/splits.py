"""Which configurations estimate and which are held out: spread in joints and covariates by
D-optimal exchange."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .._typing import Array, Index
from ..measurements.measurements import Measurements
from ..measurements.visits import order_units

SWEEPS = 40
LARGE = 20_000  # beyond it a seeded random choice covers everything by itself


def _features(data: Measurements, first: NDArray[np.intp], prismatic: tuple[bool, ...]) -> Array:
    """(blocks, d) of the rows `first`, in order of motion: first and second harmonics of every
    joint, approach, covariates and place in time, standardised."""
    parts: list[Array] = [data.approach[first], np.linspace(-1, 1, len(first))[:, None]]
    for j, slides in enumerate(prismatic):
        q = data.q[first, j]
        parts.append(
            np.stack(
                [q, q * q] if slides else [np.sin(q), np.cos(q), np.sin(2 * q), np.cos(2 * q)], 1
            )
        )
    parts += [values[first][:, None] for values in data.covariates.values()]
    X = np.concatenate(parts, axis=1)
    spread = X.std(0)
    X = (X - X.mean(0))[:, spread > 1e-9] / spread[spread > 1e-9]
    return np.concatenate([np.ones((len(X), 1)), X], axis=1)


def choose(
    data: Measurements, count: int, prismatic: tuple[bool, ...], rng: np.random.Generator
) -> NDArray[np.bool_]:
    """(m,) mask of the estimation rows: `count` configurations, equal readings never apart.

    Fedorov's exchange on the features' information: a start from the seed, then the pair of blocks
    that raises the determinant most changes places until none does (Fedorov 1972)."""
    block, first = order_units(data.block, data.progress)
    weight = np.bincount(np.unique(np.stack([block, data.configuration]), axis=1)[0])
    order = rng.permutation(len(first))
    inside = np.zeros(len(first), bool)
    inside[order[: int(np.searchsorted(np.cumsum(weight[order]), count)) + 1]] = True
    if len(first) <= LARGE and not inside.all():
        _exchange(_features(data, first, prismatic), inside, weight)
    return inside[block]


def _exchange(X: Array, inside: NDArray[np.bool_], weight: NDArray[np.intp]) -> None:
    """Exchange in place until no swap of equal numbers of configurations raises the determinant of
    the (slightly regularised) information."""
    d = X.shape[1]
    for _ in range(SWEEPS * max(1, int(np.sqrt(inside.sum())))):
        C = np.linalg.inv(X[inside].T @ X[inside] + 1e-6 * np.eye(d))
        out, into = np.flatnonzero(inside), np.flatnonzero(~inside)
        A, B = X[out] @ C, X[into] @ C
        leave, enter = np.einsum("id,id->i", A, X[out]), np.einsum("id,id->i", B, X[into])
        keep = np.argsort(leave)[:32]
        join = np.argsort(-enter)[:32]
        cross = A[keep] @ X[into[join]].T
        gain = (1 + enter[join])[None, :] * (1 - leave[keep])[
            :, None
        ] + cross**2  # determinant ratio of a swap
        gain[weight[out[keep]][:, None] != weight[into[join]][None, :]] = 0.0
        best = np.unravel_index(int(gain.argmax()), gain.shape)
        if gain[best] <= 1 + 1e-6:
            return
        inside[out[keep[best[0]]]], inside[into[join[best[1]]]] = False, True


def assign(
    data: Measurements, folds: int, rng: np.random.Generator, by: str = "configuration"
) -> Index:
    """(m,) fold of every row: equal readings never apart; by="group" keeps groups whole. folds = 0
    leaves one out."""
    unit, first = order_units(data.group if by == "group" else data.block, data.progress)
    count = len(first) if folds <= 0 else min(folds, len(first))
    order = rng.permutation(len(first))
    if (
        data.gauges is not None
    ):  # rows of one feature go to different folds: each can be told without any one of them
        order = order[np.argsort(data.gauges.feature[first][order], kind="stable")]
    fold = np.empty(len(first), dtype=np.intp)
    fold[order] = np.arange(len(first)) % count
    return fold[unit]
