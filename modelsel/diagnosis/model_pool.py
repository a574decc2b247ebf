"""The pool of a model search: candidates that are weighed in sets, by exact evidence.

Beyond the base, candidate g has orthonormal directions Z_g, scaled by the prior standard deviations
of a free function's own. With H = ZᵀZ of all of them, z = Zᵀr, and a normal prior of variance ratio
ρ_g on every effect (the grouped g-prior of `evidence`, one ratio an effect), a set S has

    log BF = -1/2 log|I + H_S R| - ν/2 log(1 - zᵀ(R⁻¹ + H_S)⁻¹z / |r|²),  R = diag ρ

exactly, whatever the order of its effects. What one candidate more would add follows from H and z
less their parts along the set. A term that physics allows one sign has the factor of its posterior's
tail. An effect more costs the evidence that chance reaches in 5 % of studies, so that the odds turn
where the family-wise p-value does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from .._linalg import TINY
from .._typing import Array, Index
from .evidence import RATIOS, compute_factors, sum_evidence
from .joint_curves import Rest, build_curve, see_rest
from .scan import build_buckets, build_scan_without
from .state import Search, View

# members of a pool, and columns up to which a candidate that is not chosen may join it
MOST_MEMBERS, MOST_COLUMNS = 160, 40
# pairs of effects that one explanation may replace, explanations of each, and the cosine of their
# displacements from which they are such a pair
MOST_PAIRS, EACH_PAIR, RELATED = 12, 12, 0.3
# share of a residual that no set may exceed
WHOLE = 1 - 1e-12


class _Group(NamedTuple):
    """The members of k directions.

    `which` (n,): the members; `rows` (n, k): theirs in H; `terms` (n, k, k): from the
    coordinates to the terms, each times the sign that it must have; `free` (n, k, 1): inf for a
    term of either sign, else 0; None where no member has a sign."""

    which: Index
    rows: Index
    terms: Array | None
    free: Array | None


class Gains(NamedTuple):
    """What each member (P,) would add to the log posterior of a set, at its best ratio (P,)."""

    value: Array
    ratio: Array


@dataclass(frozen=True, eq=False)
class Pool:
    """Candidates with their products beyond the base.

    `members`: their numbers (P,); H (D, D), z (D,): products of their directions and with the
    response, whose sum of squares is `square` and that has `freedom` coordinates; `rows`: each
    one's directions; `log_prior` (P,): less the price of an effect."""

    members: tuple[int, ...]
    rows: tuple[Index, ...]
    H: Array
    z: Array
    square: float
    freedom: int
    log_prior: Array
    groups: tuple[_Group, ...] = field(repr=False)

    @cached_property
    def sides(self) -> dict[int, tuple[Array, Array]]:
        """Of every member with a sign, from its coordinates to its terms, each times the sign that
        it must have (k, k), and inf for a term of either sign, else 0 (k,)."""
        sides = {}
        for group in self.groups:
            if group.terms is not None and group.free is not None:
                for p, terms, free in zip(group.which.tolist(), group.terms, group.free, strict=True):
                    if not np.isinf(free).all():
                        sides[p] = terms, free[:, 0]
        return sides

    def place(self, chosen: Sequence[int]) -> frozenset[int]:
        """The members that some candidates are."""
        return frozenset(self.members.index(g) for g in chosen)

    def weigh(self, ratios: dict[int, float]) -> tuple[float, Gains]:
        """Compute the log posterior of a set of members with their ratios, up to a constant, and
        what each member more would add to it."""
        chosen = sorted(ratios)
        own = np.concatenate([np.zeros(0, np.intp), *(self.rows[p] for p in chosen)])
        root = np.sqrt(
            np.concatenate([[], *(np.full(len(self.rows[p]), ratios[p]) for p in chosen)])
        )
        H = root[:, None] * self.H[own]
        L = np.linalg.cholesky(np.eye(len(own)) + H[:, own] * root)
        both = np.linalg.solve(L, np.column_stack([H, root * self.z[own]]))
        along, response = both[:, :-1], both[:, -1]
        left = max(self.square - float(response @ response), TINY * self.square)
        evidence = -np.log(np.diag(L)).sum() - self.freedom / 2 * np.log(left / self.square)
        value = float(evidence + self.log_prior[chosen].sum())
        signed = self._weigh_signs(chosen, L, root, response, left)
        return value + signed, self._weigh_others(along, self.z - along.T @ response, left, chosen)

    def _weigh_signs(
        self, chosen: Sequence[int], L: Array, root: Array, response: Array, left: float
    ) -> float:
        """Sum the log factors of the signs that the members of a set have.

        `root` (m,): roots of the ratios; L (m, m): Cholesky factor of I + R½ H R½; `response` (m,):
        L⁻¹ R½ z; `left`: what the set leaves of the response."""
        if not any(p in self.sides for p in chosen):
            return 0.0
        from scipy.special import log_ndtr

        inverse = np.linalg.inv(L)
        mean = root * (inverse.T @ response)
        spread = root[:, None] * inverse.T
        sigma = np.sqrt(left / self.freedom)
        total, start = 0.0, 0
        for p in chosen:
            own = slice(start, start + len(self.rows[p]))
            start = own.stop
            if p in self.sides:
                terms, free = self.sides[p]
                error = np.linalg.norm(terms @ spread[own], axis=1)
                least = (terms @ mean[own] / np.maximum(sigma * error, TINY) + free).min()
                total += float(np.log(2) + log_ndtr(least))
        return total

    def _weigh_others(self, along: Array, z: Array, left: float, chosen: Sequence[int]) -> Gains:
        """Compute what each member adds beyond a set with directions `along` (m, D)."""
        gains = np.full((len(RATIOS), len(self.members)), -np.inf)
        for group in self.groups:
            part = along[:, group.rows].transpose(1, 2, 0)
            square = self.H[group.rows[:, :, None], group.rows[:, None, :]]
            value, vector = np.linalg.eigh(square - np.matmul(part, part.swapaxes(1, 2)))
            value = np.maximum(value, 0.0)
            coordinates = np.matmul(z[group.rows][:, None], vector)[:, 0]
            gains[:, group.which] = self._weigh_group(group, value, vector, coordinates, left)
        gains += self.log_prior
        gains[:, list(chosen)] = -np.inf
        best = gains.argmax(0)
        return Gains(gains[best, np.arange(len(best))], RATIOS[best])

    def _weigh_group(
        self, group: _Group, value: Array, vector: Array, coordinates: Array, left: float
    ) -> Array:
        """Compute (ratios, n) log Bayes factors of the members of a group.

        Their Gram matrices beyond the set have eigenvalues `value` (n, k) and the eigenvectors
        `vector` (n, k, k), in which the products with the response are `coordinates` (n, k)."""
        ratio = RATIOS[:, None, None]
        spread = ratio / (1 + ratio * value)
        share = np.minimum((spread * np.square(coordinates)).sum(2) / left, WHOLE)
        price = 0.5 * np.log1p(ratio * value).sum(2)
        out = -price - self.freedom / 2 * np.log1p(-share)
        if group.terms is None or group.free is None:
            return np.asarray(out)
        from scipy.special import log_ndtr

        loading = np.matmul(group.terms, vector)
        mean = np.matmul(loading, (spread * coordinates)[..., None])[..., 0]
        variance = np.matmul(np.square(loading), spread[..., None])[..., 0]
        sigma = np.sqrt(left * (1 - share) / self.freedom)[:, :, None]
        error = np.sqrt(np.maximum(variance, TINY)) * sigma
        least = (mean / error + group.free[:, :, 0]).min(2)
        return np.asarray(out + np.where(np.isfinite(least), np.log(2) + log_ndtr(least), 0.0))


