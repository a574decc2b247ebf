"""Functions of one driver that level off: what resembles them is not told as proven."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from builders import drawn, seeds
from hidden_arm import Arm, Effect, State, arm, measured
from hidden_effects import at, together

from modelsel._typing import Array
from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.signatures import PROVEN
from modelsel.diagnosis.findings.claims import weigh_together
from modelsel.diagnosis.procedure import diagnose
from modelsel.diagnosis.rivals.finding_groups import FindingGroup, list_finding_groups
from modelsel.diagnosis.rivals.soft_shapes import (
    build_cornered_springs,
    build_soft_springs,
    generate_soft_springs,
    generate_soft_steps,
    list_soft_steps,
    list_springs,
)
from modelsel.diagnosis.rivals.unlisted_shapes import UNLISTED_ODDS, list_rivals
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.diagnosis.shapes.torque_powers import build_powers
from modelsel.diagnosis.shapes.unregistered import build_cell, build_wave
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import Named, cos, q, sign, sin, torque
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.terms import Mechanism
from modelsel.robot.files import load_robot

SIGMA = 0.05
ARMS = ("puma760", "irb120")
Rng = np.random.Generator
Values = Callable[[State], Array]


# -- what stands beside a finding


def value(problem: Problem, found: Mechanism) -> Array:
    (term,) = found.terms
    (screw,) = term.screws
    return np.asarray(screw.cause.of(problem.state))


@pytest.mark.parametrize("robot", ARMS)
@seeds(1)
def test_springs_that_stiffen_rise_less_and_less_with_the_torque(robot: str, rng: Rng) -> None:
    problem = drawn(robot, rng, 60)
    load = np.asarray(problem.value("torque3"))
    size = np.sort(np.abs(load))
    springs = list(build_soft_springs(problem, 3))
    assert len(springs) > 4
    for spring in springs:
        turned = value(problem, spring)
        np.testing.assert_array_equal(np.sign(turned), np.sign(load))
        risen = np.abs(turned)[np.argsort(np.abs(load))]
        slopes = np.diff(risen) / np.diff(size)
        assert (slopes > 0).all()
        assert (np.diff(slopes) < 1e-12).all()
    assert not list(build_soft_springs(problem, 1))


@pytest.mark.parametrize("robot", ARMS)
@seeds(1)
def test_a_spring_of_two_stiffnesses_has_a_corner(robot: str, rng: Rng) -> None:
    """Two numbers: what turns with the torque throughout, and what does so up to the corner."""
    problem = drawn(robot, rng, 60)
    load = np.asarray(problem.value("torque3"))
    corners = set()
    for spring in build_cornered_springs(problem, 3):
        always, softer = (np.asarray(t.screws[0].cause.of(problem.state)) for t in spring.terms)
        np.testing.assert_allclose(always / load, always[0] / load[0])
        most = np.abs(softer).max()
        is_soft = np.abs(softer) < (1 - 1e-9) * most
        np.testing.assert_allclose(softer[is_soft], 2 * always[is_soft])
        assert np.abs(load[is_soft]).max() < np.abs(load[~is_soft]).min()
        corners.add(round(most / np.abs(always).max(), 6))
    assert len(corners) == 3
    assert not list(build_cornered_springs(problem, 1))


@seeds(1)
def test_every_spring_stands_beside_a_power_of_the_torque_as_one_question(rng: Rng) -> None:
    problem = drawn("puma760", rng, 60)
    root = build_powers(problem, 3)["0.5"]
    found = Candidate(root, CandidateKind.POWER, 0.01)
    springs = set(build_soft_springs(problem, 3))
    alike = [one for one in list_rivals(problem, found) if one.agrees == "drivers"]
    own = [one for one in alike if one.candidate.mechanism in springs]
    assert len(own) == len(springs)
    priors = [one.candidate.prior for one in own]
    np.testing.assert_allclose(priors, UNLISTED_ODDS * found.prior)
    others = (
        mechanism("joint-compliance:3", problem.robot),
        build_cell((3, "rx"), (torque(3),)),
        build_cell((3, "rz"), (torque(2),)),
    )
    for other in others:
        assert not list(generate_soft_springs(problem, other))


@seeds(1)
def test_soft_steps_stand_beside_a_wave_of_which_little_more_than_one_is_seen(rng: Rng) -> None:
    problem = drawn("puma760", rng, 60)
    span = np.ptp(problem.data.q[:, 2])
    turns = span / (2 * np.pi)
    wave = build_wave(3, 1.2 / turns)
    steps = list(generate_soft_steps(problem, wave))
    assert steps
    for step in steps:
        assert step.names() == {"q3"}
        assert set(step.names_by_place()) == {(3, "rz")}
    rivals = {one.candidate.mechanism for one in list_rivals(problem, wave_of(wave))}
    assert set(steps) <= rivals
    assert not list(generate_soft_steps(problem, build_wave(3, 1.6 / turns)))
    elsewhere = build_cell((2, "rz"), (sin(q(3)), cos(q(3))))
    assert not list(generate_soft_steps(problem, elsewhere))
    assert not list(generate_soft_steps(problem, mechanism("encoder-scale:3", problem.robot)))


def wave_of(wave: Mechanism) -> Candidate:
    return Candidate(wave, CandidateKind.JOINT_WAVE, 0.01)


@seeds(1)
def test_soft_steps_stand_in_the_place_of_several_waves_of_a_joint(rng: Rng) -> None:
    problem = drawn("irb120", rng, 60)
    first = mechanism("gear-eccentricity:2", problem.robot)
    third = build_wave(2, 3.0)
    steps = list_soft_steps(problem, (first, third))
    assert steps
    (group,) = list_finding_groups(problem, {1: wave_of(first), 4: wave_of(third)})
    assert set(steps) <= {one.mechanism for one in group.shapes}
    scale = mechanism("encoder-scale:2", problem.robot)
    assert not list_soft_steps(problem, (first, scale))


@seeds(1)
def test_springs_stand_in_the_place_of_findings_that_follow_the_torque(rng: Rng) -> None:
    problem = drawn("puma760", rng, 80)
    place = (3, "rz")
    twist, step = (
        mechanism(f"{name}:3", problem.robot) for name in ("joint-compliance", "backlash")
    )
    springs = list_springs(problem, place, (twist, step))
    assert len(springs) == 15
    assert set(build_cornered_springs(problem, 3)) < set(springs)
    readings = [build_cell(place, (q(j),)) for j in (1, 2, 3)]
    assert not list_springs(problem, place, readings[1:])
    assert len(list_springs(problem, place, (twist, readings[2]))) == 12
    assert not list_springs(problem, place, (twist, readings[0]))
    assert not list_springs(problem, place, (twist, build_cell(place, (Named("approach3"),))))
    follows = build_cell(place, (torque(3) + 1e-6 * q(1),))
    assert list_springs(problem, place, (follows, step)) == springs
    assert not list_springs(problem, (3, "rx"), (twist, step))
    assert not list_springs(problem, (1, "rz"), (build_cell((1, "rz"), (sign(torque(1)),)),))


@seeds(1)
def test_springs_are_of_another_driver_than_functions_of_readings(rng: Rng) -> None:
    problem = drawn("puma760", rng, 80)
    compliance = mechanism("joint-compliance:3", problem.robot)
    step = mechanism("backlash:3", problem.robot)
    by_torque = {1: wave_of(compliance), 2: wave_of(build_powers(problem, 3)["1.5"])}
    (group,) = list_finding_groups(problem, by_torque)
    assert not group.others
    assert set(build_soft_springs(problem, 3)) <= {one.mechanism for one in group.shapes}
    twist = mechanism("joint3-twist", problem.robot)
    (group,) = list_finding_groups(problem, {1: wave_of(twist), 2: wave_of(step)})
    assert {name for one in group.others for name in one.mechanism.names()} == {"torque3"}


def test_shapes_of_another_driver_take_the_drivers_too() -> None:
    found, alike, other = (
        Candidate(build_cell((3, "rz"), (q(j),)), CandidateKind.SHAPE, 0.1) for j in (1, 2, 3)
    )
    group = FindingGroup((4, 7), found, (alike,), (other,))
    search = cast(Any, SimpleNamespace(candidates=dict.fromkeys((4, 7), found)))
    factors = np.log(np.array([[5.0, 3.0, 2.0]]))
    contenders = cast(Any, SimpleNamespace(weigh=lambda _, which: factors[:, : len(which)]))
    shares, better = weigh_together(search, group, contenders)
    np.testing.assert_allclose(shares, [1.0, 0.8, 0.5, 0.5])
    assert better is None
    factors = np.log(np.array([[1.0, 1.0, 8.0]]))
    shares, better = weigh_together(search, group, contenders)
    np.testing.assert_allclose(shares, [1.0, 0.2, 0.1, 0.1])
    assert better is other


# -- what is planted


def plant(robot: str, rng: Rng, *turns: tuple[int, Values, float], m: int = 130) -> Problem:
    """Configurations of an arm whose joints turn by more than they read, each by so many times the noise
    at the farthest, through the tests' own exact kinematics."""
    body: Arm = arm(load_robot(robot), rng, (40.0, -25.0, 100.0))
    state = State(body, body.draw(rng, m), {})
    exact = measured(body, state, ())
    moved = np.zeros_like(exact)
    for joint, values, times in turns:
        term = together(at(joint, "rz", values))
        effect = Effect("planted", "", (term,), np.ones(1))
        unit = (measured(body, state, (effect.scaled(1e-4),)) - exact) / 1e-4
        farthest = np.linalg.norm(unit, axis=1).max()
        moved += times * SIGMA / farthest * unit
    noisy = exact + moved + SIGMA * rng.standard_normal(exact.shape)
    return Problem(load_robot(robot), build_measurements(state.q, noisy), body.tool[None])


