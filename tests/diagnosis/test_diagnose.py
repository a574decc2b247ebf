"""`diagnose`, the diagnosis as a function: an effect is planted with a chain of the tests' own, and
found by its name."""

from __future__ import annotations

import numpy as np
import pytest
from builders import drawn, measured
from exact import flanges_of

from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.fault_kinds import FaultKind
from modelsel.diagnosis.faults.data_faults import find_concerned_rows
from modelsel.diagnosis.procedure import diagnose
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.exceptions import StudyError
from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.mechanisms.registry import build_faults, every, mechanism

COUPLING, NOISE_MM = 1.5e-3, 0.03
OFFERED = ("wrist-coupling", "encoder-scale", "backlash")


def coupled(rng: np.random.Generator, m: int = 90) -> Problem:
    """Joint 5 turns with joint 4: the positions of an exact chain at the readings that it has then,
    with noise."""
    at = drawn("puma760", rng, m)
    q = at.data.q.copy()
    q[:, 4] += COUPLING * q[:, 3]
    T = flanges_of(at.robot, q)
    position = T[:, :3, 3] + T[:, :3, :3] @ at.tools[0]
    return measured(at, position + NOISE_MM * rng.standard_normal(position.shape))


@pytest.mark.slow
def test_a_planted_effect_is_found_by_its_name(rng) -> None:
    diagnosis = diagnose(coupled(rng))
    effect, finding = diagnosis.effects[0], diagnosis.findings[0]
    assert effect.candidate.label == "wrist-coupling:5"
    assert abs(effect.estimate[0] - COUPLING) < 4 * effect.standard_error[0]
    assert all(e.p > 0.001 for e in diagnosis.effects[1:])  # at most what chance names now and then
    assert finding.startswith("Joint 5 turns with joint 4")
    assert "wrist-coupling:5, probability " in finding
    assert finding.endswith("; p ≤ 0.001.")


def test_a_diagnosis_reads_in_a_terminal(rng) -> None:
    at = coupled(rng)
    lines = repr(diagnose(at, candidates=OFFERED)).splitlines()
    assert lines[0] == "Diagnosis of geometric: 1 effect"
    assert lines[1].startswith("  1. Joint 5 turns with joint 4: ")
    assert lines[2].startswith("  The strongest of what is left has p ")
    nothing = diagnose(at, candidates=())
    assert repr(nothing) == "Diagnosis of geometric: no effects"
    assert nothing.findings == ()


@pytest.mark.integration
def test_only_the_candidates_asked_for_are_named(rng) -> None:
    at = coupled(rng)
    diagnosis = diagnose(at, candidates=["backlash", "encoder-scale:5"])
    assert {e.candidate.label for e in diagnosis.effects} <= {"encoder-scale:5", "backlash:3"}
    with pytest.raises(StudyError, match="wrist-cupling"):
        diagnose(at, candidates=["wrist-cupling"])
    with pytest.raises(StudyError, match="geometrik"):
        diagnose(at, base=["geometrik"])


@pytest.mark.integration
def test_a_mask_says_which_rows_estimate(rng) -> None:
    at = coupled(rng, 120)
    rows = np.arange(120) < 80
    masked = diagnose(at, candidates=OFFERED, estimation=rows)
    taken = diagnose(at.take(rows), candidates=OFFERED)
    assert masked.fit.rows == 3 * 80
    np.testing.assert_array_equal(masked.fit.theta, taken.fit.theta)
    assert masked.findings == taken.findings


@pytest.mark.integration
def test_every_candidate_has_its_kind(rng) -> None:
    at = coupled(rng)
    offered = (*build_faults(at.robot), *every(at.robot))
    found = build_candidates(at, Model((mechanism("geometric", at.robot),)), offered)
    labels = {kind: {c.label for c in found if c.kind is kind} for kind in CandidateKind}
    assert {"wrist-coupling:5", "fault:read-too-early"} <= labels[CandidateKind.MECHANISM]
    assert "frame 4 tz · q4" in labels[CandidateKind.CELL]
    assert "frame 4 tz · sin(q4) & cos(q4)" in labels[CandidateKind.WAVE]
    assert "frame 4 tz · waves of q3 times waves of q4" in labels[CandidateKind.WAVE_PRODUCT]
    assert "free(q4)" in labels[CandidateKind.FREE_FUNCTION]
    assert any(label.startswith("frame 4 rz") for label in labels[CandidateKind.JOINT_WAVE])
    assert not labels[CandidateKind.SLIDE_WAVE]
    kinds = {c.fault for c in found}
    faults = {FaultKind.TRACKER_BUMPED, FaultKind.READ_TOO_EARLY, FaultKind.TIME_OFFSET}
    assert kinds == {None, *faults}


def test_a_fault_knows_the_rows_that_it_concerns(rng) -> None:
    at = coupled(rng)
    early, *bumped = build_faults(at.robot)
    assert find_concerned_rows(early, at).tolist() == list(range(90))
    rows = [find_concerned_rows(one, at).tolist() for one in bumped]
    assert all(own == list(range(own[0], 90)) for own in rows if own)
    assert {len(own) for own in rows} > {45}
