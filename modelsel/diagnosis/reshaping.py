"""Replace effects by shapes that explain them better, and continue the search with these."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from ..fitting.least_squares import Fit
from .candidates.candidate import Candidate
from .findings.claims import find_moved_joint, list_rivals_beside, weigh_alone
from .inference.evidence import compute_p_value
from .rivals.contenders import gather_contenders
from .rivals.joint_functions import list_joint_functions
from .rivals.pair_waves import list_pair_waves
from .search.state import LEVEL, Search
from .search.stepwise import Exploration, explore_further

# effects by their numbers, and what tells them better
Better = tuple[tuple[int, ...], Candidate]


def improve_shapes(explored: Exploration, joints: Collection[int]) -> Exploration:
    """Replace the effects that turn or shift some joints by better shapes, where there are any.

    What a nearly right shape leaves resembles a joint that does not repeat."""
    search, progress = explored.search, explored.progress
    view = progress.view
    better: list[Better] = []
    rivals = {
        g: list_rivals_beside(search, view, g)
        for g in progress.chosen
        if find_moved_joint(search.problem, search.candidates[g]) in joints
    }
    every = [rival.candidate for own in rivals.values() for rival in own]
    contenders = gather_contenders(search, view, every)
    for g, own in rivals.items():
        shape = weigh_alone(search, g, own, contenders).better
        if shape is not None:
            better.append(((g,), shape))
    if not better:
        return explored
    return take_shapes(explored, progress.chosen, progress.view.fitted, better) or explored


def look_closer(explored: Exploration, joints: Collection[int]) -> Exploration:
    """Go on with waves of two readings, functions of any shape and hysteresis at some joints, where one of
    these is the strongest explanation of what is left, beyond chance."""
    more = _list_more(explored.search, joints)
    if not more:
        return explored
    return go_on_with(explored, more)


def go_on_with(explored: Exploration, more: Sequence[Candidate]) -> Exploration:
    """Go on with further candidates, where one of them is the strongest explanation of what is left,
    beyond chance."""
    search, progress = explored.search, explored.progress
    offered = search.offer(more)
    start, chosen = progress.view.fitted, list(progress.chosen)
    view = offered.try_fit(chosen, start) if chosen else offered.first
    if view is None:
        return explored
    strongest = offered.name_strongest(view, chosen)
    is_new = strongest.top >= len(search.candidates)
    if not is_new or compute_p_value(strongest.evidence, search.null) > LEVEL:
        return explored
    return explore_further(offered, chosen, start, list(progress.path)) or explored


def _list_more(search: Search, joints: Collection[int]) -> list[Candidate]:
    """List what is offered at some joints alone, beyond what is known."""
    known = {candidate.mechanism for candidate in search.candidates}
    more: list[Candidate] = []
    for joint in sorted(joints):
        more += list_pair_waves(search.problem, search.candidates, joint)
        more += list_joint_functions(search.problem, search.candidates, joint)
    return [one for one in more if one.mechanism not in known]


def take_shapes(
    explored: Exploration,
    chosen: Sequence[int],
    start: Fit,
    better: Sequence[Better],
    constants: Sequence[Candidate] = (),
) -> Exploration | None:
    """Replace chosen effects by the shapes that explain them better, and continue the search; None
    where the data do not determine these. Of `constants`, those of the shapes' names are offered, too.

    An effect that was replaced once is not replaced again."""
    before, path = explored.search, list(explored.progress.path)
    left = list(chosen)
    candidates = list(before.candidates)
    place = {candidate.mechanism: g for g, candidate in enumerate(candidates)}
    added: list[int] = []
    for members, candidate in better:
        others = (candidates[g] for g in (*left, *added) if g not in members)
        bumped = {other.bumped_joint for other in others} - {0}
        if not set(members) <= set(left) or candidate.bumped_joint in bumped:
            continue
        given_up = " & ".join(candidates[g].label for g in members)
        path.append(f"{given_up} -> {candidate.label}")
        left = [g for g in left if g not in members]
        g = place.setdefault(candidate.mechanism, len(candidates))
        if g == len(candidates):
            candidates.append(candidate)
        added.append(g)
    names = {candidates[g].mechanism.name for g in added}
    for one in constants:
        if one.mechanism.name in names and one.mechanism not in place:
            place[one.mechanism] = len(candidates)
            candidates.append(one)
    shapes = tuple(candidates[len(before.candidates) :])
    search = before.offer(shapes) if shapes else before
    left += [g for g in dict.fromkeys(added) if g not in left]
    return explore_further(search, left, start, path)
