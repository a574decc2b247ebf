"""An effect that one posture alone tells is not claimed: an error of that posture looks the same."""

from __future__ import annotations

import numpy as np
import pytest
from builders import bind, load_once, planted
from searches import search_independent

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.signatures import PROVEN
from modelsel.diagnosis.findings.effects import Claim
from modelsel.diagnosis.findings.outcome import Diagnosis
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import mechanism
from modelsel.results.conclusions.finding_notes import lone_posture_notes
from modelsel.robot.kinematics import forward

pytestmark = pytest.mark.unit
ROBOT = load_once("irb120")
BASE = Model((mechanism("geometric", ROBOT),))
NAMES = ("backlash:3", "backlash:2", "joint-compliance:2")
FOUND = tuple(Candidate(mechanism(name, ROBOT), CandidateKind.MECHANISM, 1 / 3) for name in NAMES)
TOOL, SIGMA = (40.0, -25.0, 100.0), 0.02
FOREARM = 0.2278  # rad by which the moment of weight beyond joint 3 stands ahead of the forearm


def search(beyond: int, rng: np.random.Generator) -> tuple[Problem, Diagnosis]:
    """Search 60 postures, some of them with the forearm beyond the upright, with play in joint 3."""
    q = ROBOT.draw(rng, 4000)
    side = np.cos(q[:, 1] + q[:, 2] - FOREARM)
    q = np.concatenate([q[side < -0.4][:beyond], q[side > 0.4][: 60 - beyond]])
    exact = bind(ROBOT, build_measurements(q, forward(ROBOT, q, np.array(TOOL))), TOOL)
    problem = planted(exact, mechanism("backlash:3", ROBOT).terms, np.array([2e-3]), rng, SIGMA)
    return problem, search_independent(problem, BASE, FOUND, rng)


def claim_of(diagnosis: Diagnosis) -> Claim:
    """Take the claim of the one effect that was found."""
    (effect,) = diagnosis.effects
    assert effect.label == "backlash:3"
    assert effect.claim is not None
    return effect.claim


def test_a_step_that_one_posture_alone_is_beyond_is_not_claimed(rng: np.random.Generator) -> None:
    """Of an ABB IRB 120 with 1 of 104 postures beyond the upright, backlash:3 was claimed with 0.97."""
    problem, diagnosis = search(1, rng)
    claim = claim_of(diagnosis)
    assert claim.lone_posture == problem.data.block[0]
    assert max(claim.levels) < PROVEN
    (note,) = lone_posture_notes(problem, diagnosis)
    assert note.code == "lone-posture"
    assert note.sentence.startswith("backlash:3 is told by one posture alone (row 0")


def test_a_step_that_several_postures_are_beyond_is_claimed(rng: np.random.Generator) -> None:
    problem, diagnosis = search(6, rng)
    claim = claim_of(diagnosis)
    assert claim.lone_posture is None
    assert claim.level == "cause"
    assert lone_posture_notes(problem, diagnosis) == ()
