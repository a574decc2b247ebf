"""One reflector of several that slips is told by its name; campaigns by exact chains of the tests' own."""

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
    offer,
    slip_each,
)

from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.session_steps import place_steps
from modelsel.diagnosis.findings.claim_sentences import describe_proven
from modelsel.diagnosis.findings.sentences import label_effect
from modelsel.diagnosis.procedure import diagnose
from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.mechanisms.registry import every, mechanism
from modelsel.mechanisms.step_moments import list_step_moments
from modelsel.robot.files import load_robot


@pytest.mark.slow
@seeds(1, 2, 3)
def test_one_target_that_slips_is_told_by_its_name(rng: Rng) -> None:
    """It was told as a step of a joint's zero and one of all targets."""
    slipped = int(rng.integers(3))
    at, row, slip = draw_campaign(rng, [slipped])
    (effect,) = diagnose(at).effects
    name = NAMES[slipped]
    assert label_effect(effect) == f"target-step:{name}"
    told = describe_proven(effect)
    found = re.search(r"Target (\w) stands elsewhere on the flange from about row (\d+) on", told)
    assert found
    assert found[1] == name
    assert abs(int(found[2]) - (3 * row + slipped)) <= 9
    assert np.abs(effect.estimate - slip).max() < 5 * effect.standard_error.max()


@pytest.mark.slow
@seeds(1, 2)
def test_targets_that_slip_together_are_told_together(rng: Rng) -> None:
    at, _, _ = draw_campaign(rng, [0, 1, 2])
    (effect,) = diagnose(at).effects
    assert label_effect(effect) == "target-step"
    assert describe_proven(effect).startswith(
        "All targets stand elsewhere on the flange from about row "
    )


@pytest.mark.slow
@seeds(*range(1, 9))
def test_targets_that_stay_are_not_told(rng: Rng) -> None:
    """Of 44 such campaigns of two to five targets none had a finding."""
    at, _, _ = draw_campaign(rng, [], count=int(rng.integers(2, 6)))
    named = [label_effect(effect) for effect in explain(at)]
    assert not [label for label in named if label.startswith("target-step")]


@pytest.mark.slow
@seeds(1, 2)
def test_one_of_five_targets_is_told(rng: Rng) -> None:
    slipped = int(rng.integers(5))
    at, _, _ = draw_campaign(rng, [slipped], count=5)
    first, *others = map(label_effect, explain(at))
    assert first == f"target-step:{NAMES[slipped]}"
    # of twenty campaigns one has a further effect by chance
    assert not [label for label in others if label.startswith(("target-step", "zero-step"))]


@pytest.mark.slow
@pytest.mark.parametrize("side", ["before", "after"])
def test_a_target_that_is_measured_on_one_side_alone_is_not_told(side: str, rng: Rng) -> None:
    """Where it sits on the flange is all that its rows tell."""
    robot = load_robot("irb120")
    body = arm(robot, rng)
    q = body.draw(rng, 80, 2.6)
    is_after = np.arange(80) >= 40
    shifts = np.zeros((80, 3, 3))
    shifts[is_after, 1] = draw_slip(rng)
    keep = np.ones((80, 3), bool)
    keep[:, 1] = is_after == (side == "after")
    at = bind_targets(robot, q, measure(body, q, TOOLS[:3], shifts, rng), keep)
    assert not explain(at)


@pytest.mark.slow
@seeds(1, 2)
def test_a_target_that_is_put_back_is_told_twice(rng: Rng) -> None:
    robot = load_robot("ur5e")
    body = arm(robot, rng)
    q = body.draw(rng, 80, 2.6)
    shifts = np.zeros((80, 3, 3))
    slip = draw_slip(rng)
    shifts[25:50, 1] = slip
    first, second = explain(bind_targets(robot, q, measure(body, q, TOOLS[:3], shifts, rng)))
    assert {label_effect(first), label_effect(second)} == {"target-step:B (1)", "target-step:B (2)"}
    for effect in (first, second):
        row = int(re.search(r"from about row (\d+) on", describe_proven(effect))[1])
        sense = 1 if abs(row - 75) < 12 else -1
        assert sense == 1 or abs(row - 150) < 12
        assert np.abs(effect.estimate - sense * slip).max() < 5 * effect.standard_error.max()


@pytest.mark.slow
@seeds(1, 2)
def test_two_targets_that_slip_at_different_moments_are_both_told(rng: Rng) -> None:
    effects = explain(slip_each(rng, {1: 24, 2: 52}))
    assert {label_effect(effect) for effect in effects} == {"target-step:B", "target-step:C"}