def build_pool(search: Search, view: View, chosen: Sequence[int]) -> Pool:
    """Build the pool around the chosen candidates of a view: what may stand beside them or in their
    place, one for one, one for two, two for one, or a family as a whole."""
    which = np.array(sorted(_gather(search, view, chosen)), dtype=np.intp)
    log_prior = search.log_prior[which]
    curve = build_curve(search.columns, which, log_prior, np.zeros(len(which), bool))
    released = view.release(*(search.found[g] for g in chosen))
    rest = see_rest(curve, view.scan, view.response, released)
    return _build(rest, log_prior - search.bound)


def _gather(search: Search, view: View, chosen: Sequence[int]) -> list[int]:
    """Gather the members: the chosen ones, the rivals of each, what is strongest in the rest, the
    families of the chosen ones, and what would explain two of them at once."""
    gathered = dict.fromkeys(chosen)
    lists = [search.rename(g, view).named for g in chosen]
    lists.append(search.name_strongest(view, chosen))
    offered = [[entry.place for entry in one.entries] for one in lists]
    for family in search.families:
        whole = (family.whole, *family.parts)
        if any(g in whole for g in chosen):
            offered.append(list(whole))
    offered += [_explain_both(search, view, pair) for pair in list_related(search, view, chosen)]
    sizes = [len(own) for own in search.columns.slices]
    dead = set(search.dead.tolist())
    for rank in range(max(map(len, offered))):
        for own in offered:
            g = own[rank] if rank < len(own) and len(gathered) < MOST_MEMBERS else None
            if g is not None and sizes[g] <= MOST_COLUMNS and g not in dead:
                gathered.setdefault(g)
    return list(gathered)


