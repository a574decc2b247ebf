"""Split of configurations into estimation and held-out ones by D-optimal exchange, and folds for
cross-validation."""

from __future__ import annotations

import numpy as np

from .._typing import Array, Index, Mask
from ..measurements.measurements import Measurements
from ..measurements.visits import order_units

# exchanges per square root of the number of estimation blocks
MAX_EXCHANGES = 40
# blocks beyond which a random choice covers everything by itself
MAX_EXCHANGED_BLOCKS = 20_000
# blocks that are tried for leaving, and for joining, at every exchange
CANDIDATES = 32
# factor by which an exchange must raise the determinant, beyond one
MIN_INCREASE = 1e-6


def split_configurations(
    data: Measurements, count: int, prismatic: tuple[bool, ...], rng: np.random.Generator
) -> Mask:
    """Choose `count` configurations for estimation: mask (m,) of their rows.

    Equal readings stay together. Fedorov's exchange on the features' information: from a random
    start, the pair of blocks whose exchange raises the determinant most changes places until none
    does (Fedorov 1972)."""
    block, first = order_units(data.block, data.progress)
    configurations = np.unique(np.stack([block, data.configuration]), axis=1)
    weight = np.bincount(configurations[0])
    order = rng.permutation(len(first))
    chosen = int(np.searchsorted(np.cumsum(weight[order]), count)) + 1
    inside = np.zeros(len(first), bool)
    inside[order[:chosen]] = True
    if len(first) <= MAX_EXCHANGED_BLOCKS and not inside.all():
        _exchange(_features(data, first, prismatic), inside, weight)
    return inside[block]


def _features(data: Measurements, first: Index, prismatic: tuple[bool, ...]) -> Array:
    """Features (blocks, d) of the rows `first`, in order of motion: first and second harmonics of
    every joint, approach, covariates and place in time, standardised, and a constant."""
    parts: list[Array] = [data.approach[first], np.linspace(-1, 1, len(first))[:, None]]
    for j, slides in enumerate(prismatic):
        q = data.q[first, j]
        waves = [q, q * q] if slides else [np.sin(q), np.cos(q), np.sin(2 * q), np.cos(2 * q)]
        parts.append(np.stack(waves, 1))
    parts += [values[first][:, None] for values in data.covariates.values()]
    features = np.concatenate(parts, axis=1)
    deviation = features.std(0)
    varies = deviation > 1e-9
    standard = (features - features.mean(0))[:, varies] / deviation[varies]
    return np.concatenate([np.ones((len(standard), 1)), standard], axis=1)


def _exchange(features: Array, inside: Mask, weight: Index) -> None:
    """Exchange blocks in place until no swap of equal numbers of configurations raises the
    determinant of the (slightly regularised) information."""
    for _ in range(MAX_EXCHANGES * max(1, int(np.sqrt(inside.sum())))):
        swap = _find_swap(features, inside, weight)
        if swap is None:
            return
        leaving, joining = swap
        inside[leaving] = False
        inside[joining] = True


def _find_swap(features: Array, inside: Mask, weight: Index) -> tuple[int, int] | None:
    """Find the exchange that raises the determinant most: (block leaving, block joining).

    With C the inverse information, d_ij = x_iᵀ C x_j, a swap of i for j multiplies the determinant
    by (1 + d_jj)(1 − d_ii) + d_ij²."""
    X = features[inside]
    C = np.linalg.inv(X.T @ X + 1e-6 * np.eye(features.shape[1]))
    out, into = np.flatnonzero(inside), np.flatnonzero(~inside)
    projected_out, projected_in = features[out] @ C, features[into] @ C
    leave = np.einsum("id,id->i", projected_out, features[out])
    enter = np.einsum("id,id->i", projected_in, features[into])
    keep = np.argsort(leave)[:CANDIDATES]
    join = np.argsort(-enter)[:CANDIDATES]
    cross = projected_out[keep] @ features[into[join]].T
    ratio = (1 + enter[join])[None, :] * (1 - leave[keep])[:, None] + cross**2
    ratio[weight[out[keep]][:, None] != weight[into[join]][None, :]] = 0.0
    i, j = np.unravel_index(int(ratio.argmax()), ratio.shape)
    if ratio[i, j] <= 1 + MIN_INCREASE:
        return None
    return int(out[keep[i]]), int(into[join[j]])


def assign_folds(
    data: Measurements, folds: int, rng: np.random.Generator, by: str = "configuration"
) -> Index:
    """Assign every row (m,) to a fold; equal readings stay together.

    by="group" keeps groups whole. folds = 0 leaves one unit out at a time."""
    unit, first = order_units(data.group if by == "group" else data.block, data.progress)
    count = len(first) if folds <= 0 else min(folds, len(first))
    order = rng.permutation(len(first))
    if data.gauges is not None:
        # rows of one feature go to different folds: each is estimable without any one of them
        feature = data.gauges.feature[first][order]
        order = order[np.argsort(feature, kind="stable")]
    fold = np.empty(len(first), dtype=np.intp)
    fold[order] = np.arange(len(first)) % count
    return fold[unit]
