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

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations, zip_longest
from typing import NamedTuple

import numpy as np

from .._linalg import TINY, invert_triangle
from .._typing import Array, Index
from .buckets import Bucket, build_buckets
from .evidence import RATIOS, compute_factors, sum_evidence
from .joint_curves import Rest, build_curve, see_rest
from .mechanism_families import KIN, find_stem
from .scan import build_scan_without
from .state import Search
from .views import View

# members of a pool, and columns up to which a candidate that is not chosen may join it
MOST_MEMBERS, MOST_COLUMNS = 160, 40
# pairs of effects that one explanation may replace, explanations of each, and the cosine of their
# displacements from which they are such a pair
MOST_PAIRS, EACH_PAIR, RELATED = 12, 12, 0.3
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
        from scipy.linalg import solve_triangular

        chosen = sorted(ratios)
        own = [row for p in chosen for row in self.rows[p]]
        variance = [ratios[p] for p in chosen for _ in self.rows[p]]
        root = np.asarray(np.sqrt(variance), float)
        H = root[:, None] * self.H[own]
        whole = np.eye(len(own)) + H[:, own] * root
        L = np.linalg.cholesky(whole)
        z = root * self.z[own]
        both = solve_triangular(L, np.column_stack([H, z]), lower=True, check_finite=False)
        along, response = both[:, :-1], both[:, -1]
        explained = float(response @ response)
        left = max(self.square - explained, TINY * self.square)
        price = np.log(np.diag(L)).sum()
        gain = -self.freedom / 2 * np.log(left / self.square)
        value = gain - price + self._sum_priors(chosen)
        value += self._weigh_signs(chosen, L, root, response, left)
        beyond = self.z - along.T @ response
        return float(value), self._weigh_others(along, beyond, left, chosen)

    def _sum_priors(self, chosen: Sequence[int]) -> float:
        """Sum the log priors of a set: a mechanism that one joint has is likelier in another."""
        kinds = self.kind[chosen]
        repeated = len(kinds) - len(np.unique(kinds))
        return float(self.log_prior[chosen].sum() + repeated * KIN)

    def _weigh_signs(
        self, chosen: Sequence[int], L: Array, root: Array, response: Array, left: float
    ) -> float:
        """Sum the log factors of the signs that the members of a set have.

        `root` (m,): roots of the ratios; L (m, m): Cholesky factor of I + R½ H R½; `response` (m,):
        L⁻¹ R½ z; `left`: what the set leaves of the response."""
        if not any(p in self.sides for p in chosen):
            return 0.0
        from scipy.special import log_ndtr

        inverse = invert_triangle(L)
        mean = root * (inverse.T @ response)
        spread = root[:, None] * inverse.T
        sigma = np.sqrt(left / self.freedom)
        total, start = 0.0, 0
        for p in chosen:
            own = slice(start, start + len(self.rows[p]))
            start = own.stop
            if p in self.sides:
                terms, free = self.sides[p]
                size = terms @ mean[own]
                error = np.linalg.norm(terms @ spread[own], axis=1)
                standardised = size / np.maximum(sigma * error, TINY)
                least = (standardised + free).min()
                total += float(np.log(2) + log_ndtr(least))
        return total

    def _weigh_others(
        self, along: Array, beyond: Array, left: float, chosen: Sequence[int]
    ) -> Gains:
        """Compute what each member adds beyond a set with directions `along` (m, D)."""
        count = len(self.members)
        gains = np.full((len(RATIOS), count), -np.inf)
        for group in self.groups:
            rows = group.rows
            part = np.moveaxis(along[:, rows], 0, 2)
            inside = np.matmul(part, part.swapaxes(1, 2))
            square = self.H[rows[:, :, None], rows[:, None, :]]
            value, vector = np.linalg.eigh(square - inside)
            products = beyond[rows][:, None]
            coordinates = np.matmul(products, vector)[:, 0]
            spectrum = _Spectrum(np.maximum(value, 0.0), vector, coordinates)
            gains[:, group.which] = self._weigh_group(group, spectrum, left)
        is_kin = np.isin(self.kind, self.kind[list(chosen)])
        gains += self.log_prior + is_kin * KIN
        gains[:, list(chosen)] = -np.inf
        is_taken = (self.single > 0) & np.isin(self.single, self.single[list(chosen)])
        gains[:, is_taken] = -np.inf
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


