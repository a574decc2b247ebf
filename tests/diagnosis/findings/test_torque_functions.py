"""What moves one joint with the gravity torque about it is one function of that, and has its numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from builders import drawn, seeds
from hidden_arm import Arm, State, arm, measured
from hidden_arm import Effect as Planted
from hidden_effects import at, together

from modelsel._typing import Array
from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.findings.claim_sentences import describe_proven
from modelsel.diagnosis.findings.claims import build_claim
from modelsel.diagnosis.findings.effects import Effect
from modelsel.diagnosis.findings.outcome import Diagnosis
from modelsel.diagnosis.findings.torque_functions import find_bend, find_loaded_joint, list_together
from modelsel.diagnosis.inference.credible_sets import CredibleSet, Entry
from modelsel.diagnosis.procedure import diagnose
from modelsel.diagnosis.rivals.finding_groups import FURTHER
from modelsel.diagnosis.rivals.soft_shapes import build_soft_springs, list_springs
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.diagnosis.shapes.torque_powers import build_powers
from modelsel.diagnosis.shapes.unregistered import build_cell
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import Named, q, sign, torque
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.terms import Mechanism
from modelsel.results.conclusions.finding_figures import bind_effect
from modelsel.results.numbers.quantities import Usable
from modelsel.results.numbers.usable_numbers import list_usable
from modelsel.results.numbers.workspace import build_workspace
from modelsel.robot.files import load_robot

SIGMA = 0.05
ARMS = ("puma760", "irb120")
Rng = np.random.Generator
Values = Callable[[State], Array]


# -- what is one function


def gather(problem: Problem, found: Sequence[tuple[Mechanism, float]], asked: bool = False) -> Any:
    """What is told together of findings, each with the estimate of its first term."""
    candidates = []
    for k, (one, _) in enumerate(found, 1):
        kind = CandidateKind.POWER if " " in one.name else CandidateKind.MECHANISM
        candidates.append(Candidate(one, kind, 0.01 * k, asked=asked))
    locate = {one: [k] for k, (one, _) in enumerate(found)}
    theta = np.array([estimate for _, estimate in found])
    view = SimpleNamespace(fitted=SimpleNamespace(theta=theta, locate=locate.__getitem__))
    traits = SimpleNamespace(acting_parts=candidates)
    search = SimpleNamespace(problem=problem, candidates=candidates, traits=traits)
    return list_together(cast(Any, search), cast(Any, view), range(len(found)))


@seeds(1)
def test_a_compliance_and_a_power_of_its_torque_are_one_function(rng: Rng) -> None:
    problem = drawn("puma760", rng, 40)
    compliance = mechanism("joint-compliance:3", problem.robot)
    elsewhere = mechanism("joint-compliance:2", problem.robot)
    power = build_powers(problem, 3)["1.5"]
    ((members, joined),) = gather(problem, [(compliance, 1e-4), (elsewhere, 1e-4), (power, -1e-4)])
    assert members == (0, 2)
    assert joined.kind is CandidateKind.SHAPE
    assert [term.key for term in joined.mechanism.terms] == [
        term.key for one in (compliance, power) for term in one.terms
    ]
    symbols = [term.symbol for term in joined.mechanism.terms]
    assert len(set(symbols)) == 2
    assert joined.mechanism.stem.startswith("3 rz")
    assert joined.prior == pytest.approx(0.03 * FURTHER)
    assert find_loaded_joint(problem.robot, joined.mechanism) == 3
    assert not gather(problem, [(compliance, 1e-4), (power, -1e-4)], asked=True)


@seeds(1)
def test_what_physics_allows_as_it_is_stays_apart(rng: Rng) -> None:
    problem = drawn("puma760", rng, 40)
    compliance, play = (
        mechanism(f"{name}:2", problem.robot) for name in ("joint-compliance", "backlash")
    )
    assert not gather(problem, [(compliance, 1e-4), (play, 1e-4)])
    ((members, _),) = gather(problem, [(compliance, 1e-4), (play, -1e-4)])
    assert members == (0, 1)


@seeds(1)
def test_a_link_that_bends_follows_the_torque_about_the_joint_at_its_end(rng: Rng) -> None:
    problem = drawn("ur10", rng, 40)
    bending = mechanism("link-bending:1", problem.robot)
    first = bending.terms[0].screws[0]
    assert (first.frame, first.axis) != (2, "rz")
    power = build_powers(problem, 2)["2"]
    assert set(build_soft_springs(problem, 2)) <= set(
        list_springs(problem, (2, "rz"), (bending, power))
    )
    assert not list_springs(problem, (2, "rx"), (bending, power))


def test_a_function_of_a_joints_torque_acts_along_its_motion_alone() -> None:
    robot = load_robot("puma760")
    by_torque = build_cell((3, "rz"), (torque(3), sign(torque(3))))
    assert find_loaded_joint(robot, by_torque) == 3
    others = (
        build_cell((3, "rx"), (torque(3),)),
        build_cell((3, "rz"), (torque(2),)),
        build_cell((3, "rz"), (torque(3) * q(2),)),
        build_cell((3, "rz"), (Named("approach3"),)),
    )
    assert not any(find_loaded_joint(robot, other) for other in others)


def tell(problem: Problem, one: Mechanism, *estimate: float, rival: str = "") -> Effect:
    """An effect of a joint that is told as deep as its drivers."""
    candidate = Candidate(one, CandidateKind.SHAPE, 0.01)
    size = np.array(estimate)
    own = Entry(candidate, 0.95, True, size, 0)
    entries = [own]
    if rival:
        listed = Candidate(mechanism(rival, problem.robot), CandidateKind.MECHANISM, 0.01)
        entries.append(Entry(listed, 0.05, False, size[:1], 1))
    named = CredibleSet(9.0, tuple(entries), 0, "found", np.zeros(len(entries)))
    effect = Effect(candidate, named, 0.01, size, np.abs(size) / 20)
    claim = build_claim(problem, candidate, np.array([1.0, 0.99, 0.0, 0.0]))
    return replace(effect, claim=replace(claim, bend=find_bend(problem, effect)))


@seeds(1)
def test_a_joint_that_yields_less_and_less_stiffens(rng: Rng) -> None:
    problem = drawn("puma760", rng, 40)
    powers = build_powers(problem, 3)
    words = "Joint 3 yields to the gravity torque about it, not in proportion: it "
    for power, bend in (("0.5", "stiffens"), ("1.5", "softens")):
        effect = tell(problem, powers[power], 1e-3)
        assert describe_proven(effect).startswith(f"{words}{bend} (")
    share = powers["1.5"].terms[0].screws[0].cause
    both = build_cell((3, "rz"), (torque(3), share))
    typical = np.abs(problem.value("torque3")).mean()
    assert describe_proven(tell(problem, both, 2e-3 / typical, -5e-4)).startswith(f"{words}stiff")
    untold = (
        tell(problem, powers["1.5"], -1e-3),
        tell(problem, powers["1.5"], 1e-3, rival="joint-compliance:3"),
        tell(problem, build_cell((3, "rz"), (torque(3),)), 1e-3),
        tell(problem, build_cell((2, "rz"), (torque(3),)), 1e-3),
    )
    assert not any("proportion" in describe_proven(effect) for effect in untold)


# -- what is planted


def turn_by(
    joint: int, body: Arm, state: State, values: Values, times: float
) -> tuple[Array, Array]:
    """How far the target moves, and the joint turns, at most so many times the noise at the target."""
    exact = measured(body, state, ())
    planted = Planted("planted", "", (together(at(joint, "rz", values)),), np.ones(1))
    unit = (measured(body, state, (planted.scaled(1e-4),)) - exact) / 1e-4
    scale = times * SIGMA / np.linalg.norm(unit, axis=1).max()
    return scale * unit, scale * values(state)


def draw(robot: str, rng: Rng, joint: int, *turns: tuple[Values, float]) -> tuple[Problem, Array]:
    """Measurements of an arm of which a joint turns by more than it reads, and by how much."""
    body: Arm = arm(load_robot(robot), rng, (40.0, -25.0, 100.0))
    state = State(body, body.draw(rng, 130), {})
    each = [turn_by(joint, body, state, values, times) for values, times in turns]
    position = measured(body, state, ()) + np.sum([moved for moved, _ in each], axis=0)
    noisy = position + SIGMA * rng.standard_normal(position.shape)
    problem = Problem(load_robot(robot), build_measurements(state.q, noisy), body.tool[None])
    return problem, np.sum([turned for _, turned in each], axis=0)


def find_moving(found: Diagnosis, joint: int) -> list[Effect]:
    """The effects that move one joint."""
    place = (joint, "rz")
    return [e for e in found.effects if list(e.candidate.mechanism.names_by_place()) == [place]]


def list_numbers(problem: Problem, found: Diagnosis, effect: Effect) -> list[Usable]:
    workspace = build_workspace(problem, np.random.default_rng(1))
    return list_usable(effect.candidate.mechanism, bind_effect(effect, found.fit, workspace))


def load(joint: int) -> Values:
    """The joint's gravity torque over its root mean square."""

    def values(s: State) -> Array:
        own = s.moment(joint)[:, 2]
        return np.asarray(own / np.sqrt(np.mean(own**2)))

    return values


