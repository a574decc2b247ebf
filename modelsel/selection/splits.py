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
    blocks = len(first)
    pairs = np.stack([block, data.configuration])
    configurations = np.unique(pairs, axis=1)
    block_of = configurations[0]
    weight = np.bincount(block_of)
    order = rng.permutation(blocks)
    # configurations of the blocks drawn so far
    drawn_weight = weight[order]
    cumulated = np.cumsum(drawn_weight)
    place = np.searchsorted(cumulated, count)
    chosen = int(place) + 1
    drawn = order[:chosen]
    inside = np.zeros(blocks, bool)
    inside[drawn] = True
    few = blocks <= MAX_EXCHANGED_BLOCKS
    everything = inside.all()
    if few and not everything:
        features = _features(data, first, prismatic)
        _exchange(features, inside, weight)
    return inside[block]


def _features(data: Measurements, first: Index, prismatic: tuple[bool, ...]) -> Array:
    """Build features (blocks, d) of the rows `first`, in order of motion: first and second
    harmonics of every joint, approach, covariates and place in time, standardised, and a
    constant."""
    time = np.linspace(-1, 1, len(first))
    approach = data.approach[first]
    parts: list[Array] = [approach, time[:, None]]
    for j, slides in enumerate(prismatic):
        q = data.q[first, j]
        if slides:
            waves = [q, q * q]
        else:
            double = 2 * q
            waves = [np.sin(q), np.cos(q), np.sin(double), np.cos(double)]
        harmonics = np.stack(waves, 1)
        parts.append(harmonics)
    for values in data.covariates.values():
        covariate = values[first]
        parts.append(covariate[:, None])
    features = np.concatenate(parts, axis=1)
    mean = features.mean(0)
    deviation = features.std(0)
    varies = deviation > 1e-9
    centred = features - mean
    centred = centred[:, varies]
    standard = centred / deviation[varies]
    rows = len(standard)
    constant = np.ones((rows, 1))
    return np.concatenate([constant, standard], axis=1)


def _exchange(features: Array, inside: Mask, weight: Index) -> None:
    """Exchange blocks in place until no swap of equal numbers of configurations raises the
    determinant of the (slightly regularised) information."""
    size = int(np.sqrt(inside.sum()))
    exchanges = MAX_EXCHANGES * max(1, size)
    for _ in range(exchanges):
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
    width = features.shape[1]
    X = features[inside]
    information = X.T @ X
    regularisation = 1e-6 * np.eye(width)
    information = information + regularisation
    C = np.linalg.inv(information)
    # blocks that may leave and join, nearest to an exchange first
    out = np.flatnonzero(inside)
    into = np.flatnonzero(~inside)
    features_out = features[out]
    features_in = features[into]
    projected_out = features_out @ C
    projected_in = features_in @ C
    leave = np.einsum("id,id->i", projected_out, features_out)
    enter = np.einsum("id,id->i", projected_in, features_in)
    keep = np.argsort(leave)
    keep = keep[:CANDIDATES]
    join = np.argsort(-enter)
    join = join[:CANDIDATES]
    leaving = out[keep]
    joining = into[join]
    candidates = features[joining]
    projected = projected_out[keep]
    cross = projected @ candidates.T
    # how much each exchange multiplies the determinant
    gained = 1 + enter[join]
    lost = 1 - leave[keep]
    ratio = gained[None, :] * lost[:, None]
    ratio = ratio + cross**2
    weight_out = weight[leaving]
    weight_in = weight[joining]
    unequal = weight_out[:, None] != weight_in[None, :]
    ratio[unequal] = 0.0
    largest = int(ratio.argmax())
    i, j = np.unravel_index(largest, ratio.shape)
    least = 1 + MIN_INCREASE
    if ratio[i, j] <= least:
        return None
    return (int(leaving[i]), int(joining[j]))


def assign_folds(
    data: Measurements, folds: int, rng: np.random.Generator, by: str = "configuration"
) -> Index:
    """Assign every row (m,) to a fold; equal readings stay together.

    by="group" keeps groups whole. folds = 0 leaves one unit out at a time."""
    whole_groups = by == "group"
    label = data.group if whole_groups else data.block
    unit, first = order_units(label, data.progress)
    units = len(first)
    count = units
    if folds > 0:
        count = min(folds, units)
    order = rng.permutation(units)
    if data.gauges is not None:
        # rows of one feature go to different folds: each is estimable without any one of them
        feature = data.gauges.feature[first]
        feature = feature[order]
        by_feature = np.argsort(feature, kind="stable")
        order = order[by_feature]
    fold = np.empty(units, dtype=np.intp)
    fold[order] = np.arange(units) % count
    return fold[unit]