def gather_pool(search: Search, view: View, chosen: Sequence[int]) -> Pool | None:
    """Gather a pool around the chosen candidates of a view: what may stand beside them or in their
    place, one for one, one for two, two for one, or a family as a whole.

    None where there is nothing: no candidate is left beyond the base."""
    offered = _list_offers(search, view, chosen)
    members = dict.fromkeys(chosen)
    dead = set(search.dead.tolist())
    for g in _interleave(offered):
        columns = len(search.columns.slices[g])
        if columns <= MOST_COLUMNS and g not in dead:
            members.setdefault(g)
        if len(members) == MOST_MEMBERS:
            break
    if not members:
        return None
    which = np.array(sorted(members), dtype=np.intp)
    log_prior = search.log_prior[which]
    none_free = np.zeros(len(which), bool)
    curve = build_curve(search.columns, which, log_prior, none_free, ~none_free)
    effects = [search.candidates[g] for g in chosen]
    rest = see_rest(curve, view.scan, view.response, view.release(*effects))
    labels = [search.candidates[g].label for g in which]
    kinds = _number_kinds(labels)
    return _build_pool(rest, log_prior - search.bound, kinds, search.bumped[which])


def _number_kinds(labels: Sequence[str]) -> Index:
    """Number (P,) the mechanisms that candidates are, whatever their joints."""
    stems = [find_stem(label) for label in labels]
    first = {stem: number for number, stem in reversed(list(enumerate(stems)))}
    return np.array([first[stem] for stem in stems], dtype=np.intp)


def _list_offers(search: Search, view: View, chosen: Sequence[int]) -> list[list[int]]:
    """List what is offered, by its reason: the rivals of each effect, what is strongest in the rest,
    the families of the effects, and what would explain two of them at once."""
    named = [search.rename(g, view).named for g in chosen]
    strongest = search.name_strongest(view, chosen)
    offered = [[entry.place for entry in one.entries] for one in (*named, strongest)]
    for family in search.families:
        whole = [family.whole, *family.parts]
        if not set(whole).isdisjoint(chosen):
            offered.append(whole)
    pairs = list_related(search, view, chosen)
    offered += [_explain_both(search, view, pair) for pair in pairs]
    return offered


def _interleave(offered: Sequence[Sequence[int]]) -> Iterator[int]:
    """Generate the first of every list, then the second of every one, and so on."""
    for rank in zip_longest(*offered):
        for g in rank:
            if g is not None:
                yield g


def list_related(search: Search, view: View, chosen: Sequence[int]) -> list[tuple[int, int]]:
    """List the pairs of effects that one explanation might replace, the most alike first: those
    that move the target alike, or against each other."""
    units = []
    for g in chosen:
        moved = search.compute_displacement(g, view)
        size = max(float(np.linalg.norm(moved)), TINY)
        units.append(moved / size)
    pairs = []
    for (g, first), (h, second) in combinations(zip(chosen, units, strict=True), 2):
        cosine = abs(float(first @ second))
        if cosine > RELATED:
            pairs.append((-cosine, g, h))
    pairs.sort()
    return [(g, h) for _, g, h in pairs[:MOST_PAIRS]]


def _explain_both(search: Search, view: View, pair: tuple[int, int]) -> list[int]:
    """List what explains most of two effects together."""
    effects = [search.candidates[g] for g in pair]
    released = view.release(*effects)
    scan = build_scan_without(view.scan, released.directions)
    response = released.see(view.response, scan.back)
    factors = compute_factors(scan, response)
    _, log_probability = sum_evidence(factors, search.log_prior)
    order = np.argsort(-log_probability, kind="stable")
    strongest = order[:EACH_PAIR]
    has_evidence = np.isfinite(log_probability[strongest])
    return [int(g) for g in strongest[has_evidence]]


def _build_pool(rest: Rest, log_prior: Array, kind: Index, single: Index) -> Pool:
    """Build the pool from what its candidates are beyond the base."""
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
