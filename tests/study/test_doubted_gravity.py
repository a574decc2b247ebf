"""What depends on gravity holds only for the direction that is stated, where the data question it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.findings.effects import Effect
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.mechanisms.causes import Cause, q, sin, torque
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.notices import Note
from modelsel.results.conclusions.cautions import explain_doubted_gravity
from modelsel.results.runs.finding_records import Finding
from modelsel.robot.files import load_robot
from modelsel.selection.gain import Gain
from modelsel.study.preparation.gravity_direction import doubt_gravity

UPRIGHT = replace(load_robot("ur5"), gravity=(0.0, 0.0, -1.0))
CONDITION = "This holds only if gravity is [0, 0, -1] in the robot's base frame, which the warnings question."


def _find(cause: Cause) -> Finding:
    mechanism = Mechanism("x", (Term("k", (Screw(2, "rz", cause),)),), "Joint 2 errs.")
    candidate = Candidate(mechanism, CandidateKind.MECHANISM, 1.0)
    named = SimpleNamespace(entries=(), verdict="found", sum_by_label=lambda: {"x": 1.0})
    effect = Effect(candidate, named, 0.01, np.array([1e-4]), np.array([1e-5]))  # type: ignore[arg-type]
    return Finding(effect, Gain(None, None, None))


@pytest.mark.parametrize("code", ["gravity-elsewhere", "gravity-upwards"])
def test_what_depends_on_gravity_says_for_which_direction(code: str) -> None:
    found = [_find(torque(2)), _find(sin(q(2)))]
    wound, wave = doubt_gravity(found, [Note(code, "Gravity may be otherwise.")], UPRIGHT)
    assert wound.sentence.endswith(CONDITION)
    assert CONDITION not in wave.sentence
    told = CONDITION.replace("This holds", "What depends on gravity holds")
    assert explain_doubted_gravity([wave, wound]) == f" {told}"
    assert explain_doubted_gravity([wave]) == ""


def test_nothing_is_said_of_gravity_that_nothing_questions() -> None:
    found = (_find(torque(2)),)
    assert doubt_gravity(found, [Note("missed-rows", "Two rows.")], UPRIGHT) == found
