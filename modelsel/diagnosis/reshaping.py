"""Shapes put in the place of effects: what tells some of them better is fitted instead, and the search
goes on."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from ..fitting.least_squares import Fit
from .candidates import Candidate
from .claims import find_moved_joint, weigh_alone
from .stepwise import Exploration, explore_further

# effects by their numbers, and what tells them better
Better = tuple[tuple[int, ...], Candidate]


def improve_shapes(explored: Exploration, joints: Collection[int]) -> Exploration:
    """Put better shapes in the place of the effects that turn or shift some joints.

    What a shape leaves that is only nearly right resembles a joint that does not repeat."""
    search, progress = explored.search, explored.progress
    better: list[Better] = []
    for g in progress.chosen:
        if find_moved_joint(search.problem, search.found[g]) not in joints:
            continue
        _, shape = weigh_alone(search, progress.view, g)
        if shape is not None:
            better.append(((g,), shape))
    if not better:
        return explored
    return take_shapes(explored, progress.chosen, progress.view.fitted, better)


def take_shapes(
    explored: Exploration, chosen: Sequence[int], start: Fit, better: Sequence[Better]
) -> Exploration:
    """Put what tells chosen effects better in their place, and let the search go on.

    An effect that has given way once does not give way again."""
    before, path = explored.search, list(explored.progress.path)
    left = list(chosen)
    found = list(before.found)
    place = {candidate.mechanism: g for g, candidate in enumerate(found)}
    added: list[int] = []
    for members, candidate in better:
        if not set(members) <= set(left):
            continue
        given_up = " & ".join(found[g].label for g in members)
        path.append(f"{given_up} -> {candidate.label}")
        left = [g for g in left if g not in members]
        g = place.setdefault(candidate.mechanism, len(found))
        if g == len(found):
            found.append(candidate)
        added.append(g)
    shapes = tuple(found[len(before.found) :])
    search = before.offer(shapes) if shapes else before
    left += [g for g in dict.fromkeys(added) if g not in left]
    return explore_further(search, left, start, path) or explored
