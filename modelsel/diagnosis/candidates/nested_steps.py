"""Steps of targets of which one moves a part of what another one does.

Beside a step of target B a step of both A and B says what one of A says: the same model, in other
numbers. Of two such names one is no rival of the other."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from ..._typing import Index
from ...fitting.problem import Problem
from ...mechanisms.campaign_registry import TARGET_STEP
from ...mechanisms.moved_targets import find_moved_targets
from ...mechanisms.step_moments import list_step_moments
from .candidate import Candidate
from .scanned_constants import COORDINATES_OF_STEP

Targets = frozenset[int]


def is_target_step(candidate: Candidate) -> bool:
    """Return whether a candidate is a registered step of targets."""
    mechanism = candidate.mechanism
    is_step = mechanism.stem == TARGET_STEP
    return candidate.registered and is_step


def list_moved_targets(problem: Problem, step: Candidate) -> Targets:
    """List the targets (0-based) that a step moves."""
    moved = find_moved_targets(step.mechanism)
    numbers = [target.index for target in moved]
    if numbers:
        return frozenset(numbers)
    count = len(problem.data.targets)
    every = range(count)
    return frozenset(every)


class _Step(NamedTuple):
    """The targets that a step moves, and when."""

    targets: Targets
    at: float


class NestedSteps:
    """The steps of targets among some candidates, by their numbers; none where there is one target."""

    def __init__(self, problem: Problem, candidates: Sequence[Candidate]):
        self.problem = problem
        self.steps: dict[int, _Step] = {}
        if len(problem.data.targets) == 1:
            return
        for g, candidate in enumerate(candidates):
            moments = list_step_moments(candidate.mechanism.terms)
            if is_target_step(candidate) and len(moments) == 1:
                targets = list_moved_targets(problem, candidate)
                self.steps[g] = _Step(targets, moments.pop())

    def list_other_names(self, g: int, others: Collection[int]) -> Index:
        """List the candidates that say beside `others` what candidate g says: steps of its targets and
        those of another step, or without these."""
        own = self.steps.get(g)
        if own is None:
            return np.zeros(0, dtype=np.intp)
        names: set[int] = set()
        for other in others:
            if other == g or other not in self.steps:
                continue
            beside = self.steps[other]
            for k, step in self.steps.items():
                more = beside.targets < step.targets and not beside.targets & own.targets
                if more and self._are_at_once(beside, step):
                    names.add(k)
                is_rest = step.targets == own.targets - beside.targets
                less = is_rest and beside.targets < own.targets
                if less and self._are_at_once(beside, own):
                    names.add(k)
        return np.array(sorted(names - {g}), dtype=np.intp)

    def tell_apart(self, members: Sequence[int]) -> tuple[int, ...]:
        """Tell the steps among some candidates each by the targets that no other one moves at once, where
        there is a candidate for that."""
        told = list(members)
        for place, g in enumerate(members):
            own = self.steps.get(g)
            if own is None:
                continue
            beside = [self.steps[k] for k in members if k != g and k in self.steps]
            parts = [one for one in beside if one.targets < own.targets]
            nested = [one.targets for one in parts if self._are_at_once(one, own)]
            rest = own.targets.difference(*nested)
            if nested and rest:
                told[place] = self._find_nearest(rest, own.at, g)
        return tuple(sorted(told))

    def _find_nearest(self, targets: Targets, at: float, default: int) -> int:
        """Find the step of some targets that is nearest to a moment."""
        distances = {}
        for k, step in self.steps.items():
            if step.targets == targets:
                distance = step.at - at
                distances[k] = abs(distance)
        return min(distances, key=distances.__getitem__, default=default)

    def _are_at_once(self, few: _Step, many: _Step) -> bool:
        """Return whether fewer rows of the few targets than a step needs are between two steps."""
        data = self.problem.data
        low, high = sorted((few.at, many.at))
        progress = data.progress
        targets = list(few.targets)
        is_own = np.isin(data.target, targets)
        is_later = low < progress
        is_earlier = progress < high
        between = is_own & is_later & is_earlier
        # a target's step has three numbers
        needed = 3 * COORDINATES_OF_STEP
        rows = int(between.sum())
        coordinates = rows * self.problem.components
        return coordinates < needed
