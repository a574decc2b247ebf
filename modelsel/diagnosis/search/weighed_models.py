"""Sets of effects with their probabilities, and how much of each effect holds in most of them."""

from __future__ import annotations

from collections.abc import Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..._typing import Array, Index, Mask
from ..candidates.candidate import Candidate
from ..candidates.nested_names import NestedNames
from ..candidates.signatures import Parts

# most probable sets that are reported
TOLD = 5


@dataclass(frozen=True)
class WeighedModel:
    """A set of effects, its probability among all of them, and whether it is the chosen one."""

    effects: tuple[Candidate, ...]
    probability: float
    chosen: bool


class VisitedModels(NamedTuple):
    """The sets that a search has weighed or sampled, by their candidates' numbers, the most probable first,
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

    def find_log_posterior(self, chosen: Sequence[int]) -> float:
        """Find the log posterior of the chosen set, which is among them."""
        own = self.sets.index(tuple(sorted(chosen)))
        return float(self.log_posterior[own])

    def find_better(
        self, chosen: Sequence[int], odds: float, held: Collection[int] = ()
    ) -> tuple[int, ...] | None:
        """Find the most probable set that replaces some of the chosen effects, none of those `held`, if its
        log odds against the chosen set exceed `odds`.

        Sets that only add or only drop effects do not count: the stepwise search has tested these,
        under more than one null distribution."""
        now = frozenset(chosen)
        least = self.find_log_posterior(chosen) + odds
        for one, value in zip(self.sets, self.log_posterior, strict=True):
            if value <= least:
                break
            removed = now.difference(one)
            if _replaces(now, one) and removed.isdisjoint(held):
                return one
        return None

    def tell_apart(self, names: NestedNames, chosen: Sequence[int]) -> VisitedModels:
        """Tell what two effects of a set say together each by its own; the `chosen` set as it is."""
        now = tuple(sorted(chosen))
        told: list[tuple[int, ...]] = []
        for one in self.sets:
            apart = one
            if one != now:
                apart = names.tell_apart(one)
            told.append(apart)
        sets = tuple(told)
        return self._replace(sets=sets)

    @property
    def members(self) -> frozenset[int]:
        """The candidates that are in one of the sets."""
        return frozenset[int]().union(*self.sets)

    def include(
        self,
        chosen: Sequence[int],
        signatures: Sequence[Index],
        parts: Mapping[int, Parts],
        forms: Index,
    ) -> dict[int, Array]:
        """Compute the inclusion probability of every level of each chosen effect's claim.

        That is the total probability of the sets which agree with the effect at that level.
        `signatures`: what every candidate says at each level, as numbers; `parts`: the same part by
        part, of each member of a set; `forms`: those that say the same at all levels, -1 of others.
        Sets without anything in the effect's place count, too: chance may explain what is hardly
        significant."""
        weight = self.probability
        table = self._tabulate(chosen)
        included: dict[int, Array] = {}
        for g in chosen:
            levels = np.zeros(len(signatures))
            for level, known in enumerate(signatures):
                told = table.say_as_much(known, g, chosen)
                if forms[g] >= 0:
                    told |= table.say_as_much(forms, g, chosen)
                told |= table.say_together(parts, level, g, chosen, ~told)
                levels[level] = weight[told].sum()
            included[g] = levels
        return included

    def include_like(self, g: int, like: Collection[int], chosen: Sequence[int]) -> float:
        """Compute the probability of the sets that have effect g, or as many effects among those
        `like` it as the chosen ones have."""
        table = self._tabulate(chosen)
        known = np.full(table.candidates.max() + 1, -1)
        known[list(like)] = 0
        told = table.say_as_much(known, g, chosen)
        return float(self.probability[told].sum())

    def _tabulate(self, chosen: Sequence[int]) -> _Table:
        """Tabulate which candidates are in which set."""
        candidates = sorted(self.members.union(chosen))
        column = {g: k for k, g in enumerate(candidates)}
        has = np.zeros((len(self.sets), len(candidates)), bool)
        for row, one in enumerate(self.sets):
            has[row, [column[g] for g in one]] = True
        return _Table(np.array(candidates, dtype=np.intp), column, has)

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


class _Table(NamedTuple):
    """Which of the candidates (c,) are in which of the sets: `has` (n, c); `column` of each."""

    candidates: Index
    column: dict[int, int]
    has: Mask

    def say_as_much(self, known: Index, g: int, chosen: Sequence[int]) -> Mask:
        """Whether each set (n,) has candidate g, or as many effects that say the same as the chosen
        ones do."""
        same = known[self.candidates] == known[g]
        needed = (known[list(chosen)] == known[g]).sum()
        said = self.has[:, same].sum(1)
        return np.asarray(self.has[:, self.column[g]] | (said >= needed))

    def say_together(
        self, parts: Mapping[int, Parts], level: int, g: int, chosen: Sequence[int], asked: Mask
    ) -> Mask:
        """Whether in each of the sets that are asked (n,) those members that are not chosen say
        together what candidate g says: the twists of joints 2 and 3, each by itself, turn the same
        joints as the twist of both."""
        own = parts[g][level]
        others = [k for k in self.candidates.tolist() if k not in chosen and parts[k][level] <= own]
        columns = [self.column[k] for k in others]
        told = np.zeros(len(self.has), bool)
        for row in np.flatnonzero(asked & self.has[:, columns].any(1)).tolist():
            members = [
                k for k, column in zip(others, columns, strict=True) if self.has[row, column]
            ]
            together = frozenset[Hashable]().union(*(parts[k][level] for k in members))
            told[row] = together == own
        return told


def _replaces(before: frozenset[int], after: Sequence[int]) -> bool:
    """Whether a set has others in the place of some effects, one more than these at most."""
    removed = len(before.difference(after))
    added = len(after) + removed - len(before)
    return removed > 0 and 0 < added <= removed + 1


def _join_labels(found: Sequence[Candidate], members: Sequence[int]) -> tuple[str, ...]:
    labels = [found[g].label for g in members]
    labels.sort()
    return tuple(labels)