def list_shapes_told(problem: Problem) -> dict[str, float]:
    """What is told as a shape or a cause that is proven, with its probability."""
    told = {}
    for effect in diagnose(problem, seed=1).effects:
        claim = effect.claim
        assert claim is not None
        if claim.level in ("shape", "cause") and claim.probability >= PROVEN:
            told[effect.candidate.label] = claim.probability
    return told


SPRINGS: dict[str, Callable[[Array], Array]] = {
    "arctan": lambda load: np.arctan(2.0 * load),
    "logarithm": lambda load: np.sign(load) * np.log1p(2.5 * np.abs(load)),
}


@pytest.mark.slow
@seeds(1, 2)
@pytest.mark.parametrize("kind", SPRINGS)
def test_a_spring_that_stiffens_is_no_power_of_its_torque_beside_play(kind: str, rng: Rng) -> None:
    joint = int(rng.integers(2, 4))

    def spring(s: State) -> Array:
        load = s.moment(joint)[:, 2]
        return SPRINGS[kind](load / np.sqrt(np.mean(load**2)))

    def play(s: State) -> Array:
        return -np.sign(s.move[:, joint - 1])

    turns = [(joint, spring, rng.uniform(15, 30)), (joint, play, 8.0)]
    told = list_shapes_told(plant(ARMS[int(rng.integers(2))], rng, *turns))
    assert set(told) <= {f"approach-backlash:{joint}"}
