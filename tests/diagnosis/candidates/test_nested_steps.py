"""Steps of some targets and of a part of these are one model in several names."""

from __future__ import annotations

import numpy as np
import pytest
from slipped_targets import Rng, bind_targets

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.nested_steps import NestedSteps
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.problem import Problem
from modelsel.mechanisms.environment import target_step
from modelsel.mechanisms.moved_targets import limit_to_targets
from modelsel.robot.files import load_robot

pytestmark = pytest.mark.unit

ROBOT = load_robot("irb120")
NAMES = {0: "A", 1: "B", 2: "C"}


def build(targets: tuple[int, ...], at: float) -> Candidate:
    step = target_step(ROBOT, at)
    if len(targets) < 3:
        step = limit_to_targets(step, {target: NAMES[target] for target in targets})
    return Candidate(step, CandidateKind.MECHANISM, 0.1)


def bind(rng: Rng) -> Problem:
    """Forty configurations of three targets, with three rows in a fortieth of the campaign."""
    return bind_targets(ROBOT, ROBOT.draw(rng, 40), np.zeros((40, 3, 3)))


ALL, ALL_LATER, A, B, C, AC, BC = range(7)
STEPS = (
    build((0, 1, 2), 0.5),
    build((0, 1, 2), 0.8),
    build((0,), 0.5),
    build((1,), 0.5),
    build((2,), 0.5),
    build((0, 2), 0.5),
    build((1, 2), 0.5),
)


def test_other_names_move_what_another_step_moves_at_once(rng: Rng) -> None:
    steps = NestedSteps(bind(rng), STEPS)
    # beside a step of B, one of A and C is one of all; that of all later is another one
    assert steps.list_other_names(AC, [B, AC]).tolist() == [ALL, BC]
    assert steps.list_other_names(ALL, [B, ALL]).tolist() == [AC]
    assert steps.list_other_names(ALL, [AC, ALL]).tolist() == [B]
    assert steps.list_other_names(ALL_LATER, [B, ALL_LATER]).tolist() == []
    assert steps.list_other_names(A, [A]).tolist() == []


def test_sets_are_told_by_the_targets_that_no_other_step_moves(rng: Rng) -> None:
    steps = NestedSteps(bind(rng), STEPS)
    assert steps.tell_apart([ALL, B]) == (B, AC)
    assert steps.tell_apart([ALL, B, C]) == (A, B, C)
    assert steps.tell_apart([ALL_LATER, B]) == (ALL_LATER, B)
    assert steps.tell_apart([A, B]) == (A, B)
    # without a step of A and C
    fewer = NestedSteps(bind(rng), STEPS[:AC])
    assert fewer.tell_apart([ALL, B]) == (ALL, B)


def test_one_target_has_no_nested_steps(rng: Rng) -> None:
    one = bind_targets(ROBOT, ROBOT.draw(rng, 20), np.zeros((20, 1, 3)))
    assert not NestedSteps(one, STEPS[:1]).steps
