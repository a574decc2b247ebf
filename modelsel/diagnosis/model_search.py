"""A search that may take back: sets of effects around the one that the stepwise search has chosen.

From every set that is visited the neighbours are weighed by exact evidence: one effect more, one
less, one for another, two for one, one for two. The next set is drawn by its posterior probability
from those not visited yet (shotgun stochastic search: Hans, Dobra & West 2007, J. Am. Stat. Assoc.
102:507). What is told of an effect is weighted over all sets that were weighed: an inclusion
probability for each level of its claim."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from .._typing import Array, Index
from .candidates import Candidate
from .model_pool import Gains, Pool, build_pool, list_related
from .state import Search, View

# sets of which all that one effect more adds is computed, at most
MOST_WEIGHED = 300
# log posterior below the best from which a set is forgotten, and need not be visited
FORGOTTEN, UNLIKELY = 12.0, 5.0
# explanations that are tried first where two are put in the place of one
FIRST_OF_TWO = 3
# sets that are told
TOLD = 5

Members = frozenset[int]
Ratios = dict[int, float]


@dataclass(frozen=True)
class WeighedModel:
    """A set of effects with its probability among all that were weighed; whether it is chosen."""

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
        weight = np.exp(self.log_posterior - self.log_posterior.max())
        return np.asarray(weight / weight.sum())

    def find_better(self, chosen: Sequence[int], odds: float) -> tuple[int, ...] | None:
        """The most probable set, if it is more probable than the chosen one by log odds."""
        own = self.sets.index(tuple(sorted(chosen)))
        if self.log_posterior[0] - self.log_posterior[own] > odds:
            return self.sets[0]
        return None

    def include(self, chosen: Sequence[int], signatures: Sequence[Index]) -> dict[int, Array]:
        """Compute for each chosen effect the probability of every level of what it says: the share
        of the sets that say it, too.

        Whether there is an effect at all is what its p-value tells: sets that only lack some of the
        chosen effects do not count."""
        now = frozenset(chosen)
        told = [k for k, one in enumerate(self.sets) if frozenset(one) == now or set(one) - now]
        weight = self.probability[told]
        weight = weight / weight.sum()
        included = {}
        for g in chosen:
            levels = []
            for known in signatures:
                alike = [
                    self._count(one, known, g) for one in (chosen, *(self.sets[k] for k in told))
                ]
                levels.append(float(weight[np.array(alike[1:]) >= alike[0]].sum()))
            included[g] = np.array(levels)
        return included

    @staticmethod
    def _count(one: Sequence[int], known: Index, g: int) -> int:
        """Count the effects of a set that say the same as candidate g."""
        return int((known[list(one)] == known[g]).sum())

    def tell(self, found: Sequence[Candidate], chosen: Sequence[int]) -> tuple[WeighedModel, ...]:
        """The most probable sets, and the chosen one; those of the same names count as one."""
        now = _join_labels(found, chosen)
        together: dict[tuple[str, ...], tuple[tuple[int, ...], float]] = {}
        for one, probability in zip(self.sets, self.probability.tolist(), strict=True):
            names = _join_labels(found, one)
            first, sum_before = together.get(names, (one, 0.0))
            together[names] = first, sum_before + probability
        ranked = sorted(together, key=lambda names: -together[names][1])
        told = dict.fromkeys((*ranked[: TOLD - 1], now, *ranked[TOLD - 1 : TOLD]))
        return tuple(
            WeighedModel(
                tuple(found[g] for g in together[names][0]), together[names][1], names == now
            )
            for names in sorted(list(told)[:TOLD], key=ranked.index)
        )


def _join_labels(found: Sequence[Candidate], members: Sequence[int]) -> tuple[str, ...]:
    return tuple(sorted(found[g].label for g in members))


class _Weighed(NamedTuple):
    """A set with its log posterior, and what each effect more would add."""

    value: float
    gains: Gains
    ratios: Ratios


@dataclass
class _Walk:
    """Where a search stands: the sets known by their log posteriors and ratios, and those of which
    every addition was weighed."""

    pool: Pool
    related: tuple[tuple[int, int], ...]
    rng: np.random.Generator
    known: dict[Members, tuple[float, Ratios]] = field(default_factory=dict)
    weighed: dict[Members, _Weighed] = field(default_factory=dict)
    best: float = -np.inf

    def start(self, members: Members) -> None:
        """Weigh the first set, each effect with the ratio that suits it best given the others."""
        ratios = self._settle(members)
        self._record(members, self._weigh(ratios).value, ratios)

    def _settle(self, members: Members) -> Ratios:
        """Find each effect's ratio: added one after the other, the strongest first, then again."""
        ratios: Ratios = {}
        while len(ratios) < len(members):
            _, gains = self.pool.weigh(ratios)
            left = sorted(members - ratios.keys())
            strongest = left[int(np.argmax(gains.value[left]))]
            ratios[strongest] = float(gains.ratio[strongest])
        for member in sorted(members):
            others = {p: ratio for p, ratio in ratios.items() if p != member}
            ratios[member] = float(self.pool.weigh(others)[1].ratio[member])
        return ratios

    def visit(self, members: Members) -> None:
        """Weigh all neighbours of a set."""
        _, ratios = self.known[members]
        self._add_to(ratios)
        for member in sorted(members):
            rest = self._add_to(_without(ratios, member))
            order = np.argsort(-rest.gains.value, kind="stable")
            for first in [p for p in order[: FIRST_OF_TWO + 1].tolist() if p != member][
                :FIRST_OF_TWO
            ]:
                self._add_to({**rest.ratios, first: float(rest.gains.ratio[first])})
        for pair in self.related:
            if members.issuperset(pair):
                self._add_to(_without(ratios, *pair))

    def _add_to(self, ratios: Ratios) -> _Weighed:
        """Weigh a set, and every set of one effect more."""
        members = frozenset(ratios)
        if members in self.weighed:
            return self.weighed[members]
        weighed = self._weigh(ratios)
        self.weighed[members] = weighed
        self._record(members, weighed.value, ratios)
        values = weighed.value + weighed.gains.value
        for p in np.flatnonzero(values > max(self.best, values.max()) - FORGOTTEN).tolist():
            more = {**ratios, p: float(weighed.gains.ratio[p])}
            self._record(members | {p}, float(values[p]), more)
        return weighed

    def _weigh(self, ratios: Ratios) -> _Weighed:
        value, gains = self.pool.weigh(ratios)
        return _Weighed(value, gains, ratios)

    def _record(self, members: Members, value: float, ratios: Ratios) -> None:
        if value > self.known.get(members, (-np.inf, ratios))[0]:
            self.known[members] = value, ratios
        self.best = max(self.best, value)

    def walk(self, start: Members) -> None:
        """Visit sets, drawn by their probability, until none that is left is likely."""
        self.start(start)
        visited: set[Members] = set()
        following: Members | None = start
        while following is not None and len(self.weighed) < MOST_WEIGHED:
            visited.add(following)
            self.visit(following)
            following = self._draw(visited)

    def _draw(self, visited: set[Members]) -> Members | None:
        """Draw a set that was not visited yet; None where none is likely."""
        likely = [
            (members, value)
            for members, (value, _) in self.known.items()
            if value > self.best - UNLIKELY and members not in visited
        ]
        if not likely:
            return None
        weight = np.exp(np.array([value for _, value in likely]) - self.best)
        return likely[int(self.rng.choice(len(likely), p=weight / weight.sum()))][0]

    def collect(self, start: Members) -> VisitedModels:
        """Collect the sets that are worth telling of."""
        kept = [
            (-value, tuple(sorted(self.pool.members[p] for p in members)))
            for members, (value, _) in self.known.items()
            if value > self.best - FORGOTTEN or members == start
        ]
        kept.sort()
        return VisitedModels(
            tuple(members for _, members in kept), -np.array([value for value, _ in kept])
        )


def _without(ratios: Ratios, *members: int) -> Ratios:
    return {p: ratio for p, ratio in ratios.items() if p not in members}


def visit_models(search: Search, view: View, chosen: Sequence[int]) -> VisitedModels:
    """Search around the chosen effects of a view for sets that are as probable, or more."""
    pool = build_pool(search, view, chosen)
    place = {g: p for p, g in enumerate(pool.members)}
    related = tuple((place[g], place[h]) for g, h in list_related(search, view, chosen))
    walk = _Walk(pool, related, search.rng.spawn(1)[0])
    start = frozenset(place[g] for g in chosen)
    walk.walk(start)
    return walk.collect(start)
