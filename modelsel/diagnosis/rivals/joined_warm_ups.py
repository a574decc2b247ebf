"""One warm-up in the place of several functions of time that approximate it.

A warm-up whose constant lies between those that are looked for leaves a part of itself; where it is
large, that part is found as a second function of time at the same place."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from ..._typing import Array
from ...mechanisms.terms import Mechanism
from ..candidates.candidate import Candidate
from ..search.state import Search
from ..search.views import View
from ..shapes.candidate_kinds import CandidateKind
from ..shapes.distinct_places import Place
from ..shapes.driver_functions import IN_TIME
from ..shapes.shape_constants import find_time_constant
from .finding_groups import FindingGroup, build_listed
from .unlisted_shapes import UNLISTED_ODDS
from .warm_ups import fit_warm_up


def generate_joined_warm_ups(
    search: Search, view: View, chosen: Sequence[int]
) -> Iterator[FindingGroup]:
    """Generate the functions of time at one place, a warm-up among them, that one warm-up may stand for:
    every two, and all of the place, each with the warm-up that is most like their sum."""
    by_place: dict[Place, list[int]] = {}
    for g in chosen:
        mechanism = search.candidates[g].mechanism
        places = list(mechanism.names_by_place())
        names = mechanism.names()
        # a constant is no function of time
        is_in_time = names and names <= IN_TIME and not search.candidates[g].asked
        if is_in_time and len(places) == 1:
            by_place.setdefault(places[0], []).append(g)
    for place, members in by_place.items():
        groups = [*combinations(members, 2), tuple(members)]
        for group in dict.fromkeys(groups):
            if len(group) > 1:
                yield from _join(search, view, place, group)


def _join(
    search: Search, view: View, place: Place, group: tuple[int, ...]
) -> Iterator[FindingGroup]:
    """Join functions of time at a place into one warm-up, if one of them is such."""
    effects = [search.candidates[g] for g in group]
    mechanisms = [effect.mechanism for effect in effects]
    if all(find_time_constant(m) is None for m in mechanisms):
        return
    course = sum((_evaluate(search, view, m) for m in mechanisms), np.zeros(len(search.problem)))
    joined = fit_warm_up(search.problem, place, course)
    if joined is None or joined in mechanisms:
        return
    listed = build_listed(effects)
    prior = max(effect.prior for effect in effects) * UNLISTED_ODDS
    shape = Candidate(joined, CandidateKind.CELL, prior)
    yield FindingGroup(group, listed, (shape,))


def _evaluate(search: Search, view: View, mechanism: Mechanism) -> Array:
    """Evaluate (m,) what a fitted mechanism of one place does there in time."""
    fitted = view.fitted
    theta = fitted.theta[fitted.locate(mechanism)]
    course = np.zeros(len(search.problem))
    for size, term in zip(theta, mechanism.terms, strict=True):
        for screw in term.screws:
            values = screw.cause.of(search.problem.state)
            course += size * np.asarray(values)
    return course
