"""A base that yields to the arm's weight and to the payload by one stiffness is one finding; planted by
turning all exact positions about frame 0."""

from __future__ import annotations

import numpy as np
import pytest
from builders import bind, seeds
from exact import flanges_of
from held_loads import RATED, TOOL, WEIGHT, frame_of, place_of
from scipy.spatial.transform import Rotation
from searches import find_cause, search_separated

from modelsel._typing import Array
from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.nested_loads import find_nested_loads
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import build_mechanisms, every, mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Robot

NOISE_MM = 0.02
ROWS = 120
Rng = np.random.Generator


def draw(rng: Rng) -> tuple[Robot, Array, Array]:
    name = str(rng.choice(list(RATED)))
    arm = load_robot(name)
    return arm, arm.draw(rng, ROWS), RATED[name] * rng.choice([0.0, 0.4, 1.0], ROWS)


def moment_of(arm: Robot, q: Array, payload: Array) -> Array:
    """The moment (m, 3) of all masses and of a payload at the target about frame 0 [N m]."""
    moment = np.cross(place_of(flanges_of(arm, q), TOOL) / 1e3, payload[:, None] * WEIGHT)
    for k, link in enumerate(arm.joints, 1):
        centre = place_of(frame_of(arm, k, q), np.array(link.com))
        moment += np.cross(centre / 1e3, (link.mass or 0.0) * WEIGHT)
    return np.asarray(moment)


def build_problem(arm: Robot, q: Array, payload: Array, seen: Array) -> Problem:
    data = build_measurements(q, seen, covariates={"payload_kg": payload})
    return bind(arm, data, TOOL)


@pytest.mark.slow
@seeds(1, 2)
def test_a_base_that_tilts_with_weight_and_payload_is_one_finding(rng: Rng) -> None:
    arm, q, payload = draw(rng)
    straight = place_of(flanges_of(arm, q), TOOL)
    size = rng.uniform(3e-4, 5e-4) * np.array([1.0, rng.uniform(0.5, 1.0)])
    moment = moment_of(arm, q, payload)
    size = size / np.abs(moment).max()
    turns = Rotation.from_rotvec(moment * np.array([*size, 0.0]))
    seen = turns.apply(straight) + rng.normal(0, NOISE_MM, straight.shape)
    at = build_problem(arm, q, payload, seen)
    base = Model((mechanism("geometric", arm),))
    diagnosis = search_separated(at, base, build_candidates(at, base, every(arm)))
    effect = find_cause(diagnosis, "base-tilt")
    for estimate, error, planted in zip(effect.estimate, effect.standard_error, size, strict=True):
        assert estimate == pytest.approx(planted, abs=5 * error)


@seeds(1)
def test_the_moment_of_both_is_that_of_all_masses(rng: Rng) -> None:
    arm, q, payload = draw(rng)
    at = build_problem(arm, q, payload, np.zeros((ROWS, 3)))
    moment = moment_of(arm, q, payload)
    own, both = build_mechanisms("base-tilt", arm)
    held = moment - moment_of(arm, q, 0 * payload)
    for k, (term, of_own) in enumerate(zip(both.terms, own.terms, strict=True)):
        (screw,), (alone,) = term.screws, of_own.screws
        np.testing.assert_allclose(at.cause(screw.cause), moment[:, k], atol=1e-6)
        np.testing.assert_allclose(at.cause(alone.cause), moment[:, k] - held[:, k], atol=1e-6)


@pytest.mark.integration
@seeds(1)
def test_both_are_offered_where_the_payload_changes(rng: Rng) -> None:
    """And then two of own weight, payload and both are told by the first two."""
    arm, q, payload = draw(rng)
    for kilograms, forms in ((payload, 2), (np.full(ROWS, 3.0), 1)):
        at = build_problem(arm, q, kilograms, np.zeros((ROWS, 3)))
        base = Model((mechanism("geometric", arm),))
        offered = build_candidates(at, base, every(arm))
        assert sum(one.label == "base-tilt" for one in offered) == forms
    own, both = build_mechanisms("base-tilt", arm)
    springs = [own, both, mechanism("payload-tilt", arm)]
    loads = find_nested_loads([Candidate(one, CandidateKind.MECHANISM, 0.1) for one in springs])
    assert loads.tell_apart([1, 2]) == (0, 2)
