"""What is told of a finding: where most explanations agree, and the likeliest constant of a shape."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import drawn

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.findings.told_explanations import find_agreed, find_constant
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.diagnosis.shapes.torque_powers import build_powers, generate_powers
from modelsel.diagnosis.shapes.unregistered import build_cell
from modelsel.mechanisms.causes import q, shifted, sign, torque
from modelsel.mechanisms.registry import build_mechanisms, mechanism
from modelsel.robot.files import load_robot

PLACES = np.array([0, 1, 1, 1, -1])
DRIVERS = np.array([0, 1, 2, 2, -1])


@pytest.mark.parametrize(
    ("g", "probability", "told"),
    [
        # the most probable name has a place of its own, two others share one
        (0, [0.4, 0.35, 0.15, 0.05, 0.05], 1),
        (0, [0.55, 0.2, 0.1, 0.1, 0.05], None),
        # of one place, drivers that two names share
        (1, [0.1, 0.4, 0.2, 0.3, 0.0], 3),
        (1, [0.1, 0.5, 0.2, 0.2, 0.0], None),
        (2, [0.1, 0.4, 0.2, 0.3, 0.0], None),
        # what says nothing of a place agrees with nothing
        (0, [0.2, 0.05, 0.05, 0.05, 0.65], None),
    ],
)
def test_what_most_explanations_agree_on_is_told(
    g: int, probability: list[float], told: int | None
) -> None:
    shares = np.array(probability)
    levels = np.array([shares[known == known[g]].sum() for known in (PLACES, DRIVERS)])
    assert find_agreed((PLACES, DRIVERS), g, shares, levels) == told


def test_rivals_that_are_no_candidates_count_for_their_place() -> None:
    shares = np.array([0.4, 0.35, 0.15, 0.05, 0.05])
    with_rivals = np.array([0.6, 0.6])
    assert find_agreed((PLACES, DRIVERS), 0, shares, with_rivals) is None


def jump(joint: int, angle: float, prior: float, kind: CandidateKind) -> Candidate:
    return Candidate(build_cell((joint, "rz"), (sign(shifted(q(joint), angle)),)), kind, prior)


def test_the_likeliest_constant_of_a_shape_is_told() -> None:
    own = jump(2, 0.1, 1e-3, CandidateKind.JUMP)
    found = [
        own,
        jump(2, 0.2, 1e-6, CandidateKind.JUMP),
        jump(3, 0.2, 1e-3, CandidateKind.JUMP),
        jump(2, 0.3, 1e-3, CandidateKind.CELL),
    ]
    evidence = np.array([5.0, 6.0, 9.0, 9.0])
    assert find_constant(found, 0, evidence) == replace(found[1], prior=own.prior)
    assert find_constant(found, 1, evidence) is None
    assert find_constant(found, 3, evidence) is None
    assert find_constant(found, 0, np.array([5.0, 5.05, 9.0, 9.0])) is None


def test_the_likelier_masses_of_a_compliance_are_told() -> None:
    """Of declared and unknown masses, not of another joint's or another mechanism's."""
    arm = load_robot("puma760")
    names = ("joint-compliance:5", "joint-compliance:4", "encoder-scale:5")
    built = [one for name in names for one in build_mechanisms(name, arm)]
    found = [Candidate(one, CandidateKind.MECHANISM, 1e-3) for one in built]
    declared, unknown = found[:2]
    evidence = np.array([6.0, 5.0, 9.0, 9.0, 9.0])
    assert find_constant(found, 1, evidence) == declared
    assert find_constant(found, 0, evidence) is None
    assert unknown.registered_name == declared.registered_name
    assert find_constant(found, 4, evidence) is None


@pytest.mark.parametrize("robot", ["puma760", "irb120"])
def test_powers_are_those_of_the_torque(robot: str, rng: np.random.Generator) -> None:
    at = drawn(robot, rng, 30)
    load = np.asarray(at.value("torque3"))
    powers = build_powers(at, 3)
    assert set(powers) == {"0.5", "1.5", "2", "2.5", "3"}
    for power, own in powers.items():
        values = np.asarray(own.terms[0].screws[0].cause.of(at.state))
        exact = np.sign(load) * np.abs(load) ** float(power)
        np.testing.assert_allclose(values / exact, values[0] / exact[0], rtol=1e-9)
        assert np.abs(values).max() < 100 * np.abs(load).max()


def test_powers_stand_beside_what_yields_with_the_torque_of_its_own_joint(
    rng: np.random.Generator,
) -> None:
    at = drawn("puma760", rng, 30)
    assert len(list(generate_powers(at, mechanism("joint-compliance:3", at.robot)))) == 5
    elsewhere = (
        build_cell((3, "rx"), (torque(3),)),
        build_cell((7, "tx"), (torque(3),)),
        build_cell((3, "rz"), (torque(2),)),
        build_cell((3, "rz"), (q(3),)),
    )
    for other in elsewhere:
        assert not list(generate_powers(at, other))


def test_a_joint_without_torque_has_no_powers(rng: np.random.Generator) -> None:
    upright = drawn("puma760", rng, 30)
    assert not build_powers(upright, 1)