SPRINGS: dict[str, Callable[[Array], Array]] = {
    "arctan": lambda own: np.arctan(1.5 * own) + 0.3 * own,
    "two slopes": lambda own: np.sign(own) * np.minimum(abs(own), 0.5 + abs(own) / 3),
    "logarithm": lambda own: np.sign(own) * np.log1p(3.0 * np.abs(own)),
}


@pytest.mark.slow
@seeds(1, 2)
@pytest.mark.parametrize("kind", SPRINGS)
def test_a_drive_that_stiffens_is_one_finding_with_the_size_of_its_turn(
    kind: str, rng: Rng
) -> None:
    joint = int(rng.integers(2, 4))
    robot = ARMS[int(rng.integers(2))]
    own = load(joint)
    problem, turned = draw(robot, rng, joint, (lambda s: SPRINGS[kind](own(s)), 20.0))
    found = diagnose(problem, seed=1)
    (effect,) = find_moving(found, joint)
    claim = effect.claim
    assert claim is not None
    assert claim.level == "drivers"
    assert claim.bend == "stiffens"
    angle, _ = list_numbers(problem, found, effect)
    row = np.abs(problem.value(f"torque{joint}")).argmax()
    # a shape of few numbers is nearly right
    margin = 0.04 * angle.value
    assert angle.low is not None
    assert angle.high is not None
    assert angle.low - margin < 1e3 * abs(turned[row]) < angle.high + margin


