"""Cells in words: what settles in time, what is in proportion to a torque or a column, which joint it is."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.findings.claim_sentences import describe_what
from modelsel.diagnosis.findings.effect_sentences import list_cautions
from modelsel.diagnosis.findings.effects import Claim, Effect
from modelsel.diagnosis.findings.name_legend import explain_names
from modelsel.diagnosis.findings.sentences import describe_amount, say_shape
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.mechanisms.causes import Applied, Bump, Cause, Named, sin, torque
from modelsel.mechanisms.environment import PROGRESS, temperature_rise
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.results.record import collect_named

TIME = Named("time_s", "s")
ALL_BUT_CAUSE = (1.0, 1.0, 1.0, 0.0)


def _settle(clock: Cause, constant: float) -> Cause:
    return Applied("exp", clock / -constant)


def _cell(frame: int, axis: str, *causes: Cause) -> Candidate:
    terms = tuple(Term(f"m{k}", (Screw(frame, axis, cause),)) for k, cause in enumerate(causes, 1))
    return Candidate(Mechanism(f"{frame}{axis}", terms), CandidateKind.CELL, 0.1)


def _find(candidate: Candidate, *values: float, joint: bool = False) -> Effect:
    found = SimpleNamespace(
        entries=(), verdict="found", more=0, sum_by_label=lambda: {candidate.label: 1.0}
    )
    estimate = np.array(values)
    claim = Claim("shape", ALL_BUT_CAUSE, moves_joints=joint)
    return Effect(candidate, found, 0.01, estimate, 0.05 * np.abs(estimate), claim=claim)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("cause", "words"),
    [
        (_settle(TIME - 231.0, 1344.72), "22.4 min"),
        (_settle(TIME, 95.5), "95.5 s"),
        (_settle(TIME - 41.0, 8244.5), "2.29 h"),
        (_settle(PROGRESS, 0.25), "25 % of the campaign"),
    ],
)
def test_what_settles_is_named_with_its_time_constant(cause: Cause, words: str) -> None:
    candidate = _cell(3, "ty", cause)
    settling = f"settling with a time constant of {words}"
    assert candidate.label == f"frame 3 ty · {settling}"
    (_, explained) = explain_names([candidate.label])
    assert explained.startswith(f"{settling}: ")
    found = _find(candidate, 0.35)
    assert say_shape(found) == f"frame 3 shifts along its y axis (b3), {settling}"
    amount = describe_amount(candidate.mechanism.terms, found.estimate, found.standard_error)
    assert amount == "by 0.350 ± 0.017 mm in all"


def test_what_grows_without_end_does_not_settle() -> None:
    candidate = _cell(3, "ty", Applied("exp", TIME / 1344.72))
    assert candidate.label == "frame 3 ty · exp(time_s/1344.72)"


@pytest.mark.parametrize(
    ("cause", "words"),
    [
        (torque(2), "in proportion to the gravity torque about joint 2"),
        (temperature_rise(27.0), "in proportion to the temperature, counted from 27 °C"),
        (Named("payload_kg", "kg"), "in proportion to the payload"),
        (sin(Named("q2", "rad")), "with sin(q2)"),
        (Named("approach2", "1"), "with approach2"),
    ],
)
def test_what_is_in_proportion_says_to_what(cause: Cause, words: str) -> None:
    found = _find(_cell(1, "tz", cause), 0.025)
    assert say_shape(found) == f"frame 1 shifts along its z axis (c1) {words}"


def test_a_turn_about_a_joint_s_axis_is_that_joint() -> None:
    turned = _cell(2, "rz", torque(2))
    of_joint = describe_what(_find(turned, 1e-7, joint=True))
    assert of_joint.startswith("Joint 2 is off its reading in proportion to the gravity torque")
    of_frame = say_shape(_find(turned, 1e-7))
    assert of_frame.startswith("frame 2 turns about its z axis (γ2) in proportion")


def test_the_verdict_names_a_shape_by_what_it_does_and_no_cause() -> None:
    effect = _find(_cell(2, "rz", torque(2)), 1e-7, joint=True)
    diagnosis = SimpleNamespace(
        faults=(), findings=[SimpleNamespace(effect=effect, doubtful=False)]
    )
    figures = SimpleNamespace(each=[SimpleNamespace(matters=True)])
    (named,) = collect_named(diagnosis, figures)  # type: ignore[arg-type]
    assert named.is_settled
    assert not named.is_cause
    assert named.name == (
        "joint 2 is off its reading in proportion to the gravity torque about joint 2"
    )


def test_the_sizes_of_many_terms_are_said_once_with_the_largest() -> None:
    centres = np.linspace(-2.0, 2.0, 6)
    curve = _cell(1, "rz", *(Bump("q1", float(c), 0.8) for c in centres))
    values = [0.1, -0.3, 0.2, 0.001, 0.15, 0.12]
    cautions = list_cautions(_find(curve, *values))
    assert cautions == ["m2 = -300 mrad is larger than usual (20.0 mrad), and so are 4 more"]
