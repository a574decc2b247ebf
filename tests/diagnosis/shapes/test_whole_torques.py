"""A joint that yields to the arm's own weight and to the payload by one spring is one finding, and so are
its play and a spring of it that stiffens; planted in exact positions, by masses times lever arms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import bind, seeds
from exact import flanges_of
from held_loads import RATED, TOOL, place_of, torques_of
from searches import find_cause, search_separated

from modelsel._typing import Array
from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.signatures import LEVELS, PROVEN
from modelsel.diagnosis.findings.effects import Effect
from modelsel.diagnosis.findings.outcome import Diagnosis
from modelsel.diagnosis.findings.torque_functions import find_loaded_joint
from modelsel.diagnosis.rivals.soft_shapes import generate_soft_springs, list_springs
from modelsel.diagnosis.shapes.torque_powers import build_powers, generate_powers
from modelsel.diagnosis.shapes.whole_torques import find_load, list_torques, sees_both_loads
from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import build_mechanisms, every, mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Robot

NOISE_MM = 0.02
ROWS = 100
Rng = np.random.Generator


def draw(rng: Rng, rows: int = ROWS) -> tuple[Robot, Array, Array]:
    """An arm with its masses, readings and a payload of each."""
    name = str(rng.choice(list(RATED)))
    arm = load_robot(name)
    payload = RATED[name] * rng.choice([0.0, 0.4, 1.0], rows)
    return arm, arm.draw(rng, rows), payload


def diagnose(arm: Robot, q: Array, payload: Array, joint: int, turn: Array, rng: Rng) -> Diagnosis:
    """Diagnose an arm of which one joint turns by something (m,)."""
    turned = q.copy()
    turned[:, joint - 1] += turn
    seen = place_of(flanges_of(arm, turned), TOOL) + rng.normal(0, NOISE_MM, (len(q), 3))
    at = bind(arm, build_measurements(q, seen, covariates={"payload_kg": payload}), TOOL)
    base = Model((mechanism("geometric", arm),))
    return search_separated(at, base, build_candidates(at, base, every(arm)))


def has_payload(effect: Effect) -> bool:
    return "payload_kg" in effect.candidate.mechanism.names()


@pytest.mark.slow
@seeds(1, 2, 3)
def test_a_spring_under_weight_and_payload_is_one_finding(rng: Rng) -> None:
    arm, q, payload = draw(rng)
    joint = int(rng.integers(2, 4))
    own, held = torques_of(arm, joint, q, payload, TOOL)
    size = rng.uniform(1e-3, 2e-3) / np.abs(own + held).max()
    diagnosis = diagnose(arm, q, payload, joint, size * (own + held), rng)
    effect = find_cause(diagnosis, f"joint-compliance:{joint}")
    assert has_payload(effect)
    assert "of the arm's weight and of the payload" in effect.candidate.mechanism.sentence
    assert effect.estimate[0] == pytest.approx(size, abs=5 * effect.standard_error[0])


@pytest.mark.slow
@seeds(1, 2)
def test_a_spring_under_the_payload_alone_keeps_its_name(rng: Rng) -> None:
    arm, q, payload = draw(rng)
    joint = int(rng.integers(2, 4))
    _, held = torques_of(arm, joint, q, payload, TOOL)
    turn = rng.uniform(1e-3, 2e-3) * held / np.abs(held).max()
    find_cause(diagnose(arm, q, payload, joint, turn, rng), f"payload-deflection:{joint}")


@pytest.mark.slow
@seeds(1, 2)
def test_a_spring_under_the_own_weight_alone_keeps_its_name(rng: Rng) -> None:
    arm, q, payload = draw(rng)
    own, _ = torques_of(arm, 3, q, payload, TOOL)
    turn = rng.uniform(1e-3, 2e-3) * own / np.abs(own).max()
    effect = find_cause(diagnose(arm, q, payload, 3, turn, rng), "joint-compliance:3")
    assert not has_payload(effect)


@pytest.mark.slow
@seeds(1, 2, 3)
def test_masses_that_are_declared_wrongly_leave_the_payload_its_own_spring(rng: Rng) -> None:
    """The spring under the payload is told with its stiffness, whatever the masses; it is not what another
    one under both leaves."""
    arm, q, payload = draw(rng)
    own, held = torques_of(arm, 2, q, payload, TOOL)
    wrongly = float(rng.choice([0.4, 2.5]))
    size = rng.uniform(1.5e-3, 2.5e-3) / np.abs(wrongly * own + held).max()
    diagnosis = diagnose(arm, q, payload, 2, size * (wrongly * own + held), rng)
    labels = {effect.candidate.label: effect for effect in diagnosis.effects}
    effect = labels["payload-deflection:2"]
    assert effect.claim is not None
    assert effect.claim.levels[LEVELS.index("cause")] >= PROVEN
    assert effect.estimate[0] == pytest.approx(size, abs=5 * effect.standard_error[0])
    others = [one for label, one in labels.items() if label != effect.candidate.label]
    assert not any(has_payload(one) for one in others)


@pytest.mark.slow
@seeds(1, 2)
def test_play_falls_to_the_side_of_weight_and_payload(rng: Rng) -> None:
    arm, q, payload = draw(rng)
    own, held = torques_of(arm, 3, q, payload, TOOL)
    turn = rng.uniform(2e-4, 4e-4) * np.sign(own + held)
    effect = find_cause(diagnose(arm, q, payload, 3, turn, rng), "backlash:3")
    assert has_payload(effect)


@pytest.mark.slow
@seeds(1, 2)
def test_a_spring_that_stiffens_under_weight_and_payload_is_one_finding(rng: Rng) -> None:
    """Twice as soft up to a fifth of the largest torque as beyond it."""
    arm, q, payload = draw(rng)
    own, held = torques_of(arm, 2, q, payload, TOOL)
    share = (own + held) / np.abs(own + held).max()
    size = np.abs(share)
    knee = 0.2
    softly = np.minimum(size, knee) + np.maximum(size - knee, 0.0) / 2
    turn = rng.uniform(2e-3, 3e-3) * np.sign(share) * softly
    (effect,) = diagnose(arm, q, payload, 2, turn, rng).effects
    assert effect.claim is not None
    assert effect.claim.bend == "stiffens"
    assert has_payload(effect)


@pytest.mark.slow
@seeds(4, 5, 8)
def test_a_soft_zone_within_which_nothing_was_measured_is_no_play(rng: Rng) -> None:
    """Both turn a joint by a step and in proportion beyond it; of a strain wave gear the step is a zone of
    small torques where it is softer."""
    arm, q, payload = draw(rng, 6 * ROWS)
    joint = int(rng.integers(2, 4))
    own, held = torques_of(arm, joint, q, payload, TOOL)
    share = (own + held) / np.abs(own + held).max()
    soft = 0.15
    kept = np.flatnonzero(np.abs(share) > soft)[: ROWS // 2]
    stiffly = share + 0.7 * soft * np.sign(share)
    turn = rng.uniform(1e-3, 2e-3) * stiffly[kept]
    diagnosis = diagnose(arm, q[kept], payload[kept], joint, turn, rng)
    assert diagnosis.effects
    for effect in diagnosis.effects:
        claim = effect.claim
        assert claim is not None
        place, drivers, shape, _ = claim.levels
        assert min(place, drivers) >= PROVEN
        assert shape < PROVEN


@seeds(1)
def test_springs_under_weight_and_payload_stand_in_the_place_of_a_spring_and_a_play(
    rng: Rng,
) -> None:
    arm = load_robot("ur5e")
    at = build_problem(arm, rng.choice([0.0, 2.0, 5.0], 40), rng)
    _, whole = list_torques(arm, 2)
    spring, play = (
        build_mechanisms(f"{one}:2", arm)[-1] for one in ("joint-compliance", "backlash")
    )
    springs = list_springs(at, (2, "rz"), (spring, play))
    assert {one.names() for one in springs} == {whole.names()}
    assert set(build_powers(at, 2, whole).values()) < set(springs)
    own = [build_mechanisms(f"{one}:2", arm)[0] for one in ("joint-compliance", "backlash")]
    assert {one.names() for one in list_springs(at, (2, "rz"), own)} == {frozenset({"torque2"})}
    square = build_powers(at, 2, whole)["2"]
    beside = list(generate_soft_springs(at, square))
    assert beside
    assert set(beside) < set(springs)
    rivals = set(generate_powers(at, spring))
    assert square in rivals
    assert find_loaded_joint(arm, square) == 2


def build_problem(arm: Robot, payload: Array | None, rng: Rng) -> Problem:
    q = arm.draw(rng, 40)
    covariates = {} if payload is None else {"payload_kg": payload}
    return bind(arm, build_measurements(q, np.zeros((40, 3)), covariates=covariates), TOOL)


def list_offered(at: Problem) -> list[Candidate]:
    base = Model((mechanism("geometric", at.robot),))
    return list(build_candidates(at, base, every(at.robot)))


def list_whole(at: Problem) -> set[str]:
    """List the labels of what depends on one torque of weight and payload."""
    whole = set()
    for candidate in list_offered(at):
        cause = candidate.mechanism.terms[0].screws[0].cause
        names = cause.names()
        if "payload_kg" in names and any(f"torque{j}" in names for j in range(1, 8)):
            whole.add(candidate.label)
    return whole


@pytest.mark.integration
@seeds(1)
def test_the_whole_torque_is_offered_where_the_payload_changes(rng: Rng) -> None:
    """And about joints where the arm's own weight is seen beside it, not about those of a wrist."""
    arm = load_robot("irb120")
    varies = rng.choice([0.0, 1.0, 3.0], 40)
    whole = list_whole(build_problem(arm, varies, rng))
    compliant = {one for one in whole if one.startswith("joint-compliance")}
    assert compliant == {"joint-compliance:2", "joint-compliance:3"}
    assert "backlash:2" in whole
    assert any("torque2 with the payload to the power 2" in one for one in whole)
    for payload in (None, np.zeros(40), np.full(40, 3.0)):
        assert not list_whole(build_problem(arm, payload, rng))


