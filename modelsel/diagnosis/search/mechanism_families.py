"""Families: a mechanism of several joints, and those of single joints that it is the sum of.

Where three joints lag, "all joints lag" is found first, and then further joints that cancel the
others. So the effects of a family are weighed together: the whole alone, parts alone, or both;
whichever the data make more probable stands. The product of two readings at a joint is such a whole,
too: it holds either reading by itself, for which two effects of that joint are another name."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..._typing import Index, Mask
from ...mechanisms.terms import Mechanism, Screw
from ..candidates.alike_mechanisms import number_kinds
from ..candidates.candidate import Candidate
from ..candidates.own_candidates import Screws
from ..inference.evidence import MIN_LOG_ODDS
from ..inference.joint_curves import build_curve, see_rest
from ..shapes.candidate_kinds import CandidateKind
from .model_pool import Pool, assemble_pool

if TYPE_CHECKING:
    from .state import Search
    from .views import View


class Family(NamedTuple):
    """The number of a mechanism of several joints, and those of its parts; or of a product at one
    place, and those of its readings by themselves."""

    whole: int
    parts: tuple[int, ...]
    one_place: bool = False

    def list_chosen(self, chosen: Sequence[int]) -> list[int]:
        """List its members among chosen candidates; none where these are one reading of a product."""
        own = [g for g in chosen if g == self.whole or g in self.parts]
        if self.one_place and self.whole not in own and len(own) == 1:
            return []
        return own


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
    return [*families, *_find_products(candidates)]


def _find_products(candidates: Sequence[Candidate]) -> Iterator[Family]:
    """Find the products of two readings at a joint of which both are candidates by themselves."""
    place: dict[Screws, int] = {}
    products: list[int] = []
    for g, candidate in enumerate(candidates):
        if candidate.kind is CandidateKind.PRODUCT:
            products.append(g)
        elif len(candidate.mechanism.terms) == 1:
            place.setdefault(candidate.screws, g)
    for whole in products:
        alone = [frozenset((key,)) for key in candidates[whole].screws]
        parts = tuple(sorted(place[key] for key in alone if key in place))
        if len(parts) > 1:
            yield Family(whole, parts, one_place=True)


def _collect(mechanism: Mechanism) -> frozenset[Screw]:
    return frozenset(screw for term in mechanism.terms for screw in term.screws)


def generate_better_families(
    search: Search, chosen: Sequence[int], view: View
) -> Iterator[tuple[list[int], str]]:
    """Generate models in which the effects of a family are explained better together.

    Yields the chosen candidates, and what changed in words."""
    for family in search.traits.families:
        now = family.list_chosen(chosen)
        best = _find_better(search, family, now, view) if now else None
        if best is None:
            continue
        rest = [g for g in chosen if g not in now]
        before, after = (" & ".join(search.candidates[g].label for g in one) for one in (now, best))
        yield [*rest, *best], f"{before} -> {after}"


def weigh_families(
    search: Search, chosen: Sequence[int], view: View, one_place: bool = False
) -> dict[int, float]:
    """Weigh the effects of every family, of several places or of one, against the others that would
    do: the probability that those which are chosen are right, of each that would have to go."""
    shares: dict[int, float] = {}
    for family in search.traits.families:
        now = family.list_chosen(chosen)
        if not now or family.one_place is not one_place:
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
    """Weigh a family: the log posterior of its effects `now`, and that of the whole alone, of parts
    alone, and of both, each with its effects.

    The evidence of each set is joint, as in a model search: where effects are added one after the
    other, several of one size seem as likely as their sum, for which one number is enough."""
    which = np.array(sorted((family.whole, *family.parts)), dtype=np.intp)
    pool = _gather(search, which, now, view)
    is_whole = which == family.whole
    every = np.ones(len(which), bool)
    trials = []
    for offered in (is_whole, ~is_whole, every):
        best = _choose(pool, offered)
        trials.append(_weigh_set(pool, best))
    places = np.searchsorted(which, now)
    present, _ = _weigh_set(pool, places.tolist())
    return present, trials


def _gather(search: Search, which: Index, now: Sequence[int], view: View) -> Pool:
    """Gather candidates in a pool, beyond a view's model without some of its effects."""
    effects = [search.candidates[g] for g in now]
    labels = [search.candidates[g].label for g in which]
    log_prior = search.log_prior[which]
    none_free = np.zeros(len(which), bool)
    none_single = np.zeros(len(which), np.intp)
    curve = build_curve(search.columns, which, log_prior, none_free, ~none_free)
    released = view.release(*effects)
    start = see_rest(curve, view.scan, view.response, released)
    kinds = number_kinds(labels)
    return assemble_pool(start, log_prior - search.bound, kinds, none_single)


def _choose(pool: Pool, offered: Mask) -> list[int]:
    """Choose members (P,) of a pool that are offered, the likeliest first, as long as one adds."""
    ratios: dict[int, float] = {}
    while True:
        _, gains = pool.weigh(ratios)
        value = np.where(offered, gains.value, -np.inf)
        best = int(value.argmax())
        if not value[best] > 0:
            return list(ratios)
        ratios[best] = float(gains.ratio[best])


def _weigh_set(pool: Pool, members: Sequence[int]) -> tuple[float, list[int]]:
    """Compute the log posterior of a set of a pool's members, with their candidates."""
    ratios = pool.settle(frozenset(members))
    value, _ = pool.weigh(ratios)
    candidates = [pool.members[p] for p in members]
    return value, candidates