def list_related(search: Search, view: View, chosen: Sequence[int]) -> list[tuple[int, int]]:
    """List the pairs of effects that one explanation might replace, the most alike first: those
    that move the target alike, or against each other."""
    moved = np.array([search.compute_displacement(g, view) for g in chosen])
    if len(moved) < 2:
        return []
    unit = moved / np.maximum(np.linalg.norm(moved, axis=1, keepdims=True), TINY)
    alike = np.abs(unit @ unit.T)
    pairs = [(-alike[i, k], chosen[i], chosen[k]) for k in range(len(chosen)) for i in range(k)]
    return [(g, h) for cosine, g, h in sorted(pairs)[:MOST_PAIRS] if -cosine > RELATED]


def _explain_both(search: Search, view: View, pair: tuple[int, int]) -> list[int]:
    """List what explains most of two effects together."""
    released = view.release(*(search.found[g] for g in pair))
    scan = build_scan_without(view.scan, released.directions)
    response = released.see(view.response, scan.back)
    _, log_probability = sum_evidence(compute_factors(scan, response), search.log_prior)
    strongest = np.argsort(-log_probability, kind="stable")[:EACH_PAIR]
    return [g for g in strongest.tolist() if np.isfinite(log_probability[g])]


def _build(rest: Rest, log_prior: Array) -> Pool:
    """Build the pool from what its candidates are beyond the base."""
    curve = rest.curve
    gram = curve.gram - rest.inside @ rest.inside.T + rest.back @ rest.back.T
    count = len(curve.which)
    buckets, _ = build_buckets(rest.blocks, rest.lefts, count)
    rows: list[Index] = [np.zeros(0, np.intp)] * count
    directions = sum(bucket.W.shape[0] * bucket.W.shape[1] for bucket in buckets)
    turn = np.zeros((directions, len(gram)))
    groups, start = [], 0
    for bucket in buckets:
        weight = 1.0 if bucket.weights is None else np.sqrt(bucket.weights)[:, :, None]
        scaled = bucket.W * weight
        n, k, _ = scaled.shape
        index = start + np.arange(n * k).reshape(n, k)
        turn[index[:, :, None], bucket.block.index[:, None, :]] = scaled
        for member, own in zip(bucket.block.which.tolist(), index, strict=True):
            rows[member] = own
        groups.append(_sign(bucket.block.which, index, scaled, curve.signs))
        start += n * k
    return Pool(
        members=tuple(curve.which.tolist()),
        rows=tuple(rows),
        H=turn @ gram @ turn.T,
        z=turn @ rest.products,
        square=rest.square,
        freedom=rest.freedom,
        log_prior=log_prior,
        groups=tuple(groups),
    )


def _sign(which: Index, index: Index, scaled: Array, signs: Sequence[Array]) -> _Group:
    sign = np.array([signs[member] for member in which])
    if not sign.any():
        return _Group(which, index, None, None)
    terms = sign[:, :, None] * scaled.swapaxes(1, 2)
    return _Group(which, index, terms, np.where(sign == 0, np.inf, 0.0)[:, :, None])
