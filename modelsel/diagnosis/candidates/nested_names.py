"""Candidates of which two say together what two others say: the same model, in other names."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from ..._typing import Index
from ...fitting.problem import Problem
from .candidate import Candidate
from .nested_loads import find_nested_loads
from .nested_steps import NestedSteps


class NestedNames:
    """The steps of targets and the springs of joints among some candidates, by their numbers."""

    def __init__(self, problem: Problem, candidates: Sequence[Candidate]):
        self.steps = NestedSteps(problem, candidates)
        self.loads = find_nested_loads(candidates)

    def list_other_names(self, g: int, others: Collection[int]) -> Index:
        """List the candidates that say beside `others` what candidate g says."""
        steps = self.steps.list_other_names(g, others)
        loads = self.loads.list_other_names(g, others)
        return np.concatenate([steps, loads])

    def tell_apart(self, members: Sequence[int]) -> tuple[int, ...]:
        """Tell what two candidates of a set say together each by its own."""
        apart = self.steps.tell_apart(members)
        return self.loads.tell_apart(apart)
