"""Search over sets of effects, around the set that the stepwise search has chosen.

Unlike that search, it may take effects back. All neighbours of a visited set are weighed by exact
evidence: one effect more, one less, one for another, two for one, one for two, a family's parts for
the whole. The next set is drawn by posterior probability from those not visited yet (shotgun
stochastic search: Hans, Dobra & West 2007, J. Am. Stat. Assoc. 102:507). Averaged over all sets that
were weighed, or sampled where they are too many, every level of an effect's claim has an inclusion probability."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..._linalg import TINY
from ..._typing import Array
from .fitted_sets import FittedSet
from .mechanism_families import Family
from .model_pool import Gains, Pool, Weighed
from .model_sampler import Members, Ratios, sample_models
from .pool_members import gather_pool, list_related
from .state import Search
from .views import View
from .weighed_models import VisitedModels

# sets for which every addition of one effect is weighed: to find a better set; to weigh claims, where
# the number is doubled until no inclusion probability changes by more than SETTLED; and by the sampler,
# where that is not so
FOR_A_BETTER, FOR_CLAIMS, BY_SAMPLING = 150, 600, 1200
SETTLED = 0.02
# differences of log posterior to the best set from which a set is forgotten, or not visited
FORGOTTEN, UNLIKELY = 12.0, 5.0
# explanations that are tried first where two are put in the place of one
FIRST_OF_TWO = 3
# the empty set alone, where there are no candidates
NOTHING = VisitedModels(((),), np.zeros(1))


@dataclass
class _Walk:
    """The state of a search: the log posterior and variance ratios of all sets that are known, and
    the sets for which every addition was weighed; `ahead`: of those whose turn has not come; `near`:
    the set whose neighbours are weighed."""

    pool: Pool
    related: tuple[tuple[int, int], ...]
    families: tuple[Family, ...]
    rng: np.random.Generator
    known: dict[Members, tuple[float, Ratios]] = field(default_factory=dict)
    weighed: dict[Members, Weighed] = field(default_factory=dict)
    ahead: dict[Members, Weighed] = field(default_factory=dict)
    best: float = -np.inf
    near: FittedSet | None = None

    def walk(self, start: Members, most: int) -> bool:
        """Visit sets drawn by their probability, until no likely set is left, or so many are weighed
        that twice as many would hardly change anything, `most` of them at most; returns whether it
        ended before that."""
        ratios = self.pool.settle(start)
        self._add_to(ratios)
        visited: set[Members] = set()
        following: Members | None = start
        enough = FOR_A_BETTER
        before = np.zeros(len(self.pool.members))
        while following is not None:
            visited.add(following)
            self._visit(following)
            if len(self.weighed) >= enough:
                included = self._include()
                if np.abs(included - before).max() <= SETTLED:
                    break
                if enough >= most:
                    return False
                enough *= 2
                before = included
            following = self._draw(visited)
        return True

    def _include(self) -> Array:
        """Compute the inclusion probability (P,) of every member of the pool."""
        count = len(self.pool.members)
        included = np.zeros(count)
        total = 0.0
        for members, (value, _) in self.known.items():
            above = value - self.best
            weight = np.exp(above)
            places = list(members)
            included[places] += weight
            total += weight
        return included / total

    def _visit(self, members: Members) -> None:
        """Weigh all neighbours of a set."""
        _, ratios = self.known[members]
        self.near = self.pool.nothing.change_into(ratios).gather()
        for one in self._list_neighbours(ratios):
            self._add_to(one)
        for family in self.families:
            if family.whole in members:
                others = _leave_out(ratios, family.whole, *family.parts)
                self._add_parts(others, family.parts)

    def _list_neighbours(self, ratios: Ratios) -> list[Ratios]:
        """List a set and what stands around it, weighed together: one effect less, another one in its
        place, one for two."""
        members = sorted(ratios)
        smaller = [_leave_out(ratios, member) for member in members]
        weighed = self._weigh_ahead([ratios, *smaller])
        neighbours = [ratios]
        for member, others, (_, gains) in zip(members, smaller, weighed[1:], strict=True):
            first = _find_strongest(gains, member)
            neighbours += [others, *({**others, p: float(gains.ratio[p])} for p in first)]
        pairs = [pair for pair in self.related if ratios.keys() >= set(pair)]
        neighbours += [_leave_out(ratios, *pair) for pair in pairs]
        self._weigh_ahead(neighbours)
        return neighbours

    def _weigh_ahead(self, sets: Sequence[Ratios]) -> list[Weighed]:
        """Weigh some sets together, those that are not known."""
        new = {frozenset(one): one for one in sets}
        for known in (self.weighed, self.ahead):
            new = {key: one for key, one in new.items() if key not in known}
        weighed = self.pool.weigh_together(list(new.values()), self.near)
        self.ahead |= dict(zip(new, weighed, strict=True))
        keys = [frozenset(one) for one in sets]
        return [self.weighed.get(key) or self.ahead[key] for key in keys]

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

    def _add_to(self, ratios: Ratios) -> Weighed:
        """Weigh a set and every set with one effect more."""
        members = frozenset(ratios)
        if members in self.weighed:
            return self.weighed[members]
        weighed = self.ahead.pop(members, None) or self.pool.weigh(ratios, self.near)
        value, gains = weighed
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
                kept.append((-value, self.name(members)))
        kept.sort()
        costs = [cost for cost, _ in kept]
        sets = tuple(candidates for _, candidates in kept)
        log_posterior = -np.array(costs)
        return VisitedModels(sets, log_posterior)

    def name(self, members: Members) -> tuple[int, ...]:
        """Name a set by its candidates' numbers, in order."""
        known = self.pool.members
        candidates = [known[p] for p in members]
        candidates.sort()
        return tuple(candidates)


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
    walk, start = _begin(search, view, chosen)
    if walk is None:
        return NOTHING
    walk.walk(start, FOR_A_BETTER)
    return walk.collect(start)


def weigh_models(search: Search, view: View, chosen: Sequence[int]) -> VisitedModels:
    """Weigh the sets around the chosen effects of a view, as many as claims need: one by one, or
    sampled where these are too many."""
    walk, start = _begin(search, view, chosen)
    if walk is None:
        return NOTHING
    if walk.walk(start, FOR_CLAIMS):
        return walk.collect(start)
    _, ratios = walk.known[start]
    sampled = dict(sample_models(walk.pool, ratios, walk.rng, BY_SAMPLING))
    sampled.setdefault(start, TINY)
    weighed = [(-np.log(p), walk.name(members)) for members, p in sampled.items()]
    weighed.sort()
    log_posterior = -np.array([cost for cost, _ in weighed])
    return VisitedModels(tuple(members for _, members in weighed), log_posterior)


def _begin(
    search: Search, view: View, chosen: Sequence[int]
) -> tuple[_Walk, Members] | tuple[None, Members]:
    """Begin a walk at the chosen effects of a view; None where there are no candidates."""
    pool = gather_pool(search, view, chosen)
    if pool is None:
        return None, frozenset()
    place = {g: p for p, g in enumerate(pool.members)}
    pairs = list_related(search, view, chosen)
    related = tuple((place[g], place[h]) for g, h in pairs)
    (rng,) = search.rng.spawn(1)
    families = _place_families(search.traits.families, place)
    start = frozenset(place[g] for g in chosen)
    return _Walk(pool, related, families, rng), start
