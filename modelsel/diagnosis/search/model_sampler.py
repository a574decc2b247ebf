"""Sampling of sets of effects by their probability.

Where many effects of a model have rivals, the likely sets are too many to be weighed one by one, and
those next to the chosen set seem likelier than they are. A Gibbs sampler takes one effect after the
other out of a set, and draws what stands in its place given all others: another explanation, or
nothing. A set of k effects fills k of L places in L!/(L - k)! ways, so that the odds of one effect more
are divided by the places that are free: then every set is drawn as often as it is probable. Averaged
are the probabilities of all that could have been drawn, not the draws alone (Gelfand & Smith 1990, J.
Am. Stat. Assoc. 85:398)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..._typing import Array, Index
from .fitted_sets import FittedSet
from .model_pool import Gains, Pool

# places beyond those that a chosen set fills, and rounds of all places: the first of them do not count,
# and no more are gone where the sets' evidence is known already
FREE_PLACES = 8
FIRST_ROUNDS, MOST_ROUNDS = 4, 400
# probability from which a set that could have been drawn counts
COUNTED = 1e-3

Members = frozenset[int]
Ratios = dict[int, float]


@dataclass
class _Sampler:
    """Where the sampler stands: the members in their places, each with its variance ratio, None in
    those that are free.

    `near`: the set that was weighed last; `known`: what each member would add to a set; `weight`: how
    probable the sets were, summed over the draws."""

    pool: Pool
    rng: np.random.Generator
    places: list[tuple[int, float] | None]
    near: FittedSet
    known: dict[frozenset[tuple[int, float]], Gains] = field(default_factory=dict)
    weight: dict[Members, float] = field(default_factory=dict)

    def go_round(self, counts: bool) -> None:
        """Draw anew what stands in every place, in a random order."""
        count = len(self.places)
        # from the pool's own products, so that rounding does not add up
        now = dict(own for own in self.places if own is not None)
        self.near = self.pool.nothing.change_into(now).gather()
        for place in self.rng.permutation(count).tolist():
            beside = [*self.places[:place], *self.places[place + 1 :]]
            others = dict(own for own in beside if own is not None)
            self.places[place] = self._draw(others, counts)

    def _draw(self, others: Ratios, counts: bool) -> tuple[int, float] | None:
        """Draw what stands in a place beside the others."""
        gains = self._weigh(others)
        free = len(self.places) - len(others)
        odds = np.append(gains.value - np.log(free), 0.0)
        probability = np.exp(odds - odds.max())
        probability /= probability.sum()
        if counts:
            self._count(others, probability)
        nothing = len(probability) - 1
        drawn = int(self.rng.choice(len(probability), p=probability))
        return None if drawn == nothing else (drawn, float(gains.ratio[drawn]))

    def _weigh(self, others: Ratios) -> Gains:
        key = frozenset(others.items())
        if key not in self.known:
            self.near = self.near.change_into(others)
            _, self.known[key] = self.pool.weigh(others, self.near)
        return self.known[key]

    def _count(self, others: Ratios, probability: Array) -> None:
        """Count the sets that could be drawn, by their probability; the last is that of the others."""
        rest = frozenset(others)
        nothing = len(probability) - 1
        likely: Index = np.flatnonzero(probability > COUNTED)
        for drawn in likely.tolist():
            members = rest if drawn == nothing else rest | {drawn}
            before = self.weight.get(members, 0.0)
            self.weight[members] = before + float(probability[drawn])


def sample_models(
    pool: Pool, start: Ratios, rng: np.random.Generator, most: int
) -> Mapping[Members, float]:
    """Sample sets of a pool's members, from one with its variance ratios: how probable each is.

    For about `most` sets what each member would add to them is weighed."""
    sampler = _Sampler(pool, rng, [*start.items(), *[None] * FREE_PLACES], pool.nothing)
    for number in range(MOST_ROUNDS):
        if len(sampler.known) >= most:
            break
        sampler.go_round(number >= FIRST_ROUNDS)
    total = sum(sampler.weight.values())
    return {members: weight / total for members, weight in sampler.weight.items()}
