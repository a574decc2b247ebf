"""Split of configurations into estimation and held-out ones by D-optimal exchange, and folds for
cross-validation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._arguments import check_sliding, check_type, check_whole_number
from .._typing import Array, Index, Mask
from ..exceptions import ArgumentError
from ..measurements.campaign.visits import order_units
from ..measurements.measurements import Measurements

# exchanges per square root of the number of estimation blocks
MAX_EXCHANGES = 40
# blocks beyond which a random choice covers everything by itself
MAX_EXCHANGED_BLOCKS = 20_000
# blocks that are tried for leaving, and for joining, at every exchange
CANDIDATES = 32
# blocks inside, and outside, whose leverages are kept up to date between exchanges
LISTED = 1024
# exchanges after which the inverse information is computed anew
MAX_UPDATES = 100
# factor by which an exchange must raise the determinant, beyond one
MIN_INCREASE = 1e-6


def split_configurations(
    data: Measurements, count: int, prismatic: tuple[bool, ...], rng: np.random.Generator | int
) -> Mask:
    """Choose `count` configurations for estimation: mask (m,) of their rows.

    Equal readings stay together. Fedorov's exchange on the features' information: from a random
    start, the pair of blocks whose exchange raises the determinant most changes places until none
    does (Fedorov 1972).

    `prismatic`: which joints slide, as `robot.prismatic`; `rng`: a generator, or a seed. Raises
    StudyError for a count that is no whole number from 1 to that of the configurations (where all
    estimate, none is held out)."""
    check_type("data", data, Measurements, "Measurements, as read_measurements returns them")
    prismatic = check_sliding(
        "prismatic", prismatic, "for each joint whether it slides, as robot.prismatic"
    )
    joints = data.q.shape[1]
    if len(prismatic) != joints:
        raise ArgumentError(
            f"prismatic has {len(prismatic)} values; expected {joints}, one for each joint."
        )
    count = check_whole_number("count", count, 1, data.configurations)
    if not isinstance(rng, np.random.Generator):
        seed = check_whole_number("rng", rng, 0)
        rng = np.random.default_rng(seed)
    block, first = order_units(data.block, data.progress)
    blocks = len(first)
    # the rows of a configuration are in one block
    configurations = int(data.configuration.max()) + 1
    block_of = np.full(configurations, -1)
    block_of[data.configuration] = block
    weight = np.bincount(block_of[block_of >= 0])
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
    X = features[inside]
    information = X.T @ X + 1e-6 * np.eye(features.shape[1])
    shortlist = _Shortlist.choose(features, inside, information)
    for _ in range(exchanges):
        candidates = shortlist.find_candidates()
        if not shortlist.is_sufficient(*candidates):
            shortlist = _Shortlist.choose(features, inside, information)
            candidates = shortlist.find_candidates()
        swap = _find_swap(shortlist, *candidates, weight)
        if swap is None:
            return
        shortlist.swap(*swap)
        leaving, joining = shortlist.blocks[list(swap)]
        inside[leaving] = False
        inside[joining] = True
        information += np.outer(features[joining], features[joining])
        information -= np.outer(features[leaving], features[leaving])


@dataclass(eq=False)
class _Shortlist:
    """The blocks nearest to an exchange, kept up to date from one exchange to the next.

    `blocks` (s,): their numbers, with their `features` (s, d), whether they are `inside`, and their
    `leverage` xᵀ C x (s,) for the inverse information `inverse` C (d, d). No other block inside has a
    leverage below `floor`, no other one outside has one above `ceiling`: with a and b the leverages
    of the blocks that leave and join, no leverage grows by more than 1 / (1 − a) nor shrinks by
    more than 1 / (1 + b), by Cauchy and Schwarz."""

    blocks: Index
    features: Array
    inside: Mask
    leverage: Array
    inverse: Array
    floor: float
    ceiling: float
    swaps: int = 0

    @classmethod
    def choose(cls, features: Array, inside: Mask, information: Array) -> _Shortlist:
        """Choose the blocks of least leverage inside and of largest leverage outside."""
        inverse = np.asarray(np.linalg.inv(information), float)
        leverage = np.einsum("id,id->i", features @ inverse, features)
        within = np.flatnonzero(inside)
        without = np.flatnonzero(~inside)
        near = within[_find_least(leverage[within], LISTED)]
        far = without[_find_least(-leverage[without], LISTED)]
        blocks = np.sort(np.concatenate([near, far]))
        return cls(
            blocks=blocks,
            features=features[blocks],
            inside=inside[blocks],
            leverage=leverage[blocks],
            inverse=inverse,
            floor=np.inf if len(near) == len(within) else float(leverage[near].max()),
            ceiling=-np.inf if len(far) == len(without) else float(leverage[far].min()),
        )

    def is_sufficient(self, leaving: Index, joining: Index) -> bool:
        """Whether no block but the listed ones belongs among these candidates."""
        lowest = self.leverage[leaving].max() <= self.floor
        highest = self.leverage[joining].min() >= self.ceiling
        return bool(lowest and highest and self.swaps < MAX_UPDATES)

    def find_candidates(self) -> tuple[Index, Index]:
        """Find the places of the blocks that may leave and join, nearest to an exchange first."""
        within = np.flatnonzero(self.inside)
        without = np.flatnonzero(~self.inside)
        leaving = within[_find_least(self.leverage[within], CANDIDATES)]
        joining = without[_find_least(-self.leverage[without], CANDIDATES)]
        return leaving, joining

    def swap(self, leaving: int, joining: int) -> None:
        """Exchange two listed blocks: the inverse and the leverages change by one rank each."""
        lost = self._change(leaving, -1.0)
        gained = self._change(joining, 1.0)
        self.inside[leaving] = False
        self.inside[joining] = True
        remaining = 1 - lost
        self.ceiling /= remaining
        self.floor /= 1 + gained
        self.swaps += 1

    def _change(self, place: int, sign: float) -> float:
        """Add (1) or take away (−1) a block's information; returns its leverage before."""
        direction = self.inverse @ self.features[place]
        own = float(self.features[place] @ direction)
        scale = sign / (1 + sign * own)
        self.inverse -= scale * np.outer(direction, direction)
        self.leverage -= scale * np.square(self.features @ direction)
        return own


def _find_least(values: Array, count: int) -> Index:
    """Find the places of the `count` least values, in ascending order."""
    if len(values) <= count:
        return np.argsort(values)
    least = np.argpartition(values, count)[:count]
    return least[np.argsort(values[least])]


def _find_swap(
    shortlist: _Shortlist, leaving: Index, joining: Index, weight: Index
) -> tuple[int, int] | None:
    """Find the exchange that raises the determinant most: places of (block leaving, block joining).

    With C the inverse information, d_ij = x_iᵀ C x_j, a swap of i for j multiplies the determinant
    by (1 + d_jj)(1 − d_ii) + d_ij²."""
    features = shortlist.features
    cross = features[leaving] @ shortlist.inverse @ features[joining].T
    # how much each exchange multiplies the determinant
    gained = 1 + shortlist.leverage[joining]
    lost = 1 - shortlist.leverage[leaving]
    ratio = gained[None, :] * lost[:, None]
    ratio = ratio + cross**2
    weights = weight[shortlist.blocks]
    unequal = weights[leaving][:, None] != weights[joining][None, :]
    ratio[unequal] = 0.0
    largest = int(ratio.argmax())
    i, j = np.unravel_index(largest, ratio.shape)
    least = 1 + MIN_INCREASE
    if ratio[i, j] <= least:
        return None
    return int(leaving[i]), int(joining[j])


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
