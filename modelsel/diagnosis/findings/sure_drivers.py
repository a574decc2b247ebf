"""Sure drivers: names that most explanations of a finding depend on, where not all that it depends on
is proven.

Explanations of one place may share a driver and differ in the rest: play depends on the side that a
joint came from, a rival on that and on the joint's reading."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ..._typing import Array
from ..candidates.candidate import Candidate
from ..candidates.signatures import PROVEN, add_sides, list_drivers_by_place
from ..rivals.unlisted_shapes import Rival
from ..search.state import Search
from ..search.weighed_models import VisitedModels

# probability from which an explanation is looked at
NEGLIGIBLE = 1e-6


def sum_by_driver(
    search: Search, g: int, probability: Array, rivals: Sequence[Rival]
) -> dict[str, float]:
    """Sum the probabilities (G + A,) of all explanations of an effect that act where it does, by each
    name that it depends on.

    They are of all candidates, then of the rivals. An effect of several places has none."""
    told = search.traits.acting_parts[g]
    drivers = list_drivers_by_place(told)
    if len(drivers) != 1:
        return {}
    (names,) = drivers.values()
    total = dict.fromkeys(sorted(names), 0.0)
    for own, share in _list_explanations(search, g, probability, rivals):
        for name in names & own:
            total[name] += share
    return total


def _list_explanations(
    search: Search, g: int, probability: Array, rivals: Sequence[Rival]
) -> Iterator[tuple[frozenset[str], float]]:
    """List what the explanations depend on that act where an effect does, with their probabilities."""
    known = search.traits.signatures[0]
    count = len(known)
    counts = (known == known[g]) & (probability[:count] > NEGLIGIBLE)
    for k in np.flatnonzero(counts).tolist():
        yield _depend(search.traits.acting_parts[k]), float(probability[k])
    for rival, share in zip(rivals, probability[count:].tolist(), strict=True):
        if not rival.agrees:
            continue
        drivers = rival.stands_for
        if drivers is None:
            drivers = _depend(rival.candidate)
        yield drivers, share


def find_sure(
    search: Search,
    g: int,
    chosen: Sequence[int],
    weights: Mapping[str, float],
    models: VisitedModels,
) -> dict[str, float]:
    """Find the names that an effect depends on in most explanations, with their probabilities.

    `weights`: the probability of each name against the effect's rivals; `models`: the sets of effects
    that were weighed, in which it holds, too."""
    places = search.traits.signatures[0]
    members = models.members.union(chosen)
    drivers = {k: _depend(search.traits.acting_parts[k]) for k in members if places[k] == places[g]}
    sure = {}
    for name, weight in weights.items():
        like = [k for k, names in drivers.items() if name in names]
        probability = min(weight, models.include_like(g, like, chosen))
        if probability >= PROVEN:
            sure[name] = probability
    return sure


def _depend(candidate: Candidate) -> frozenset[str]:
    """Return what a candidate depends on, at any place; a last move says its side, too."""
    drivers = list_drivers_by_place(candidate)
    return add_sides(frozenset[str]().union(*drivers.values()))