@pytest.mark.slow
@seeds(1, 2)
def test_a_zero_that_steps_too_is_told_beside_the_target(rng: Rng) -> None:
    robot = load_robot("ur5e")
    body = arm(robot, rng)
    q = body.draw(rng, 80, 2.6)
    shifts = np.zeros((80, 3, 3))
    shifts[24:, 1] = draw_slip(rng)
    zeros = 6e-4 * (np.arange(80) >= 52)
    position = measure(body, q, TOOLS[:3], shifts, rng, zeros)
    effects = explain(bind_targets(robot, q, position))
    assert {label_effect(effect) for effect in effects} == {"target-step:B", "zero-step:3"}


@pytest.mark.slow
@seeds(1, 2, 3)
def test_a_slip_in_rows_without_their_order_names_no_target(rng: Rng) -> None:
    robot = load_robot("irb120")
    body = arm(robot, rng)
    q = body.draw(rng, 80, 2.6)
    shifts = np.zeros((80, 3, 3))
    shifts[rng.permutation(80)[:40], 1] = draw_slip(rng)
    effects = explain(bind_targets(robot, q, measure(body, q, TOOLS[:3], shifts, rng)))
    assert not [e for e in effects if label_effect(e).startswith(("target-step", "zero-step"))]


@pytest.mark.unit
def test_a_step_needs_rows_of_its_target_on_both_sides(rng: Rng) -> None:
    """The campaign has rows on both sides, its target has none before its first."""
    robot = load_robot("irb120")
    q = robot.draw(rng, 60)
    keep = np.ones((60, 2), bool)
    keep[:30, 1] = False
    at = bind_targets(robot, q, np.zeros((60, 2, 3)), keep)
    base = Model((mechanism("geometric", robot),))
    found = build_candidates(at, base, offer(at), cells=False)
    own = [c for c in found if c.label == "target-step:B"]
    assert own
    is_own = at.data.target == 1
    for candidate in own:
        values = np.asarray(candidate.mechanism.terms[0].screws[0].cause.of(at.state))
        assert 2 <= values[is_own].sum() <= is_own.sum() - 2
        assert not values[~is_own].any()


def list_steps_of_targets(at: Problem, estimation: np.ndarray) -> set[str]:
    """The names of the steps of targets that are placed by some rows."""
    placed = place_steps(at, estimation, offer(at))
    return {m.name for m in placed if m.stem == "target-step"}


@pytest.mark.slow
def test_a_step_of_all_targets_is_one_of_those_that_were_fitted(rng: Rng) -> None:
    """With the third only held out, all of them were told to stand elsewhere."""
    at, _, _ = draw_campaign(rng, [])
    alone = {f"target-step:{name}" for name in "ABC"}
    third = at.data.target == 2
    assert list_steps_of_targets(at, ~third) == alone | {"target-step:A & B"}
    assert list_steps_of_targets(at, at.data.target == 0) == alone
    # measured in the first half alone
    early = ~third | (at.data.progress < 0.5)
    placed = place_steps(at, early, offer(at))
    both = [m for m in placed if m.name == "target-step:A & B"]
    every = [m for m in placed if m.name == "target-step"]
    moments = [min(list_step_moments(m.terms)) for m in both]
    assert 0.45 < min(moments) < 0.52
    others = [min(list_step_moments(m.terms)) for m in every]
    assert not [at for at in others if min(moments) <= at <= max(moments)]
    assert all(m.sentence.startswith("Targets A and B stand elsewhere") for m in both)
    assert " from about row " in both[0].sentence


@pytest.mark.unit
def test_one_target_has_the_candidates_that_it_had(rng: Rng) -> None:
    at, _, _ = draw_campaign(rng, [], count=1)
    placed = place_steps(at, np.ones(len(at), bool), offer(at))
    assert {m.name for m in placed} == {m.name for m in every(at.robot)}


@pytest.mark.slow
def test_targets_share_the_prior_of_one_name(rng: Rng) -> None:
    at, _, _ = draw_campaign(rng, [])
    placed = place_steps(at, np.ones(len(at), bool), offer(at))
    base = Model((mechanism("geometric", at.robot),))
    found = build_candidates(at, base, placed, cells=False)
    alone = [c.prior for c in found if c.label.startswith("target-step:")]
    together = [c.prior for c in found if c.label == "target-step"]
    assert sum(alone) == pytest.approx(sum(together))
    placed = place_steps(at, at.data.target < 2, offer(at))
    found = build_candidates(at.take(at.data.target < 2), base, placed, cells=False)
    alone = [c.prior for c in found if c.label in ("target-step:A", "target-step:B")]
    together = [c.prior for c in found if c.label == "target-step:A & B"]
    assert sum(alone) == pytest.approx(sum(together))
