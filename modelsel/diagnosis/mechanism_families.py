"""Families: a mechanism of several joints, and those of single joints that it is the sum of.

Where three joints lag, "all joints lag" is found first, and then further joints that cancel the
others. So the effects of a family are weighed together: the whole alone, parts alone, or both;
whichever the data make more probable stands."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..mechanisms.terms import Mechanism, Screw
from .candidates import Candidate
from .evidence import MIN_LOG_ODDS
from .joint_curves import build_curve, chain_effects, see_rest

if TYPE_CHECKING:
    from .state import Search
    from .views import View

# log of how much likelier a mechanism is in a joint where another joint has it
KIN = float(np.log(20))


class Family(NamedTuple):
    """The number of a mechanism of several joints, and those of its parts."""

    whole: int
    parts: tuple[int, ...]


def find_families(candidates: Sequence[Candidate]) -> list[Family]:
    """Find the registered mechanisms of several frames whose screws others have one by one."""
    screws = {g: _collect(c.mechanism) for g, c in enumerate(candidates) if c.registered}
    families = []
    for whole, own in screws.items():
        if len({screw.frame for screw in own}) < 2:
            continue
        parts = tuple(g for g, other in screws.items() if other < own)
        if len(parts) > 1:
            families.append(Family(whole, parts))
    return families


def _collect(mechanism: Mechanism) -> frozenset[Screw]:
    return frozenset(screw for term in mechanism.terms for screw in term.screws)


def generate_better_families(
    search: Search, chosen: Sequence[int], view: View
) -> Iterator[tuple[list[int], str]]:
    """Generate models in which the effects of a family are explained better together.

    Yields the chosen candidates, and what changed in words."""
    for family in search.families:
        now = [g for g in chosen if g == family.whole or g in family.parts]
        best = _find_better(search, family, now, view) if now else None
        if best is None:
            continue
        rest = [g for g in chosen if g not in now]
        before, after = (" & ".join(search.candidates[g].label for g in one) for one in (now, best))
        yield [*rest, *best], f"{before} -> {after}"


def weigh_families(search: Search, chosen: Sequence[int], view: View) -> dict[int, float]:
    """Weigh the effects of every family against the others that would do: the probability that
    those which are chosen are right, of each that would have to go."""
    shares: dict[int, float] = {}
    for family in search.families:
        now = [g for g in chosen if g == family.whole or g in family.parts]
        if not now:
            continue
        present, trials = _weigh(search, family, now, view)
        others = {frozenset(best): value for value, best in trials if set(best) != set(now)}
        # a set that were clearly better would have been taken
        odds = [(other, np.exp(min(value - present, 0.0))) for other, value in others.items()]
        for g in now:
            against = sum(odd for other, odd in odds if g not in other)
            shares[g] = min(shares.get(g, 1.0), float(1 / (1 + against)))
    return shares


def _find_better(
    search: Search, family: Family, now: Sequence[int], view: View
) -> list[int] | None:
    """Find the whole, or parts, or both, that explain more than `now`; None where none does."""
    present, trials = _weigh(search, family, now, view)
    value, best = max(trials, key=lambda trial: trial[0])
    if best and value > present + MIN_LOG_ODDS and set(best) != set(now):
        return best
    return None


def _weigh(
    search: Search, family: Family, now: Sequence[int], view: View
) -> tuple[float, list[tuple[float, list[int]]]]:
    """Weigh a family: the log evidence of its effects `now`, and that of the whole alone, of parts
    alone, and of both, each with its effects."""
    which = np.array(sorted((family.whole, *family.parts)), dtype=np.intp)
    none_free = np.zeros(len(which), bool)
    curve = build_curve(search.columns, which, search.log_prior[which], none_free)
    released = view.release(*(search.candidates[g] for g in now))
    start = see_rest(curve, view.scan, view.response, released)
    present = chain_effects(start.offer(np.isin(which, now)), len(now), at_any_cost=True)
    is_whole = which == family.whole
    trials = [
        chain_effects(start.offer(is_whole), 1),
        chain_effects(start.offer(~is_whole), len(family.parts)),
        chain_effects(start, len(which)),
    ]
    (value, _), *others = (_add_kin(search, *trial) for trial in (present, *trials))
    return value, others


def _add_kin(search: Search, value: float, members: list[int]) -> tuple[float, list[int]]:
    """Add to the log evidence of some effects that a mechanism of one joint makes that of another
    joint likelier: joints are built alike."""
    labels = []
    for g in set(members):
        candidate = search.candidates[g]
        labels.append(candidate.label)
    likelier = KIN * count_kin(labels)
    return value + likelier, members


def count_kin(labels: Iterable[str]) -> int:
    """Count the labels that name a mechanism which another one before has in another joint."""
    stems = []
    for label in labels:
        stem = find_stem(label)
        stems.append(stem)
    kinds = set(stems)
    return len(stems) - len(kinds)


def find_stem(label: str) -> str:
    """Find the name of a mechanism without its joint."""
    joint = r":\d+$"
    return re.sub(joint, "", label)
