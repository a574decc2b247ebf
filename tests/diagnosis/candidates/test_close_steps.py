"""Two steps of the set-up need enough rows between them: those that enclose a bad shot are no bumps."""

from __future__ import annotations

import numpy as np
from builders import drawn
from searches import ignore

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.options import DEFAULT_OPTIONS
from modelsel.diagnosis.columns.kept_causes import KeptCauses
from modelsel.diagnosis.separation import Inquiry
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.mechanisms.environment import tracker_bumped, tracker_step, zero_step
from modelsel.mechanisms.registry import mechanism

ROWS = 60


def test_a_step_beside_another_encloses_enough_rows(rng: np.random.Generator) -> None:
    """A step of six numbers takes twelve coordinates, four rows."""
    problem = drawn("puma760", rng, ROWS)
    course = np.sort(problem.data.progress)
    first = int(rng.integers(10, 40))
    moments = [(course[row - 1] + course[row]) / 2 for row in range(first, first + 7)]
    robot = problem.robot
    steps = [tracker_bumped(robot, moments[0]), *(tracker_step(robot, at) for at in moments[1:])]
    others = [zero_step(robot, 2, moments[1]), mechanism("encoder-scale:3", robot)]
    listed = (*steps, *others)
    candidates = tuple(Candidate(one, CandidateKind.MECHANISM, 0.01) for one in listed)
    base = Model((mechanism("geometric", robot),))
    inquiry = Inquiry(base, (), 1, True, ignore, DEFAULT_OPTIONS)
    search = inquiry.search(problem, candidates, (), KeptCauses(), fit(problem, base))
    number = search.traits.numbers
    known = number[steps[0]]
    aside = set(search.list_set_aside([known]).tolist()) - set(search.dead.tolist())
    assert aside == {number[step] for step in steps[:4]}
    # what is no step of the set-up rules none out, nor does a set of nothing
    assert not set(search.list_set_aside([number[others[0]]]).tolist()) & {known, number[steps[1]]}
    assert not len(search.traits.close_steps.list_beside([]))