@pytest.mark.slow
@seeds(1)
@pytest.mark.parametrize("robot", ARMS)
def test_a_compliance_keeps_its_name_and_its_wind_up(robot: str, rng: Rng) -> None:
    joint = int(rng.integers(2, 4))
    problem, _ = draw(robot, rng, joint, (load(joint), 20.0))
    found = diagnose(problem, seed=1)
    (effect,) = find_moving(found, joint)
    assert effect.candidate.label in (f"joint-compliance:{joint}", f"joint{joint}-twist")
    assert effect.claim is not None
    assert not effect.claim.bend
    wound, *_ = list_numbers(problem, found, effect)
    assert wound.quantity.startswith("wind-up")


@pytest.mark.slow
@seeds(1)
def test_what_no_spring_fits_is_the_sum_of_a_compliance_and_a_power(rng: Rng) -> None:
    own = load(2)
    problem, turned = draw("irb120", rng, 2, (lambda s: own(s) - 0.3 * own(s) * abs(own(s)), 25.0))
    found = diagnose(problem, seed=1)
    (effect,) = find_moving(found, 2)
    assert effect.claim is not None
    assert effect.claim.level == "drivers"
    angle, _ = list_numbers(problem, found, effect)
    row = np.abs(problem.value("torque2")).argmax()
    assert angle.value == pytest.approx(1e3 * abs(turned[row]), rel=0.15)
