"""Of a spring under the arm's weight and the payload it is told what the payload alone says, planted with one
stiffness or with two."""

from __future__ import annotations

import numpy as np
import pytest
from builders import bind, seeds
from exact import flanges_of
from held_loads import place_of, torques_of

from modelsel._typing import Array
from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.findings.effects import Claim, Effect
from modelsel.diagnosis.findings.springs_apart import SpringsApart
from modelsel.diagnosis.inference.credible_sets import CredibleSet, Entry
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import Fit, fit
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.compliance import WITH_PAYLOAD
from modelsel.mechanisms.registry import build_mechanisms, mechanism
from modelsel.mechanisms.terms import Mechanism
from modelsel.results.numbers.compliance_numbers import measure_springs_apart
from modelsel.results.runs.finding_records import Finding
from modelsel.robot.files import load_robot
from modelsel.selection.gain import Gain
from modelsel.study.pipeline.payload_springs import add_payload_springs

ARM = load_robot("ur5e")
JOINT = 3
ROWS, NOISE_MM = 90, 0.02
TOOL = np.array([60.0, -50.0, 80.0])
DRAWS = 12
Rng = np.random.Generator


def plant(stiffness: float, times: float, rng: Rng) -> Problem:
    """An arm whose joint yields to the payload by a stiffness, to its own weight `times` as much."""
    q = ARM.draw(rng, ROWS)
    payload = rng.choice([0.0, 2.0, 5.0], ROWS)
    own, held = torques_of(ARM, JOINT, q, payload, TOOL)
    turned = q.copy()
    turned[:, JOINT - 1] += (times * own + held) / stiffness
    seen = place_of(flanges_of(ARM, turned), TOOL) + rng.normal(0, NOISE_MM, (ROWS, 3))
    return bind(ARM, build_measurements(q, seen, covariates={"payload_kg": payload}), TOOL)


def fit_whole(at: Problem) -> tuple[Mechanism, Fit]:
    """One spring under both loads beside the arm's geometry, fitted."""
    whole = build_mechanisms(f"joint-compliance:{JOINT}", ARM)[WITH_PAYLOAD]
    return whole, fit(at, Model((mechanism("geometric", ARM), whole)))


def tell(at: Problem, told: Mechanism, fitted: Fit, wider: float = 1.0) -> Finding:
    """A finding of one mechanism of a fit, as it is told; its standard error may be wider."""
    terms = fitted.locate(told)
    estimate, error = fitted.theta[terms], wider * fitted.standard_errors[terms]
    candidate = Candidate(told, CandidateKind.MECHANISM, 0.01)
    entry = Entry(candidate, 0.99, True, estimate, 0)
    named = CredibleSet(9.0, (entry,), 0, "found", np.zeros(1), 0)
    claim = Claim("cause", (1.0, 1.0, 0.99, 0.99), True)
    effect = Effect(candidate, named, 0.01, estimate, error, claim=claim)
    (finding,) = add_payload_springs([Finding(effect, Gain(None, None, None))], at, fitted)
    return finding


def find_apart(finding: Finding) -> SpringsApart:
    assert finding.effect.apart is not None
    return finding.effect.apart


def tell_drawn(times: float, rng: Rng) -> tuple[list[Finding], Array]:
    """Findings of drawn arms, and the stiffness that each has."""
    stiffness = rng.uniform(5e4, 8e4, DRAWS)
    findings = []
    for one in stiffness.tolist():
        at = plant(one, times, rng)
        findings.append(tell(at, *fit_whole(at)))
    return findings, stiffness


@seeds(1, slow=[2])
@pytest.mark.parametrize("times", [0.5, 1.0, 2.0])
def test_the_payload_tells_its_stiffness_whatever_the_arm_weighs(times: float, rng: Rng) -> None:
    """Of twelve 95 % intervals nine at least hold the truth, and so do those of the weight."""
    findings, stiffness = tell_drawn(times, rng)
    hits = weighs = 0
    for finding, one in zip(findings, stiffness, strict=True):
        apart = find_apart(finding)
        number = measure_springs_apart(apart)
        assert number.low is not None
        assert number.high is not None
        hits += number.low < one < number.high
        assert apart.low is not None
        assert apart.high is not None
        weighs += apart.low < times < apart.high
    assert min(hits, weighs) >= 0.75 * DRAWS


@pytest.mark.integration
@seeds(1, slow=[2])
def test_two_stiffnesses_are_not_told_as_one(rng: Rng) -> None:
    times = float(rng.choice([0.4, 2.5]))
    findings, _ = tell_drawn(times, rng)
    for finding in findings:
        assert find_apart(finding).is_doubted
        words = finding.sentence
        assert (
            "that one stiffness holds for both with the masses as declared is not proven" in words
        )
        assert "of the payload, with the masses as declared" not in words
        assert "times (95 %: " in words


@seeds(1, slow=[2])
def test_one_stiffness_is_told_as_one(rng: Rng) -> None:
    findings, _ = tell_drawn(1.0, rng)
    told = [one for one in findings if not find_apart(one).is_doubted]
    assert len(told) >= 0.75 * DRAWS
    assert all("of the payload, with the masses as declared: c3" in one.sentence for one in told)


@seeds(1)
def test_a_wider_error_of_the_finding_widens_both(rng: Rng) -> None:
    at = plant(6e4, 1.0, rng)
    whole, fitted = fit_whole(at)
    narrow = find_apart(tell(at, whole, fitted))
    wide = find_apart(tell(at, whole, fitted, wider=2.0))
    assert wide.compliance == narrow.compliance
    assert wide.error == pytest.approx(2 * narrow.error)


@seeds(1)
def test_any_other_finding_is_as_it_was(rng: Rng) -> None:
    at = plant(6e4, 1.0, rng)
    own = build_mechanisms(f"joint-compliance:{JOINT}", ARM)[0]
    payload = mechanism(f"payload-deflection:{JOINT}", ARM)
    fitted = fit(at, Model((mechanism("geometric", ARM), own, payload)))
    for one in (own, payload):
        assert tell(at, one, fitted).effect.apart is None
