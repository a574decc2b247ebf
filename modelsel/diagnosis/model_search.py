"""Search over sets of effects, around the set that the stepwise search has chosen.

Unlike that search, it may take effects back. All neighbours of a visited set are weighed by exact
evidence: one effect more, one less, one for another, two for one, one for two, a family's parts for
the whole. The next set is drawn by posterior probability from those not visited yet (shotgun
stochastic search: Hans, Dobra & West 2007, J. Am. Stat. Assoc. 102:507). Averaged over all sets that
were weighed, every level of an effect's claim has an inclusion probability."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from .._typing import Array, Index
from .candidates import Candidate
from .mechanism_families import Family
from .model_pool import Gains, Pool
from .pool_members import gather_pool, list_related
from .signatures import Parts
from .state import Search
from .views import View

# largest number of sets for which every addition of one effect is weighed
MOST_WEIGHED = 300
# differences of log posterior to the best set from which a set is forgotten, or not visited
FORGOTTEN, UNLIKELY = 12.0, 5.0
# explanations that are tried first where two are put in the place of one
FIRST_OF_TWO = 3
# most probable sets that are reported
TOLD = 5

Members = frozenset[int]
Ratios = dict[int, float]


@dataclass(frozen=True)
class WeighedModel:
    """A set of effects, its probability among all that were weighed, and whether it is the chosen one."""

    effects: tuple[Candidate, ...]
    probability: float
    chosen: bool


class VisitedModels(NamedTuple):
    """The sets that a search has weighed, by their candidates' numbers, the most probable first,
    with their log posteriors up to a constant."""

    sets: tuple[tuple[int, ...], ...]
    log_posterior: Array

    @property
    def probability(self) -> Array:
        """The probability of every set among them."""
        highest = self.log_posterior.max()
        weight = np.exp(self.log_posterior - highest)
        total = weight.sum()
        return np.asarray(weight / total)

    def find_better(self, chosen: Sequence[int], odds: float) -> tuple[int, ...] | None:
        """Find the most probable set that replaces some of the chosen effects, if its log odds against
        the chosen set exceed `odds`.

        Sets that only add or only drop effects do not count: the stepwise search has tested these,
        under more than one null distribution."""
        now = frozenset(chosen)
        own = self.sets.index(tuple(sorted(now)))
        least = self.log_posterior[own] + odds
        for one, value in zip(self.sets, self.log_posterior, strict=True):
            if value <= least:
                break
            removed = len(now.difference(one))
            added = len(one) + removed - len(now)
            if removed and 0 < added <= removed + 1:
                return one
        return None

    @property
    def members(self) -> frozenset[int]:
        """The candidates that are in one of the sets."""
        return frozenset[int]().union(*self.sets)

    def include(
        self, chosen: Sequence[int], signatures: Sequence[Index], parts: Mapping[int, Parts]
    ) -> dict[int, Array]:
        """Compute the inclusion probability of every level of each chosen effect's claim.

        That is the total probability of the sets which agree with the effect at that level.
        `signatures`: what every candidate says at each level, as numbers; `parts`: the same part by
        part, of each member of a set. Sets without anything in the effect's place count, too: chance
        may explain what is hardly significant."""
        weight = self.probability
        included: dict[int, Array] = {}
        for g in chosen:
            levels = np.zeros(len(signatures))
            for level, known in enumerate(signatures):
                told = []
                for one in self.sets:
                    said = _says_as_much(known, g, one, chosen)
                    told.append(said or _say_together(parts, level, g, one, chosen))
                levels[level] = weight[told].sum()
            included[g] = levels
        return included

    def tell(self, found: Sequence[Candidate], chosen: Sequence[int]) -> tuple[WeighedModel, ...]:
        """List the most probable sets and the chosen one; sets of the same names count as one."""
        now = _join_labels(found, chosen)
        first: dict[tuple[str, ...], tuple[int, ...]] = {}
        total: dict[tuple[str, ...], float] = {}
        for one, probability in zip(self.sets, self.probability, strict=True):
            names = _join_labels(found, one)
            first.setdefault(names, one)
            total[names] = total.get(names, 0.0) + float(probability)
        ranked = sorted(total, key=lambda names: -total[names])
        told = ranked[:TOLD]
        if now not in told:
            told[-1] = now
        models = []
        for names in told:
            effects = tuple(found[g] for g in first[names])
            model = WeighedModel(effects, total[names], names == now)
            models.append(model)
        return tuple(models)


def _says_as_much(known: Index, g: int, members: Sequence[int], chosen: Sequence[int]) -> bool:
    """Whether a set has candidate g, or as many effects that say the same as the chosen ones do."""
    if g in members:
        return True
    said = known[list(members)] == known[g]
    needed = known[list(chosen)] == known[g]
    return bool(said.sum() >= needed.sum())


def _say_together(
    parts: Mapping[int, Parts], level: int, g: int, members: Sequence[int], chosen: Sequence[int]
) -> bool:
    """Whether those members that are not chosen say together what candidate g says: the twists of
    joints 2 and 3, each by itself, turn the same joints as the twist of both."""
    own = parts[g][level]
    together: set[Hashable] = set()
    for member in members:
        if member in chosen:
            continue
        said = parts[member][level]
        if said <= own:
            together |= said
    return together == own


def _join_labels(found: Sequence[Candidate], members: Sequence[int]) -> tuple[str, ...]:
    labels = [found[g].label for g in members]
    labels.sort()
    return tuple(labels)


class _Weighed(NamedTuple):
    """The log posterior of a set, and what each effect more would add."""

    value: float
    gains: Gains


@dataclass
class _Walk:
    """The state of a search: the log posterior and variance ratios of all sets that are known, and
    the sets for which every addition was weighed."""

    pool: Pool
    related: tuple[tuple[int, int], ...]
    families: tuple[Family, ...]
    rng: np.random.Generator
    known: dict[Members, tuple[float, Ratios]] = field(default_factory=dict)
    weighed: dict[Members, _Weighed] = field(default_factory=dict)
    best: float = -np.inf

    def walk(self, start: Members) -> None:
        """Visit sets drawn by their probability, until no likely set is left."""
        ratios = self._settle(start)
        self._add_to(ratios)
        visited: set[Members] = set()
        following: Members | None = start
        while following is not None:
            visited.add(following)
            self._visit(following)
            if len(self.weighed) >= MOST_WEIGHED:
                break
            following = self._draw(visited)

    def _settle(self, members: Members) -> Ratios:
        """Find each effect's best variance ratio: first as it is added, the strongest first, then given
        all others."""
        ratios: Ratios = {}
        while len(ratios) < len(members):
            _, gains = self.pool.weigh(ratios)
            left = sorted(members - ratios.keys())
            most = np.argmax(gains.value[left])
            strongest = left[int(most)]
            ratios[strongest] = float(gains.ratio[strongest])
        for member in sorted(members):
            others = _leave_out(ratios, member)
            _, gains = self.pool.weigh(others)
            ratios[member] = float(gains.ratio[member])
        return ratios

    def _visit(self, members: Members) -> None:
        """Weigh all neighbours of a set."""
        _, ratios = self.known[members]
        self._add_to(ratios)
        for member in sorted(members):
            others = _leave_out(ratios, member)
            rest = self._add_to(others)
            gains = rest.gains
            for first in _find_strongest(gains, member):
                ratio = float(gains.ratio[first])
                with_first = {**others, first: ratio}
                self._add_to(with_first)
        for pair in self.related:
            first, second = pair
            if members.issuperset(pair):
                others = _leave_out(ratios, first, second)
                self._add_to(others)
        for family in self.families:
            if family.whole in members:
                others = _leave_out(ratios, family.whole, *family.parts)
                self._add_parts(others, family.parts)

    def _add_parts(self, ratios: Ratios, parts: Sequence[int]) -> None:
        """Add the parts of a family one after the other, the strongest first, while they add."""
        left = list(parts)
        while left:
            gains = self._add_to(ratios).gains
            most = np.argmax(gains.value[left])
            strongest = left.pop(int(most))
            if gains.value[strongest] <= 0:
                break
            ratio = float(gains.ratio[strongest])
            ratios = {**ratios, strongest: ratio}

    def _add_to(self, ratios: Ratios) -> _Weighed:
        """Weigh a set and every set with one effect more."""
        members = frozenset(ratios)
        if members in self.weighed:
            return self.weighed[members]
        value, gains = self.pool.weigh(ratios)
        weighed = _Weighed(value, gains)
        self.weighed[members] = weighed
        self._record(value, ratios)
        values = value + gains.value
        highest = max(self.best, values.max())
        for p in np.flatnonzero(values > highest - FORGOTTEN):
            member = int(p)
            ratio = float(gains.ratio[p])
            more = {**ratios, member: ratio}
            self._record(float(values[p]), more)
        return weighed

    def _record(self, value: float, ratios: Ratios) -> None:
        members = frozenset(ratios)
        before = self.known.get(members)
        if before is None or value > before[0]:
            self.known[members] = value, ratios
        self.best = max(self.best, value)

    def _draw(self, visited: set[Members]) -> Members | None:
        """Draw a set that was not visited yet; None where none is likely."""
        likely: list[Members] = []
        values: list[float] = []
        for members, (value, _) in self.known.items():
            if value > self.best - UNLIKELY and members not in visited:
                likely.append(members)
                values.append(value - self.best)
        if not likely:
            return None
        weight = np.exp(values)
        share = weight / weight.sum()
        drawn = self.rng.choice(len(likely), p=share)
        return likely[int(drawn)]

    def collect(self, start: Members) -> VisitedModels:
        """Collect the sets that are not improbable, and the one that the search started from."""
        kept = []
        for members, (value, _) in self.known.items():
            if value > self.best - FORGOTTEN or members == start:
                candidates = [self.pool.members[p] for p in members]
                candidates.sort()
                kept.append((-value, tuple(candidates)))
        kept.sort()
        costs = [cost for cost, _ in kept]
        sets = tuple(candidates for _, candidates in kept)
        log_posterior = -np.array(costs)
        return VisitedModels(sets, log_posterior)


def _leave_out(ratios: Ratios, *members: int) -> Ratios:
    return {p: ratio for p, ratio in ratios.items() if p not in members}


def _find_strongest(gains: Gains, left_out: int) -> list[int]:
    """Find the members that add most, except the one that was left out."""
    order = np.argsort(-gains.value, kind="stable")
    others = order[order != left_out]
    return [int(p) for p in others[:FIRST_OF_TWO]]


def _place_families(families: Sequence[Family], place: dict[int, int]) -> tuple[Family, ...]:
    """Express families by the members of a pool; those whose whole is not there are left out."""
    placed = []
    for family in families:
        if family.whole in place:
            parts = [place[g] for g in family.parts if g in place]
            placed.append(family._replace(whole=place[family.whole], parts=tuple(parts)))
    return tuple(placed)


def visit_models(search: Search, view: View, chosen: Sequence[int]) -> VisitedModels:
    """Search around the chosen effects of a view for sets that are as probable, or more."""
    pool = gather_pool(search, view, chosen)
    if pool is None:
        nothing: tuple[int, ...] = ()
        return VisitedModels((nothing,), np.zeros(1))
    place = {g: p for p, g in enumerate(pool.members)}
    pairs = list_related(search, view, chosen)
    related = tuple((place[g], place[h]) for g, h in pairs)
    (rng,) = search.rng.spawn(1)
    families = _place_families(search.families, place)
    walk = _Walk(pool, related, families, rng)
    start = frozenset(place[g] for g in chosen)
    walk.walk(start)
    return walk.collect(start)
