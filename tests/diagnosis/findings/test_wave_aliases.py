"""At readings on a grid of angles waves of several numbers a turn are the same: none is named."""

from __future__ import annotations

import numpy as np
import pytest
from builders import seeds
from hidden_arm import Effect as Planted
from hidden_arm import State, arm, measured
from hidden_effects import at, together

from modelsel._typing import Array
from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.findings.claim_sentences import describe_proven
from modelsel.diagnosis.findings.effect_sentences import describe_aliases
from modelsel.diagnosis.findings.wave_aliases import MOST_WAVES, list_aliases
from modelsel.diagnosis.procedure import diagnose
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.diagnosis.shapes.shape_constants import find_own_wave
from modelsel.diagnosis.shapes.unregistered import build_wave
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.drives import gear_ripple
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.files import load_robot

SIGMA = 0.05
ROBOT = load_robot("irb120")


def problem_at(q: Array) -> Problem:
    return Problem(ROBOT, build_measurements(q, np.zeros((len(q), 3))), np.zeros((1, 3)))


def ripple(waves: float) -> Candidate:
    return Candidate(gear_ripple(ROBOT, 4, waves), CandidateKind.MECHANISM, 0.01)


def round_to(q: Array, degrees: float) -> Array:
    step = np.radians(degrees)
    return np.asarray(step * np.round(q / step))


@seeds(1, 2)
def test_waves_are_alike_that_differ_by_whole_waves_between_neighbours(
    rng: np.random.Generator,
) -> None:
    q = ROBOT.draw(rng, 80)
    step = int(rng.choice([5, 8, 10, 12]))
    own = int(rng.integers(3, 15))
    between = 360 // step
    wholes = range(MOST_WAVES // between + 2)
    expected = {k * between + sign * own for k in wholes for sign in (-1, 1)} - {own}
    found = list_aliases(problem_at(round_to(q, step)), ripple(own))
    assert set(found) == {number for number in expected if 0 < number <= MOST_WAVES}
    # hardly off the grid they still are; drawn readings tell them apart
    near = round_to(q, step) + np.radians(0.01) * rng.standard_normal(q.shape)
    assert own + between in list_aliases(problem_at(near), ripple(own))
    assert list_aliases(problem_at(q), ripple(own)) == ()


def test_neighbours_that_a_short_range_does_not_tell_apart_are_one_wave(
    rng: np.random.Generator,
) -> None:
    q = np.radians(rng.uniform(-15, 15, (80, 6)))
    assert list_aliases(problem_at(q), ripple(20)) == ()
    assert list_aliases(problem_at(np.zeros((80, 6))), ripple(20)) == ()


def test_only_a_wave_of_a_joints_own_angle_has_others_like_it(rng: np.random.Generator) -> None:
    problem = problem_at(round_to(ROBOT.draw(rng, 80), 10))
    assert list_aliases(problem, Candidate(build_wave(4, 8), CandidateKind.JOINT_WAVE, 0.01))
    other = Candidate(mechanism("wrist-coupling:5", ROBOT), CandidateKind.MECHANISM, 0.01)
    assert list_aliases(problem, other) == ()


@pytest.mark.slow
@seeds(5)
@pytest.mark.parametrize("is_on_grid", [True, False])
def test_a_ripple_is_named_only_where_its_number_can_be_told(
    is_on_grid: bool, rng: np.random.Generator
) -> None:
    """Of one of 8 waves at postures every 10° it was said, with 0.95, that it has 44."""
    body = arm(ROBOT, rng, (40.0, -25.0, 100.0))
    q = body.draw(rng, 100)
    if is_on_grid:
        q = round_to(q, 10)
    waves, joint = int(rng.integers(5, 13)), int(rng.choice([3, 4]))
    state = State(body, q, {})
    exact = measured(body, state, ())
    term = together(at(joint, "rz", lambda s: np.sin(waves * s.q[:, joint - 1])))
    effect = Planted("planted", "", (term,), np.ones(1))
    size = np.linalg.norm(measured(body, state, (effect.scaled(1e-4),)) - exact, axis=1).max()
    planted = effect.scaled(1e-4 * SIGMA * rng.uniform(6, 9) / size)
    position = measured(body, state, (planted,)) + SIGMA * rng.standard_normal(exact.shape)
    problem = Problem(ROBOT, build_measurements(q, position), body.tool[None])
    (found,) = diagnose(problem, seed=1).effects
    assert found.claim is not None
    said = describe_proven(found)
    if is_on_grid:
        assert found.claim.level == "drivers"
        _, fitted = find_own_wave(found.candidate.mechanism)
        assert {fitted, *found.claim.waves} >= {waves, 36 - waves, 36 + waves}
        same = "waves a turn do the same at these readings as the fitted wave"
        assert f"{same} of {fitted:g} a turn;" in said
        assert "turns unevenly" not in said
    else:
        assert found.claim.level == "cause"
        assert f"{waves} waves a turn" in said
        assert "at these readings" not in said


def test_other_numbers_are_told_few_or_many() -> None:
    assert describe_aliases((8, 28), 44).startswith("8 and 28 waves a turn do the same")
    many = describe_aliases((8, 28, 64, 80), 44)
    assert many.startswith("8, 28, 64 and other numbers of waves a turn do the same")
    assert "as the fitted wave of 44 a turn; readings" in many
