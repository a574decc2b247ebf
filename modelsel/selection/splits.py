"""Split of configurations into estimation and held-out ones by D-optimal exchange, and folds for
cross-validation."""

from __future__ import annotations

from dataclasses import dataclass

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
# exchanges after which the information is worked out anew, so that rounding does not add up
MAX_UPDATES = 50
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
    determinant of the (slightly regularised) information.

    Every exchange updates the information; after MAX_UPDATES of them it is worked out anew."""
    size = int(np.sqrt(inside.sum()))
    exchanges = MAX_EXCHANGES * max(1, size)
    for number in range(exchanges):
        if number % MAX_UPDATES == 0:
            information = _Information.of(features, inside)
        swap = information.find_swap(inside, weight)
        if swap is None:
            return
        leaving, joining = swap
        inside[leaving] = False
        inside[joining] = True
        information.exchange(leaving, joining)


@dataclass(eq=False)
class _Information:
    """What the chosen blocks tell: `inverse` (d, d) of the information of features (blocks, d), and
    every block's leverage x_iᵀ C x_i (blocks,)."""

    features: Array
    inverse: Array
    leverage: Array

    @staticmethod
    def of(features: Array, inside: Mask) -> _Information:
        """Work out the information of the blocks inside."""
        X = features[inside]
        regularisation = 1e-6 * np.eye(X.shape[1])
        inverse = np.asarray(np.linalg.inv(X.T @ X + regularisation), dtype=float)
        leverage = np.einsum("id,id->i", features @ inverse, features)
        return _Information(features, inverse, leverage)

    def find_swap(self, inside: Mask, weight: Index) -> tuple[int, int] | None:
        """Find the exchange that raises the determinant most: (block leaving, block joining).

        With C the inverse information, d_ij = x_iᵀ C x_j, a swap of i for j multiplies the
        determinant by (1 + d_jj)(1 − d_ii) + d_ij²."""
        # blocks that may leave and join, nearest to an exchange first
        leaving = _find_smallest(self.leverage, inside)
        joining = _find_smallest(-self.leverage, ~inside)
        cross = self.features[leaving] @ self.inverse @ self.features[joining].T
        # how much each exchange multiplies the determinant
        gained = 1 + self.leverage[joining]
        lost = 1 - self.leverage[leaving]
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

    def exchange(self, leaving: int, joining: int) -> None:
        """Update for one block that leaves and one that joins."""
        for block, sign in ((joining, 1.0), (leaving, -1.0)):
            direction = self.inverse @ self.features[block]
            along = self.features @ direction
            scale = sign / (1 + sign * along[block])
            self.inverse -= scale * np.outer(direction, direction)
            self.leverage -= scale * along**2


def _find_smallest(values: Array, mask: Mask) -> Index:
    """Find up to CANDIDATES places inside a mask with the smallest values, in their order."""
    places = np.flatnonzero(mask)
    of_places = values[places]
    if len(places) > CANDIDATES:
        nearest = np.argpartition(of_places, CANDIDATES)[:CANDIDATES]
        places, of_places = places[nearest], of_places[nearest]
    order = np.argsort(of_places)
    return places[order]


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
