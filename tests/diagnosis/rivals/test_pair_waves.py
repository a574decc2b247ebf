"""Waves of two joints' readings together are found where a joint would else be said not to repeat, and
stand against findings that depend on two readings."""

from __future__ import annotations

import numpy as np
import pytest
from builders import drawn, measured, seeds
from searches import search_separated

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.rivals.finding_groups import list_finding_groups
from modelsel.diagnosis.rivals.pair_waves import COUNTS, generate_pair_waves, list_pair_waves
from modelsel.diagnosis.rivals.unlisted_shapes import list_rivals
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.diagnosis.shapes.unregistered import build_cell
from modelsel.fitting.design import Model
from modelsel.mechanisms.causes import Named, cos, q, sin
from modelsel.mechanisms.registry import every, mechanism
from modelsel.mechanisms.terms import Mechanism
from modelsel.robot.kinematics import forward

SIGMA = 0.03


@seeds(1)
def test_waves_of_two_readings_are_offered_at_a_joint(rng: np.random.Generator) -> None:
    at = drawn("puma760", rng, 30)
    waves = list(generate_pair_waves(at, 3))
    assert len(set(waves)) == 15 * len(COUNTS)
    base = Model((mechanism("geometric", at.robot),))
    found = build_candidates(at, base, every(at.robot))
    # none that the map has, and together rarer than a cell
    terms = {frozenset(term.key for term in one.mechanism.terms) for one in found}
    assert not terms & {frozenset(term.key for term in wave.terms) for wave in waves}
    listed = list_pair_waves(at, found, 3)
    cell = max(one.prior for one in found if one.kind is CandidateKind.CELL)
    assert sum(one.prior for one in listed) == pytest.approx(15 * 0.1 * cell)
    assert list_pair_waves(at, [], 3) == []
    q2, q3 = at.data.q[:, 1], at.data.q[:, 2]
    (own,) = [one for one in waves if str(one.terms[0].screws[0].cause) == "sin(2*q2-3*q3)"]
    sine, cosine = (term.screws[0].cause.of(at.state) for term in own.terms)
    assert sine == pytest.approx(np.sin(2 * q2 - 3 * q3))
    assert cosine == pytest.approx(np.cos(2 * q2 - 3 * q3))


def keep_waves(shapes: list[Candidate]) -> set[Mechanism]:
    return {one.mechanism for one in shapes if one.kind is CandidateKind.WAVE}


@seeds(1)
def test_waves_of_its_two_readings_stand_against_a_finding(rng: np.random.Generator) -> None:
    at = drawn("puma760", rng, 30)
    difference = q(2) - q(3)
    own = Candidate(
        build_cell((3, "rz"), (sin(difference), cos(difference))), CandidateKind.WAVE, 0.01
    )
    waves = {wave for wave in generate_pair_waves(at, 3) if wave.names() == {"q2", "q3"}}
    assert len(waves) == len(COUNTS)
    alike = [one.candidate for one in list_rivals(at, own) if one.agrees == "drivers"]
    assert keep_waves(alike) == waves
    # two findings of one reading each, too
    second = Candidate(build_cell((3, "rz"), (q(2),)), CandidateKind.CELL, 0.01)
    third = Candidate(build_cell((3, "rz"), (q(3) * q(3),)), CandidateKind.CELL, 0.01)
    (together,) = list_finding_groups(at, {5: second, 7: third})
    assert keep_waves(list(together.shapes)) == waves
    # neither elsewhere nor of anything else
    for place, cause in (((3, "tx"), difference), ((3, "rz"), q(2) * Named("approach3"))):
        other = Candidate(build_cell(place, (cause,)), CandidateKind.CELL, 0.01)
        assert not keep_waves([one.candidate for one in list_rivals(at, other)])


@pytest.mark.slow
@seeds(2, 3)
def test_a_joint_that_turns_with_two_readings_is_no_joint_that_does_not_repeat(
    rng: np.random.Generator,
) -> None:
    at = drawn("puma760", rng, 100)
    m, n = COUNTS[int(rng.integers(len(COUNTS)))]
    q = at.data.q.copy()
    q[:, 2] += 5e-4 * np.sin(m * q[:, 1] + n * q[:, 2] + rng.uniform(0, 2 * np.pi))
    shift = forward(at.robot, q, at.tools[0]) - forward(at.robot, at.data.q, at.tools[0])
    bent = measured(at, at.data.position + shift + rng.normal(0, SIGMA, shift.shape))
    base = Model((mechanism("geometric", at.robot),))
    found = search_separated(bent, base, build_candidates(bent, base, every(at.robot)))
    (effect,) = found.effects
    told = effect.candidate.mechanism
    assert told.names_by_place() == {(3, "rz"): {"q2", "q3"}}, found.path
    assert not [name for name in found.errors.names if name.startswith("joint")]
