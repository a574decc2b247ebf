"""Targets that slipped alike, told as that.

Where two of three targets are shifted alike, the search finds a step of all three, and one that puts
the third back where it stood; or two steps that happen to be equal. One step of the two needs neither
coincidence. So every two steps of targets are weighed against one step: of the targets that either
moves, or of those that only one of them moves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, pairwise

import numpy as np

from ...mechanisms.environment import STEPS
from ...mechanisms.step_moments import list_step_moments
from ..candidates.candidate import Candidate
from ..candidates.nested_steps import Targets, is_target_step, list_moved_targets
from ..candidates.session_steps import (
    build_common_steps,
    have_own_name,
    list_measured_targets,
    round_between,
)
from ..search.state import Search
from ..shapes.candidate_kinds import CandidateKind
from .finding_groups import FindingGroup, build_listed


def generate_common_steps(search: Search, chosen: Sequence[int]) -> Iterator[FindingGroup]:
    """Generate the pairs of chosen steps for which one step of some targets may stand, with this step
    at every moment. Steps of one target, and of all, are candidates of every search."""
    problem = search.problem
    data = problem.data
    every = list_measured_targets(data)
    steps = {g: search.candidates[g] for g in chosen if is_target_step(search.candidates[g])}
    for (g, first), (h, second) in combinations(steps.items(), 2):
        targets = _find_common(
            list_moved_targets(problem, first), list_moved_targets(problem, second)
        )
        if len(targets) > 1 and targets != every and have_own_name(data, targets):
            common = _build_candidates(search, targets, (first, second))
            listed = build_listed([first, second])
            yield FindingGroup((g, h), listed, common)


def _find_common(first: Targets, second: Targets) -> Targets:
    """Find the targets that two steps may move alike: either one's, or those that the smaller step does
    not put back. None where they overlap otherwise."""
    both = first & second
    if both and both not in (first, second):
        return frozenset()
    return first ^ second


def _build_candidates(
    search: Search, targets: Targets, pair: Sequence[Candidate]
) -> tuple[Candidate, ...]:
    """Build the step of some targets that may stand for a pair of steps, at every moment. All such
    groups of targets share the prior probability of one step."""
    count = len(list_measured_targets(search.problem.data))
    # without none, all, and single ones
    groups = 2**count - 2 - count
    moments = _list_moments(search, targets, pair)
    prior = max(step.prior for step in pair) / groups
    asked = any(step.asked for step in pair)
    built = build_common_steps(search.problem, targets, moments)
    kind = CandidateKind.MECHANISM
    return tuple(Candidate(step, kind, prior, asked=asked) for step in built)


def _list_moments(search: Search, targets: Targets, pair: Sequence[Candidate]) -> set[float]:
    """List the moments at which steps of some targets are scanned, and all between two of their rows
    around those of a pair: what no scanned moment parts, the targets together may."""
    data = search.problem.data
    moments: set[float] = set()
    for step in filter(is_target_step, search.candidates):
        if list_moved_targets(search.problem, step) <= targets:
            moments |= list_step_moments(step.mechanism.terms)
    found = list_step_moments(term for step in pair for term in step.mechanism.terms)
    earlier = [at for at in STEPS if at < min(found)]
    later = [at for at in STEPS if at > max(found)]
    low, high = max(earlier, default=0.0), min(later, default=1.0)
    own = np.unique(data.progress[np.isin(data.target, list(targets))])
    for before, after in pairwise(own.tolist()):
        is_near = low < after and before < high
        if is_near and not any(before < at < after for at in moments):
            moments.add(round_between(before, after))
    return moments
