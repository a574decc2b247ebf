"""Unlisted shapes of covariates with few values, and of several findings at one place."""

from __future__ import annotations

import numpy as np
import pytest
from builders import OFF_AXIS, bind, seeds, small_arm
from exact import flanges_of
from searches import search_separated

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.signatures import LEVELS
from modelsel.diagnosis.findings.outcome import Diagnosis
from modelsel.diagnosis.findings.told_explanations import sum_constants
from modelsel.diagnosis.rivals.finding_groups import list_finding_groups
from modelsel.diagnosis.rivals.unlisted_shapes import list_rivals
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.diagnosis.shapes.unregistered import build_cell
from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import Named, cos, q, sin
from modelsel.mechanisms.registry import every, mechanism
from modelsel.robot.files import load_robot

PAYLOADS = (0.0, 2.0, 4.0, 7.0, 10.0)
NOISE_MM = 0.03
PAYLOAD = Named("payload_kg", "kg")


def load(values: int, rng: np.random.Generator) -> Problem:
    """Configurations of a small arm under so many payloads, by turns."""
    robot = small_arm()
    readings = robot.draw(rng, 60)
    payload = np.resize(PAYLOADS[:values], 60)
    position = rng.normal(0, 100, (60, 3))
    return bind(robot, build_measurements(readings, position, covariates={"payload_kg": payload}))


@pytest.mark.parametrize(("values", "powers"), [(2, 0), (3, 2), (4, 3), (5, 3)])
@seeds(1)
def test_powers_stand_against_a_covariate_with_few_values(
    values: int, powers: int, rng: np.random.Generator
) -> None:
    own = Candidate(build_cell((2, "rz"), (PAYLOAD,)), CandidateKind.CELL, 0.01)
    rivals = list_rivals(load(values, rng), own)
    alike = [r.candidate.mechanism for r in rivals if r.agrees == "drivers"]
    assert [len(one.terms) for one in alike] == [powers] * bool(powers)
    for term in (term for one in alike for term in one.terms):
        (screw,) = term.screws
        assert (screw.frame, screw.axis, screw.cause.names()) == (2, "rz", {"payload_kg"})


def diagnose_loaded(rng: np.random.Generator, power: int) -> Diagnosis:
    """Diagnose an arm that one joint of which turns with a power of the payload."""
    robot = load_robot(("ur5e", "irb120", "puma560")[int(rng.integers(3))])
    readings = robot.draw(rng, 120)
    payload = rng.choice([0.0, 5.0, 10.0], 120)
    turned = readings.copy()
    turned[:, 1 + int(rng.integers(3))] += rng.uniform(6e-4, 1e-3) * (payload / 10) ** power
    flange = flanges_of(robot, turned)
    position = flange[:, :3, 3] + flange[:, :3, :3] @ np.array(OFF_AXIS)
    measured = position + rng.normal(0, NOISE_MM, position.shape)
    at = bind(robot, build_measurements(readings, measured, covariates={"payload_kg": payload}))
    base = Model((mechanism("geometric", robot),))
    return search_separated(at, base, build_candidates(at, base, every(robot)))


@pytest.mark.slow
@pytest.mark.parametrize("power", [1, 3])
@seeds(1, 2)
def test_only_what_is_proportional_to_a_payload_is_told_so(
    power: int, rng: np.random.Generator
) -> None:
    effects = diagnose_loaded(rng, power).effects
    claims = [effect.claim for effect in effects]
    assert claims
    drivers, shape = LEVELS.index("drivers"), LEVELS.index("shape")
    for claim in claims:
        assert claim is not None
        assert claim.levels[drivers] > 0.5
        assert (claim.levels[shape] > 0.5) == (power == 1)


@seeds(1)
def test_waves_across_a_joints_axis_stand_against_a_free_function_together(
    rng: np.random.Generator,
) -> None:
    at = load(3, rng)
    waves = [build_cell((2, "tx"), (sin(k * q(2)), cos(k * q(2)))) for k in (1.0, 2.0)]
    found = {g: Candidate(one, CandidateKind.WAVE, 0.01) for g, one in enumerate(waves)}
    (group,) = list_finding_groups(at, found)
    assert group.members == (0, 1)
    assert all(one.mechanism.names() == {"q2"} for one in group.shapes)
    assert max(len(one.mechanism.terms) for one in group.shapes) > 4
    (place,) = {place for one in group.shapes for place in one.mechanism.names_by_place()}
    assert place == (2, "tx")


@pytest.mark.integration
@seeds(1)
def test_a_mechanism_is_as_probable_as_its_forms_together(rng: np.random.Generator) -> None:
    at = load(3, rng)
    found = build_candidates(at, Model((mechanism("geometric", at.robot),)), every(at.robot))
    for g, one in enumerate(found):
        if one.registered_name == "zero-step:2":
            forms = [other.prior for other in found if other.registered_name == "zero-step:2"]
            assert len(forms) > 1
            assert sum_constants(found, g) == pytest.approx(sum(forms))
        elif one.kind is CandidateKind.CELL:
            assert sum_constants(found, g) == one.prior
