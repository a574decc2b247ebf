"""Replace effects by shapes that explain them better, and continue the search with these."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from ..fitting.least_squares import Fit
from .candidate_kinds import CandidateKind
from .candidates import Candidate
from .claims import find_moved_joint, weigh_alone
from .stepwise import Exploration, explore_further

# effects by their numbers, and what tells them better
Better = tuple[tuple[int, ...], Candidate]


def improve_shapes(explored: Exploration, joints: Collection[int]) -> Exploration:
    """Replace the effects that turn or shift some joints by better shapes, where there are any.

    What a nearly right shape leaves resembles a joint that does not repeat."""
    search, progress = explored.search, explored.progress
    better: list[Better] = []
    for g in progress.chosen:
        if find_moved_joint(search.problem, search.candidates[g]) not in joints:
            continue
        _, shape = weigh_alone(search, progress.view, g)
        if shape is not None:
            better.append(((g,), shape))
    if not better:
        return explored
    return take_shapes(explored, progress.chosen, progress.view.fitted, better)


def _is_second_bump(candidate: Candidate, others: Sequence[Candidate]) -> bool:
    """Whether a shape is an error around one reading of a joint that has one already."""
    if candidate.kind is not CandidateKind.BUMP:
        return False
    names = candidate.mechanism.names()
    bumps = [one for one in others if one.kind is CandidateKind.BUMP]
    return any(one.mechanism.names() == names for one in bumps)


def take_shapes(
    explored: Exploration, chosen: Sequence[int], start: Fit, better: Sequence[Better]
) -> Exploration:
    """Replace chosen effects by the shapes that explain them better, and continue the search.

    An effect that was replaced once is not replaced again."""
    before, path = explored.search, list(explored.progress.path)
    left = list(chosen)
    candidates = list(before.candidates)
    place = {candidate.mechanism: g for g, candidate in enumerate(candidates)}
    added: list[int] = []
    for members, candidate in better:
        others = [candidates[g] for g in (*left, *added) if g not in members]
        if not set(members) <= set(left) or _is_second_bump(candidate, others):
            continue
        given_up = " & ".join(candidates[g].label for g in members)
        path.append(f"{given_up} -> {candidate.label}")
        left = [g for g in left if g not in members]
        g = place.setdefault(candidate.mechanism, len(candidates))
        if g == len(candidates):
            candidates.append(candidate)
        added.append(g)
    shapes = tuple(candidates[len(before.candidates) :])
    search = before.offer(shapes) if shapes else before
    left += [g for g in dict.fromkeys(added) if g not in left]
    return explore_further(search, left, start, path) or explored
