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

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from .._linalg import TINY
from .._typing import Array, Index, Mask
from .buckets import Bucket, build_buckets
from .evidence import RATIOS
from .joint_curves import Rest
from .kin import KIN

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

    def take(self, members: Mask) -> _Group:
        """Return some of the members (n,)."""
        if members.all():
            return self
        terms = None if self.terms is None else self.terms[members]
        return _Group(self.which[members], self.rows[members], terms, self.free[members])


class _Spectrum(NamedTuple):
    """What the members of a group are beyond a set: the eigenvalues (n, k) and eigenvectors (n, k,
    k) of their Gram matrices, and the products (n, k) of these directions with the response."""

    value: Array
    vector: Array
    coordinates: Array


class _FittedSet(NamedTuple):
    """A fitted set of members, of m directions.

    `along` (m, D), `response` (m,): what all directions, and the response, have in the set, in
    orthonormal coordinates; `left`: what it leaves of the response; `price`: of its freedom, in log
    evidence; `mean` (s,), `spread` (m, s): the estimates of its directions that have a sign, and the
    roots of their covariance, column by column."""

    along: Array
    response: Array
    left: float
    price: float
    mean: Array
    spread: Array


class Gains(NamedTuple):
    """What each member (P,) would add to the log posterior of a set, at its best ratio (P,)."""

    value: Array
    ratio: Array


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

    def weigh(self, ratios: dict[int, float]) -> tuple[float, Gains]:
        """Compute the log posterior of a set of members with their ratios, up to a constant, and
        what each member more would add to it."""
        chosen = sorted(ratios)
        fitted = self._fit(chosen, ratios)
        gain = -self.freedom / 2 * np.log(fitted.left / self.square)
        value = gain - fitted.price + self._sum_priors(chosen)
        value += self._weigh_signs(chosen, fitted)
        return float(value), self._weigh_others(chosen, fitted)

    def settle(self, members: frozenset[int]) -> dict[int, float]:
        """Find each effect's best variance ratio: first as it is added, the strongest first, then given
        all others."""
        ratios: dict[int, float] = {}
        while len(ratios) < len(members):
            _, gains = self.weigh(ratios)
            left = sorted(members - ratios.keys())
            most = np.argmax(gains.value[left])
            strongest = left[int(most)]
            ratios[strongest] = float(gains.ratio[strongest])
        for member in sorted(members):
            others = {p: ratio for p, ratio in ratios.items() if p != member}
            _, gains = self.weigh(others)
            ratios[member] = float(gains.ratio[member])
        return ratios

    def _fit(self, chosen: Sequence[int], ratios: dict[int, float]) -> _FittedSet:
        """Fit a set of members with their ratios."""
        from scipy.linalg import solve_triangular

        own = [row for p in chosen for row in self.rows[p]]
        variance = [ratios[p] for p in chosen for _ in self.rows[p]]
        root = np.asarray(np.sqrt(variance), float)
        H = root[:, None] * self.H[own]
        inner = np.eye(len(own)) + H[:, own] * root
        L = np.linalg.cholesky(inner)
        is_other = np.ones(len(self.H), bool)
        is_other[own] = False
        # of the set's own directions only those with a sign are asked for one by one
        signed = self._list_signed(chosen)
        units = np.eye(len(own))[:, signed]
        response = root * self.z[own]
        right = np.column_stack([response, units, H[:, is_other]])
        solved = solve_triangular(L, right, lower=True, check_finite=False)
        turned, spread, rest = np.split(solved, [1, 1 + len(signed)], axis=1)
        along = np.zeros_like(H)
        along[:, is_other] = rest
        explained = np.square(turned).sum()
        mean = solve_triangular(L, turned[:, 0], lower=True, trans="T", check_finite=False)
        return _FittedSet(
            along=along,
            response=turned[:, 0],
            left=max(self.square - float(explained), TINY * self.square),
            price=float(np.log(np.diag(L)).sum()),
            mean=(root * mean)[signed],
            spread=root[signed] * spread,
        )

    def _list_signed(self, chosen: Sequence[int]) -> list[int]:
        """List the directions of the members of a set that have a sign, among all of the set's."""
        signed: list[int] = []
        start = 0
        for p in chosen:
            end = start + len(self.rows[p])
            if p in self.sides:
                signed += range(start, end)
            start = end
        return signed

    def _sum_priors(self, chosen: Sequence[int]) -> float:
        """Sum the log priors of a set: a mechanism that one joint has is likelier in another."""
        kinds = self.kind[chosen]
        repeated = len(kinds) - len(np.unique(kinds))
        return float(self.log_prior[chosen].sum() + repeated * KIN)

    def _weigh_signs(self, chosen: Sequence[int], fitted: _FittedSet) -> float:
        """Sum the log factors of the signs that the members of a set have."""
        from scipy.special import log_ndtr

        mean, spread = fitted.mean, fitted.spread
        sigma = np.sqrt(fitted.left / self.freedom)
        total, start = 0.0, 0
        for p in chosen:
            if p not in self.sides:
                continue
            own = slice(start, start + len(self.rows[p]))
            start = own.stop
            terms, free = self.sides[p]
            size = terms @ mean[own]
            error = np.linalg.norm(spread[:, own] @ terms.T, axis=0)
            standardised = size / np.maximum(sigma * error, TINY)
            least = (standardised + free).min()
            total += float(np.log(2) + log_ndtr(least))
        return total

    def _weigh_others(self, chosen: Sequence[int], fitted: _FittedSet) -> Gains:
        """Compute what each member adds beyond a set."""
        along = fitted.along
        beyond = self.z - along.T @ fitted.response
        count = len(self.members)
        gains = np.full((len(RATIOS), count), -np.inf)
        is_offered = (self.single == 0) | ~np.isin(self.single, self.single[list(chosen)])
        is_offered[list(chosen)] = False
        for whole in self.groups:
            group = whole.take(is_offered[whole.which])
            if not len(group.which):
                continue
            rows = group.rows
            part = np.moveaxis(along[:, rows], 0, 2)
            inside = np.matmul(part, part.swapaxes(1, 2))
            square = self.H[rows[:, :, None], rows[:, None, :]]
            value, vector = np.linalg.eigh(square - inside)
            products = beyond[rows][:, None]
            coordinates = np.matmul(products, vector)[:, 0]
            spectrum = _Spectrum(np.maximum(value, 0.0), vector, coordinates)
            gains[:, group.which] = self._weigh_group(group, spectrum, fitted.left)
        is_kin = np.isin(self.kind, self.kind[list(chosen)])
        gains += self.log_prior + is_kin * KIN
        best = gains.argmax(0)
        highest = gains[best, np.arange(count)]
        return Gains(highest, RATIOS[best])

    def _weigh_group(self, group: _Group, spectrum: _Spectrum, left: float) -> Array:
        """Compute (ratios, n) log Bayes factors of the members of a group, beyond a set that leaves
        so much of the response."""
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
