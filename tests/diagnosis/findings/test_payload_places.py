"""Payloads that hang elsewhere than at the target, planted with exact kinematics: no spring is claimed as a cause that
has them hang where they do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import bind, seeds
from hung_payloads import TOOL, WEIGHT, chain, place, wind_up
from searches import find_cause, search_separated

from modelsel._typing import Array
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.signatures import LEVELS, PROVEN
from modelsel.diagnosis.findings.outcome import Diagnosis
from modelsel.diagnosis.findings.payload_places import find_places, share_by_places
from modelsel.fitting.design import Model
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.compliance import ANYWHERE, AT_TARGET, list_hangs
from modelsel.mechanisms.registry import build_mechanisms, every, mechanism
from modelsel.results.conclusions.finding_notes import payload_place_notes
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Robot

NOISE_MM = 0.03
ROWS = 90
Rng = np.random.Generator


def diagnose(
    joints: list[int], hangs: Array, rng: Rng, *, stated: bool = False
) -> tuple[Robot, Diagnosis]:
    """Diagnose a UR arm, two thirds of whose rows are measured with a payload, which hangs where it is
    `stated` or at the target as far as is known."""
    arm = load_robot(str(rng.choice(["ur5e", "ur10e"])))
    if stated:
        x, y, z = hangs.tolist()
        arm = replace(arm, payload_at_mm=(x, y, z))
    q = arm.draw(rng, ROWS)
    payload = rng.choice([0.0, 4.0, 8.0], ROWS)
    reached = place(chain(arm, wind_up(arm, joints, q, payload, hangs))[-1], TOOL)
    measured = reached + rng.normal(0, NOISE_MM, (ROWS, 3))
    data = build_measurements(q, measured, covariates={"payload_kg": payload})
    at = bind(arm, data, TOOL)
    base = Model((mechanism("geometric", arm),))
    return arm, search_separated(at, base, build_candidates(at, base, every(arm)))


@pytest.mark.slow
@seeds(1, 2)
def test_the_last_joint_is_told_wherever_the_payload_hangs(rng: Rng) -> None:
    hangs = np.array([*rng.choice([-1, 1], 2) * rng.uniform(150, 300, 2), 80.0])
    arm, diagnosis = diagnose([6], hangs, rng)
    effect = find_cause(diagnosis, f"payload-deflection:{arm.n}")
    assert len(effect.estimate) == 2
    assert not payload_place_notes(diagnosis)


@pytest.mark.slow
@seeds(1, 2, 3)
def test_every_joint_is_told_where_the_payload_hangs_as_stated(rng: Rng) -> None:
    hangs = np.array([*rng.choice([-1, 1], 2) * rng.uniform(150, 300, 2), 80.0])
    joints = sorted(rng.choice([4, 5, 6], 2, replace=False).tolist())
    _, diagnosis = diagnose(joints, hangs, rng, stated=True)
    found = {effect.label: effect for effect in diagnosis.effects}
    names = [f"payload-deflection:{joint}" for joint in joints]
    assert set(names) <= set(found)
    for label, effect in found.items():
        assert effect.claim is not None
        if label not in names:
            # of twenty campaigns one has a further effect by chance
            assert effect.claim.probability < PROVEN
            continue
        assert effect.claim.levels[LEVELS.index("cause")] >= PROVEN
        assert len(effect.estimate) == 1
    assert not payload_place_notes(diagnosis)


@pytest.mark.slow
@seeds(1, 2)
def test_nothing_is_a_cause_where_a_payload_hangs_in_two_places(rng: Rng) -> None:
    """Joints 5 and 6 yield: what the payload's place does beside the target's goes to the flange."""
    hangs = np.array([0.0, rng.choice([-1, 1]) * rng.uniform(200, 300), 80.0])
    _, diagnosis = diagnose([5, 6], hangs, rng)
    (note,) = payload_place_notes(diagnosis)
    assert note.code == "payload-places"
    places = find_places([one.candidate.mechanism for one in diagnosis.effects])
    for number in (*places.anywhere, *places.at_target):
        effect = diagnosis.effects[number]
        assert effect.claim is not None
        assert effect.claim.levels[LEVELS.index("cause")] < PROVEN
        assert effect.label in note.sentence


def test_a_payload_anywhere_is_offered_for_a_last_joint_that_turns_the_flange() -> None:
    arm = load_robot("ur5e")
    hangs = [list_hangs(arm, joint) for joint in range(1, arm.n + 1)]
    assert hangs == [(AT_TARGET,)] * 5 + [(AT_TARGET, ANYWHERE)]


def test_the_torque_of_a_payload_anywhere_is_told_by_gravity_in_the_flange(rng: Rng) -> None:
    arm = load_robot("irb120")
    q, payload = arm.draw(rng, 30), rng.uniform(1, 5, 30)
    hangs = rng.uniform(-200, 200, 3)
    data = build_measurements(q, np.zeros((30, 3)), covariates={"payload_kg": payload})
    at = bind(arm, data, TOOL)
    poses = chain(arm, q)
    moment = np.cross(place(poses[-1], hangs) - poses[-2][:, :3, 3], payload[:, None] * WEIGHT)
    torque = np.einsum("mi,mi->m", moment, poses[-2][:, :3, 2])
    free = build_mechanisms(f"payload-deflection:{arm.n}", arm)[ANYWHERE]
    columns = np.stack([at.cause(term.screws[0].cause) for term in free.terms], axis=1)
    numbers, *_ = np.linalg.lstsq(columns, torque)
    np.testing.assert_allclose(columns @ numbers, torque, atol=1e-9 * np.abs(torque).max())


def test_springs_share_their_claims_where_they_have_a_payload_in_two_places() -> None:
    arm = load_robot("ur5e")
    at_target = build_mechanisms("payload-deflection:5", arm)[0]
    flange = build_mechanisms("payload-bending:6", arm)
    own = build_mechanisms("joint-compliance:3", arm)[0]
    shares = share_by_places([at_target, flange[1], own])
    assert shares.tolist() == [[1, 1, 0.5, 0.5], [0.5] * 4, [1] * 4]
    for agreeing in ([at_target, flange[0], own], [flange[1], own]):
        assert (share_by_places(agreeing) == 1).all()
