"""The pool of a model search: candidates that are weighed in sets, by exact evidence.

Beyond the base, candidate g has orthonormal directions Z_g, scaled by the prior standard deviations
of a free function's own. With H = ZᵀZ of all of them, z = Zᵀr, and a normal prior of variance ratio
ρ_g on every effect (the grouped g-prior of `evidence`, one ratio an effect), a set S has

    log BF = -1/2 log|I + H_S R| - ν/2 log(1 - zᵀ(R⁻¹ + H_S)⁻¹z / |r|²),  R = diag ρ

exactly, whatever the order of its effects. What one candidate more would add follows from H and z
less their parts along the set. A term that physics allows one sign has the factor of its posterior's
tail. An effect more costs the evidence that chance reaches in 5 % of studies, so that the odds turn
where the family-wise p-value does; a mechanism that another joint of the set has, less: joints are
built alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..._linalg import TINY
from ..._typing import Array, Index, Mask
from ..candidates.alike_mechanisms import KIN
from ..columns.buckets import Bucket, build_buckets
from ..inference.evidence import RATIOS
from ..inference.joint_curves import Rest
from .fitted_sets import FittedSet

# share of a residual that no set may exceed
WHOLE = 1 - 1e-12


class _Group(NamedTuple):
    """The members of k directions.

    `which` (n,): the members; `rows` (n, k): theirs in H; `terms` (n, k, k): from the coordinates to
    the terms, each times the sign that it must have, None where no member has a sign; `free` (n, k):
    inf for a term of either sign, else 0."""

    which: Index
    rows: Index
    terms: Array | None
    free: Array

    def take(self, members: Index) -> _Group:
        """Return some of the members, in an order of theirs, also repeatedly."""
        terms = None if self.terms is None else self.terms[members]
        return _Group(self.which[members], self.rows[members], terms, self.free[members])


class _Spectrum(NamedTuple):
    """What the members of a group are beyond a set: the eigenvalues (n, k) and eigenvectors (n, k,
    k) of their Gram matrices, and the products (n, k) of these directions with the response."""

    value: Array
    vector: Array
    coordinates: Array


class Gains(NamedTuple):
    """What each member (P,) would add to the log posterior of a set, at its best ratio (P,)."""

    value: Array
    ratio: Array


class Weighed(NamedTuple):
    """The log posterior of a set, and what each effect more would add."""

    value: float
    gains: Gains


@dataclass(frozen=True, eq=False)
class Pool:
    """Candidates with their products beyond the base.

    `members`: their numbers (P,); H (D, D), z (D,): products of their directions and with the
    response, whose sum of squares is `square` and that has `freedom` coordinates; `rows`: each
    one's directions; `log_prior` (P,): less the price of an effect; `kind` (P,): equal numbers are
    one mechanism in several joints; `single` (P,): of equal numbers above nought a set has one."""

    members: tuple[int, ...]
    rows: tuple[Index, ...]
    H: Array
    z: Array
    square: float
    freedom: int
    log_prior: Array
    kind: Index
    single: Index
    groups: tuple[_Group, ...] = field(repr=False)

    @cached_property
    def sides(self) -> dict[int, tuple[Array, Array]]:
        """Of every member with a sign, from its coordinates to its terms, each times the sign that
        it must have (k, k), and inf for a term of either sign, else 0 (k,)."""
        sides = {}
        for group in self.groups:
            if group.terms is None:
                continue
            for row, member in enumerate(group.which.tolist()):
                free = group.free[row]
                if not np.isinf(free).all():
                    sides[member] = group.terms[row], free
        return sides

    @cached_property
    def are_kin(self) -> Mask:
        """Whether (P, P) members are one mechanism in several joints."""
        kind = self.kind
        same: Mask = kind[:, None] == kind
        return same

    @cached_property
    def exclude(self) -> Mask:
        """Whether (P, P) a set has one of two members only."""
        single = self.single
        same: Mask = single[:, None] == single
        same &= single > 0
        return same

    @cached_property
    def nothing(self) -> FittedSet:
        """The empty set, beyond which everything is what it is beyond the base."""
        shape = len(self.z), 0
        more = np.zeros(shape)
        signs = np.zeros(0)
        return FittedSet(self.rows, {}, self.H, more, signs, self.z, self.square, 0.0)

    def weigh(self, ratios: Mapping[int, float], near: FittedSet | None = None) -> Weighed:
        """Weigh one set of members: see `weigh_together`."""
        return self.weigh_together([ratios], near)[0]

    def weigh_together(
        self, sets: Sequence[Mapping[int, float]], near: FittedSet | None = None
    ) -> list[Weighed]:
        """Compute the log posteriors of sets of members with their ratios, up to a constant, and what
        each member more would add to them. `near`: a set that differs little from all of them."""
        start = near or self.nothing
        fitted = [start.change_into(ratios) for ratios in sets]
        gains = self._weigh_others(fitted)
        weighed = []
        pairs = zip(fitted, gains, strict=True)
        for one, more in pairs:
            value = self._weigh_one(one)
            weighed.append(Weighed(value, more))
        return weighed

    def _weigh_one(self, fitted: FittedSet) -> float:
        """Compute the log posterior of a set."""
        share = fitted.left / self.square
        gain = -self.freedom / 2 * np.log(share)
        priors = self._sum_priors(fitted.members)
        signs = self._weigh_signs(fitted)
        value = gain - fitted.price + priors + signs
        return float(value)

    def settle(self, members: frozenset[int]) -> dict[int, float]:
        """Find each effect's best variance ratio: first as it is added, the strongest first, then given
        all others."""
        ratios: dict[int, float] = {}
        near = self.nothing
        while len(ratios) < len(members):
            near = near.change_into(ratios)
            (gains,) = self._weigh_others([near])
            left = sorted(members - ratios.keys())
            most = np.argmax(gains.value[left])
            strongest = left[int(most)]
            ratios[strongest] = float(gains.ratio[strongest])
        for member in sorted(members):
            others = {p: ratio for p, ratio in ratios.items() if p != member}
            near = near.change_into(others)
            (gains,) = self._weigh_others([near])
            ratios[member] = float(gains.ratio[member])
        return ratios

    def _sum_priors(self, chosen: Sequence[int]) -> float:
        """Sum the log priors of a set: a mechanism that one joint has is likelier in another."""
        kinds = self.kind[chosen]
        repeated = len(kinds) - len(np.unique(kinds))
        return float(self.log_prior[chosen].sum() + repeated * KIN)

    def _weigh_signs(self, fitted: FittedSet) -> float:
        """Sum the log factors of the signs that the members of a set have."""
        from scipy.special import log_ndtr

        sigma = np.sqrt(fitted.left / self.freedom)
        total = 0.0
        for p in fitted.members:
            if p not in self.sides:
                continue
            own, ratio = self.rows[p], fitted.ratios[p]
            terms, free = self.sides[p]
            size = terms @ (ratio * fitted.z[own])
            # the covariance of its directions, ratio (1 - ratio ZᵀΣ⁻¹Z)
            beyond = fitted.take_blocks(own[None])[0]
            covariance = ratio * (np.eye(len(own)) - ratio * beyond)
            error = np.sqrt(np.maximum(np.diag(terms @ covariance @ terms.T), 0.0))
            standardised = size / np.maximum(sigma * error, TINY)
            least = (standardised + free).min()
            total += float(np.log(2) + log_ndtr(least))
        return total

    def _weigh_others(self, sets: Sequence[FittedSet]) -> list[Gains]:
        """Compute what each member adds beyond each of some sets."""
        count = len(self.members)
        gains = np.full((len(RATIOS), len(sets), count), -np.inf)
        is_offered = np.array([self._offer(one.members) for one in sets]).reshape(len(sets), count)
        left = np.array([one.left for one in sets])
        for group in self.groups:
            taken = is_offered[:, group.which]
            number, place = np.nonzero(taken)
            if not len(number):
                continue
            spectrum = _see_beyond(group.rows, sets, taken)
            which = group.which[place]
            gains[:, number, which] = self._weigh_group(group.take(place), spectrum, left[number])
        of_kin = [self.are_kin[:, one.members].any(1) for one in sets]
        gains += self.log_prior + np.reshape(of_kin, (len(sets), count)) * KIN
        best = gains.argmax(0)
        highest = np.take_along_axis(gains, best[None], 0)[0]
        ratio = RATIOS[best]
        return [Gains(*one) for one in zip(highest, ratio, strict=True)]

    def _offer(self, chosen: Sequence[int]) -> Mask:
        """Mask (P,) of what may be added to a set."""
        excluded = self.exclude[:, chosen]
        is_excluded = np.any(excluded, axis=1)
        is_offered: Mask = ~is_excluded
        is_offered[chosen] = False
        return is_offered

    def _weigh_group(self, group: _Group, spectrum: _Spectrum, left: Array) -> Array:
        """Compute (ratios, n) log Bayes factors of members of a group, each beyond a set that leaves so
        much (n,) of the response."""
        value, vector, coordinates = spectrum
        ratio = RATIOS[:, None, None]
        grown = 1 + ratio * value
        spread = ratio / grown
        square = spread * np.square(coordinates)
        share = np.minimum(square.sum(2) / left, WHOLE)
        price = 0.5 * np.log(grown).sum(2)
        factors = -self.freedom / 2 * np.log1p(-share) - price
        if group.terms is None:
            return np.asarray(factors)
        from scipy.special import log_ndtr

        loading = np.matmul(group.terms, vector)
        along = (spread * coordinates)[..., None]
        mean = np.matmul(loading, along)[..., 0]
        squares = np.square(loading)
        variance = np.matmul(squares, spread[..., None])[..., 0]
        sigma = np.sqrt(left * (1 - share) / self.freedom)
        error = np.sqrt(np.maximum(variance, TINY)) * sigma[:, :, None]
        least = (mean / error + group.free).min(2)
        tail = np.log(2) + log_ndtr(least)
        return np.asarray(np.where(np.isfinite(least), factors + tail, factors))


def _see_beyond(rows: Index, sets: Sequence[FittedSet], taken: Mask) -> _Spectrum:
    """See what members of directions (n, k) are beyond each of some sets, those that are `taken`
    (sets, n), one set after the other."""
    matrices = np.concatenate(
        [one.take_blocks(rows, own) for one, own in zip(sets, taken, strict=True)]
    )
    products = np.concatenate([one.z[rows[own]] for one, own in zip(sets, taken, strict=True)])
    if rows.shape[1] == 1:
        return _Spectrum(np.maximum(matrices[:, :, 0], 0.0), np.ones_like(matrices), products)
    value, vector = np.linalg.eigh(matrices)
    coordinates = np.matmul(products[:, None], vector)[:, 0]
    return _Spectrum(np.maximum(value, 0.0), vector, coordinates)


def assemble_pool(rest: Rest, log_prior: Array, kind: Index, single: Index) -> Pool:
    """Assemble the pool from what its candidates are beyond the base."""
    curve = rest.curve
    along = rest.inside @ rest.inside.T
    returned = rest.back @ rest.back.T
    gram = curve.columns.gram(curve.index) - along + returned
    count = len(curve.which)
    buckets, _ = build_buckets(rest.blocks, rest.lefts, count)
    rows: dict[int, Index] = {}
    turns, groups = [], []
    start = 0
    for bucket in buckets:
        scaled = _scale(bucket)
        n, k, _ = scaled.shape
        own = np.arange(start, start + n * k).reshape(n, k)
        start += n * k
        which = bucket.block.which
        rows.update(zip(which.tolist(), own, strict=True))
        turn = np.zeros((n, k, len(gram)))
        np.put_along_axis(turn, bucket.block.index[:, None, :].repeat(k, 1), scaled, 2)
        turns.append(turn.reshape(n * k, -1))
        signs = np.array([curve.signs[member] for member in which])
        groups.append(_build_group(which, own, scaled, signs))
    turned = np.concatenate(turns)
    return Pool(
        members=tuple(curve.which.tolist()),
        rows=tuple(rows[member] for member in range(count)),
        H=turned @ gram @ turned.T,
        z=turned @ rest.products,
        square=max(rest.square, TINY),
        freedom=rest.freedom,
        log_prior=log_prior,
        kind=kind,
        single=single,
        groups=tuple(groups),
    )


def _scale(bucket: Bucket) -> Array:
    """Scale the directions of candidates by their prior standard deviations: (n, k, k)."""
    weights = bucket.weights
    if weights is None:
        return bucket.W
    deviation = np.sqrt(weights)
    scaled = bucket.W * deviation[:, :, None]
    return np.asarray(scaled)


def _build_group(which: Index, rows: Index, scaled: Array, signs: Array) -> _Group:
    free = np.where(signs == 0, np.inf, 0.0)
    if not signs.any():
        return _Group(which, rows, None, free)
    transposed = scaled.swapaxes(1, 2)
    terms = signs[:, :, None] * transposed
    return _Group(which, rows, terms, free)
