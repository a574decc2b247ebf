"""Steps of the whole set-up that are close to one another: what they enclose is too little for the
numbers of a step, and two that cancel would explain a few rows that are far off."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .._typing import Array, Index
from ..fitting.problem import Problem
from ..mechanisms.step_moments import list_step_moments
from .candidates import Candidate
from .scanned_constants import COORDINATES_OF_STEP

# what moves the instrument against the arm for every target
SET_UP_STEPS = ("tracker-step", "fault:tracker-bumped")


class CloseSteps(NamedTuple):
    """Candidates (G,) that are steps of the set-up: `before`, how many coordinates each has before it,
    nan for all other candidates; `needed`, how many its numbers take."""

    before: Array
    needed: Array

    def list_beside(self, known: Sequence[int]) -> Index:
        """List the steps that have too few coordinates between them and one of some known candidates."""
        own = self.before[np.asarray(known, dtype=np.intp)]
        between = np.abs(self.before[:, None] - own)
        is_close = between < self.needed[:, None]
        return np.flatnonzero(is_close.any(axis=1))


def find_close_steps(problem: Problem, candidates: Sequence[Candidate]) -> CloseSteps:
    """Find the candidates that are steps of the set-up, and where in the campaign they are."""
    course = np.sort(problem.data.progress)
    before = np.full(len(candidates), np.nan)
    needed = np.zeros(len(candidates))
    for g, one in enumerate(candidates):
        mechanism = one.mechanism
        if mechanism.name not in SET_UP_STEPS:
            continue
        (moment,) = list_step_moments(mechanism.terms)
        rows = np.searchsorted(course, moment)
        before[g] = rows * problem.components
        needed[g] = COORDINATES_OF_STEP * len(mechanism.terms)
    return CloseSteps(before, needed)