@seeds(1)
def test_where_the_payload_does_not_change_the_rest_is_as_likely_as_without_it(rng: Rng) -> None:
    arm = load_robot("ur5e")
    at = build_problem(arm, np.full(40, 3.0), rng)
    offered = list_offered(at)
    forms = [one for one in offered if one.label == "joint-compliance:2"]
    other = [one for one in offered if one.label == "encoder-scale:2"]
    assert len(forms) == 2
    assert sum(one.prior for one in forms) == pytest.approx(other[0].prior)


@seeds(1)
def test_an_arm_without_masses_has_no_whole_torque(rng: Rng) -> None:
    arm = load_robot("ur5e")
    massless = replace(arm, joints=tuple(replace(one, mass=None) for one in arm.joints))
    at = build_problem(massless, rng.choice([0.0, 5.0], 40), rng)
    assert not list_whole(at)
    assert not sees_both_loads(at, 2)
    for name in ("joint-compliance:2", "backlash:2"):
        built = build_mechanisms(name, massless)
        assert not any("payload_kg" in one.names() for one in built)
        assert len(build_mechanisms(name, arm)) == len(built) + 1


@pytest.mark.integration
@seeds(1)
def test_where_a_mass_is_missing_there_is_no_whole_torque(rng: Rng) -> None:
    """About the joints that carry that link, whatever others weigh."""
    arm = load_robot("ur5e")
    payload = rng.choice([0.0, 5.0], 40)
    links = [2, 3, 4]
    for link in links:
        joints = list(arm.joints)
        joints[link - 1] = replace(joints[link - 1], mass=None)
        at = build_problem(replace(arm, joints=tuple(joints)), payload, rng)
        seen = {joint for joint in links if sees_both_loads(at, joint)}
        assert seen == {joint for joint in links if joint > link}
        whole = list_whole(at)
        offered = {joint for joint in links if f"joint-compliance:{joint}" in whole}
        assert offered == seen
        assert {joint for joint in links if f"backlash:{joint}" in whole} <= seen


@seeds(1)
def test_powers_are_of_the_torque_that_they_say(rng: Rng) -> None:
    arm = load_robot("ur5e")
    at = build_problem(arm, rng.choice([0.0, 2.0, 5.0], 40), rng)
    own, whole = list_torques(arm, 2)
    held = np.asarray(at.cause(whole))
    assert find_load(arm, 2, whole.names()) == whole
    assert find_load(arm, 2, own.names()) == own
    assert find_load(arm, 3, own.names()) is None
    square = build_powers(at, 2, whole)["2"]
    bent = np.asarray(at.cause(square.terms[0].screws[0].cause))
    assert np.corrcoef(bent, held * np.abs(held))[0, 1] == pytest.approx(1.0)
    assert "torque2 with the payload" in square.name
    assert "of the arm's weight and of the payload" in square.sentence
    assert "payload" not in build_powers(at, 2)["2"].name
