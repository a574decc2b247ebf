"""Traits: what the candidates of a search are by themselves, whatever a model has of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..._typing import Index
from ...fitting.problem import Problem
from ...mechanisms.terms import Mechanism
from ..candidates.candidate import Candidate
from ..candidates.candidate_list import find_cell_prior
from ..candidates.close_steps import CloseSteps, find_close_steps
from ..candidates.nested_names import NestedNames
from ..candidates.signatures import number_forms, read_signatures
from .acting_screws import keep_acting_screws
from .mechanism_families import Family, find_families
from .views import View


@dataclass(frozen=True, eq=False)
class Traits:
    """What the candidates (G,) of a search are, each worked out once somebody asks; `first`: the view
    of the base."""

    problem: Problem
    candidates: tuple[Candidate, ...]
    first: View

    @cached_property
    def numbers(self) -> dict[Mechanism, int]:
        """The candidates' numbers by their mechanisms."""
        return {one.mechanism: g for g, one in enumerate(self.candidates)}

    @cached_property
    def families(self) -> list[Family]:
        """The mechanisms of several joints, with those of their parts."""
        return find_families(self.candidates)

    @cached_property
    def cell_prior(self) -> float:
        """The prior probability of a cell of the error map, 0 where there are none."""
        return find_cell_prior(self.candidates)

    @cached_property
    def bumped(self) -> Index:
        """The joint (G,) that every candidate lets err around one reading, 0 for none."""
        return np.array([one.bumped_joint for one in self.candidates], dtype=np.intp)

    @cached_property
    def single(self) -> Index:
        """Equal numbers (G,) above nought, of which a model has one: bumps of one joint, and forms in
        which one link or drive yields to one load."""
        forms = self.forms
        has_form = forms >= 0
        after_joints = 1 + self.problem.robot.n
        numbers = after_joints + forms
        return np.where(has_form, numbers, self.bumped)

    @cached_property
    def close_steps(self) -> CloseSteps:
        """The candidates that are steps of the set-up, by where they are in the campaign."""
        return find_close_steps(self.problem, self.candidates)

    @cached_property
    def nested_names(self) -> NestedNames:
        """The candidates that say together what others say."""
        problem = self.problem
        candidates = self.candidates
        return NestedNames(problem, candidates)

    @cached_property
    def acting_parts(self) -> tuple[Candidate, ...]:
        """The candidates without the screws that hardly move the target."""
        first = self.first
        return keep_acting_screws(self.problem, self.candidates, first.fitted.at(), first.Q)

    @cached_property
    def signatures(self) -> tuple[Index, ...]:
        """What every candidate says of the arm, level by level."""
        return read_signatures(self.acting_parts)

    @cached_property
    def forms(self) -> Index:
        """The numbers (G,) of links that bend, by all forms alike; -1 of anything else."""
        return number_forms(self.candidates)
