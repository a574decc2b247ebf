"""Targets that slip alike are told together; no target is told that stands where it stood."""

from __future__ import annotations

import re

import numpy as np
import pytest
from builders import seeds
from hidden_arm import arm
from slipped_targets import (
    NAMES,
    TOOLS,
    Rng,
    bind_targets,
    draw_campaign,
    draw_slip,
    explain,
    measure,
    slip_each,
)

from modelsel.diagnosis.candidates.scanned_constants import has_both_sides
from modelsel.diagnosis.candidates.session_steps import build_common_steps
from modelsel.diagnosis.findings.claim_sentences import describe_proven
from modelsel.diagnosis.findings.sentences import label_effect
from modelsel.diagnosis.findings.step_sides import find_open_sides
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.environment import target_step
from modelsel.mechanisms.moved_targets import limit_to_targets
from modelsel.mechanisms.step_moments import list_step_moments
from modelsel.robot.files import load_robot


@pytest.mark.slow
@pytest.mark.parametrize("count", [3, 4])
@seeds(1, 2, 3)
def test_all_but_one_that_slip_alike_are_told_together(count: int, rng: Rng) -> None:
    """They were told as a slip of all, and one of the last, which in truth stood still."""
    still = int(rng.integers(count))
    moved = [target for target in range(count) if target != still]
    at, row, slip = draw_campaign(rng, moved, count)
    (effect,) = explain(at)
    names = [NAMES[target] for target in moved]
    assert label_effect(effect) == f"target-step:{' & '.join(names)}"
    told = describe_proven(effect)
    assert "stand elsewhere on the flange, shifted alike, from about row " in told
    begins = re.search(r"from about row (\d+) on", told)
    assert abs(int(begins[1]) - count * row) <= 3 * count
    assert np.abs(effect.estimate - slip).max() < 5 * effect.standard_error.max()


@pytest.mark.slow
@seeds(1, 2)
def test_two_of_five_that_slip_alike_are_told_together(rng: Rng) -> None:
    at, _, _ = draw_campaign(rng, [1, 3], 5)
    assert {label_effect(effect) for effect in explain(at)} == {"target-step:B & D"}


@pytest.mark.slow
@seeds(1, 2, 3)
def test_two_that_slip_otherwise_at_one_moment_are_told_each(rng: Rng) -> None:
    effects = explain(slip_each(rng, {0: 40, 2: 40}))
    assert {label_effect(effect) for effect in effects} == {"target-step:A", "target-step:C"}


def slip_otherwise(rng: Rng, at_once: bool) -> tuple[Problem, np.ndarray, np.ndarray]:
    """Three targets of which the first and the third slip alike, and the second otherwise with them; or
    all alike, and the second once more. The slip of all but the second, and that of the second."""
    robot = load_robot("irb120")
    body = arm(robot, rng)
    q = body.draw(rng, 80, 2.6)
    alike, other = draw_slip(rng), draw_slip(rng)
    shifts = np.zeros((80, 3, 3))
    shifts[40:] = alike
    shifts[40 if at_once else 60 :, 1] = other
    return bind_targets(robot, q, measure(body, q, TOOLS[:3], shifts, rng)), alike, other


@pytest.mark.slow
@seeds(1, 2, 3)
def test_targets_that_slip_at_once_but_not_alike_are_told_each_by_its_move(rng: Rng) -> None:
    """All were told to stand elsewhere by what two of them moved, and the third by the difference."""
    at, alike, other = slip_otherwise(rng, at_once=True)
    effects = {label_effect(effect): effect for effect in explain(at)}
    assert effects.keys() == {"target-step:A & C", "target-step:B"}
    for name, slip in (("A & C", alike), ("B", other)):
        effect = effects[f"target-step:{name}"]
        assert np.abs(effect.estimate - slip).max() < 5 * effect.standard_error.max()
        assert effect.claim.probability > 0.9
        assert effect.named.entries[0].candidate.label == f"target-step:{name}"


@pytest.mark.slow
@seeds(1, 2)
def test_one_that_slips_once_more_is_told_beside_all(rng: Rng) -> None:
    at, _, _ = slip_otherwise(rng, at_once=False)
    assert {label_effect(effect) for effect in explain(at)} == {"target-step", "target-step:B"}


@pytest.mark.unit
def test_a_common_step_needs_rows_of_every_target_on_both_sides(rng: Rng) -> None:
    robot = load_robot("irb120")
    q = robot.draw(rng, 60)
    keep = np.ones((60, 3), bool)
    keep[:30, 2] = False
    at = bind_targets(robot, q, np.zeros((60, 3, 3)), keep)
    step = target_step(robot, 0.3)
    assert has_both_sides(at, limit_to_targets(step, {0: "A", 1: "B"}))
    assert not has_both_sides(at, limit_to_targets(step, {0: "A", 2: "C"}))


@pytest.mark.unit
def test_common_steps_are_told_by_the_first_row_of_their_targets(rng: Rng) -> None:
    """Of three targets in turn, the second has rows 1, 4, 7, …, the third 2, 5, 8, …"""
    robot = load_robot("irb120")
    q = robot.draw(rng, 40)
    at = bind_targets(robot, q, np.zeros((40, 3, 3)))
    data = at.data
    # between rows 59 and 60, of which the latter is of the first target
    moment = float(data.progress[59:61].mean())
    (step,) = build_common_steps(at, {1, 2}, {moment})
    assert step.sentence == (
        "Targets B and C stand elsewhere on the flange, shifted alike, from about row 61 on."
    )
    # the same rows of these two are on either side
    equal = {moment, float(data.progress[60:62].mean())}
    assert len(build_common_steps(at, {1, 2}, equal)) == 1
    assert len(build_common_steps(at, {0, 1}, equal)) == 2


@pytest.mark.unit
def test_a_common_step_between_two_groups_is_told_by_them(rng: Rng) -> None:
    robot = load_robot("irb120")
    q = robot.draw(rng, 120)
    target = np.tile(NAMES[:3], 40)
    group = np.repeat(["first", "second"], 60)
    data = build_measurements(q, np.zeros((120, 3)), target=target, group=group)
    at = bind_targets(robot, q[::3], np.zeros((40, 3, 3)))
    at = type(at)(robot, data, at.tools)
    moment = float(data.progress[59:61].mean())
    (step,) = build_common_steps(at, {0, 2}, {moment})
    assert list_step_moments(step.terms) == {moment}
    assert step.sentence.endswith(
        'shifted alike, from about the beginning of the group "second" on.'
    )


@pytest.mark.unit
def test_sides_of_a_common_step_are_open_for_its_own_targets_alone(rng: Rng) -> None:
    robot = load_robot("irb120")
    q = robot.draw(rng, 40)
    at = bind_targets(robot, q, np.zeros((40, 3, 3)))
    used = np.ones(len(at), bool)
    used[57:63] = False
    moment = float(at.data.progress[59:61].mean())
    step = limit_to_targets(target_step(robot, moment), {0: "A", 2: "C"})
    (side,) = find_open_sides(at, used, [step], ())
    assert np.flatnonzero(side.rows).tolist() == [57, 59, 60, 62]
