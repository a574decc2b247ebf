"""Steps of the whole set-up that are close to one another: what they enclose is too little for the
numbers of a step, and two that cancel would explain a few rows that are far off."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..._typing import Array, Index
from ...fitting.problem import Problem
from ...mechanisms.step_moments import list_step_moments
from .candidate import Candidate
from .scanned_constants import COORDINATES_OF_STEP
from .session_steps import SET_UP_STEPS


class CloseSteps(NamedTuple):
    """Candidates (G,) that are steps of the set-up: `before`, how many coordinates each has before it,
    nan for all other candidates; `needed`, how many its numbers take."""

    before: Array
    needed: Array

    def list_beside(self, known: Sequence[int]) -> Index:
        """List the steps that have too few coordinates between them and one of some known candidates."""
        places = np.asarray(known, dtype=np.intp)
        own = self.before[places]
        apart = np.subtract.outer(self.before, own)
        between = np.abs(apart)
        needed = self.needed[:, None]
        is_close = between < needed
        is_beside = is_close.any(axis=1)
        return np.flatnonzero(is_beside)


def find_close_steps(problem: Problem, candidates: Sequence[Candidate]) -> CloseSteps:
    """Find the candidates that are steps of the set-up, and where in the campaign they are."""
    count = len(candidates)
    course = np.sort(problem.data.progress)
    before = np.full(count, np.nan)
    needed = np.zeros(count)
    for g, one in enumerate(candidates):
        mechanism = one.mechanism
        name = mechanism.name
        if name not in SET_UP_STEPS:
            continue
        terms = mechanism.terms
        (moment,) = list_step_moments(terms)
        rows = np.searchsorted(course, moment)
        before[g] = rows * problem.components
        numbers = len(terms)
        needed[g] = COORDINATES_OF_STEP * numbers
    return CloseSteps(before, needed)
