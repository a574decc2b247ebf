"""The side to which gravity holds the elbow's play: of its torque, and of the paper's lever, where the
robot file declares masses; of the lever alone where it does not. Play is planted in exact positions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import bind, seeds
from exact import flanges_of
from searches import search_separated

from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.signatures import LEVELS, PROVEN
from modelsel.fitting.design import Model
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import Named, sign
from modelsel.mechanisms.gravity_effects import forearm_lever
from modelsel.mechanisms.registry import build_mechanisms, every, mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.gravity import find_arm_pair
from modelsel.robot.kinematics import Robot

ROWS, NOISE_MM = 100, 0.02
TOOL = np.array([60.0, -80.0, 110.0])
TORQUE = sign(Named("torque3", "N m"))


def list_causes(robot: Robot) -> list[str]:
    return [str(one.terms[0].screws[0].cause) for one in build_mechanisms("backlash:3", robot)]


@pytest.mark.parametrize("name", ["ur10e", "ur5", "irb120"])
def test_declared_masses_offer_both_and_the_torque_with_the_payload(name: str) -> None:
    robot = load_robot(name)
    pair = find_arm_pair(robot)
    assert pair is not None
    whole = "sign(torque3+payload_kg*torque3_7)"
    assert list_causes(robot) == [str(TORQUE), str(sign(forearm_lever(pair))), whole]
    first = build_mechanisms("backlash:3", robot)[0]
    assert first.terms[0].sign == 1


@pytest.mark.parametrize("name", ["ur10e", "puma760"])
def test_the_lever_decides_without_masses(name: str) -> None:
    robot = load_robot(name)
    bare = replace(robot, joints=tuple(replace(one, mass=None) for one in robot.joints))
    pair = find_arm_pair(bare)
    assert pair is not None
    assert list_causes(bare) == [str(sign(forearm_lever(pair)))]
    (term,) = mechanism("backlash:3", bare).terms
    assert term.sign == pair.far_sign * pair.parallel


def weigh_elbow(arm: Robot, q: np.ndarray) -> np.ndarray:
    """The moment of the declared masses beyond the elbow about its axis, by its own sum."""
    total = np.zeros(len(q))
    for k in range(2, arm.n):
        joint = arm.joints[k]
        upto = replace(arm, joints=arm.joints[: k + 1], last=np.eye(4), coupling=None)
        body = flanges_of(upto, q[:, : k + 1])
        centre = body[:, :3, 3] + body[:, :3, :3] @ np.array(joint.com)
        if k == 2:
            axis, origin = body[:, :3, 2], body[:, :3, 3]
        pull = np.array([0.0, 0.0, -(joint.mass or 0.0)])
        total += np.einsum("mi,mi->m", axis, np.cross(centre - origin, pull))
    return total


@pytest.mark.slow
@seeds(1, 2)
@pytest.mark.parametrize("by_torque", [True, False])
def test_play_of_either_side_is_named(by_torque: bool, rng: np.random.Generator) -> None:
    arm = load_robot(str(rng.choice(["ur10e", "ur5e"])))
    q = arm.draw(rng, ROWS)
    # the arm's three middle axes are level: the forearm hangs by the sum of two readings
    side = weigh_elbow(arm, q) if by_torque else np.cos(q[:, 1] + q[:, 2])
    size = rng.uniform(1.5e-4, 3e-4)
    moved = q.copy()
    moved[:, 2] += size * np.sign(side)
    flange = flanges_of(arm, moved)
    seen = flange[:, :3, 3] + flange[:, :3, :3] @ TOOL + rng.normal(0, NOISE_MM, (ROWS, 3))
    at = bind(arm, build_measurements(q, seen), TOOL)
    base = Model((mechanism("geometric", arm),))
    diagnosis = search_separated(at, base, build_candidates(at, base, every(arm)))
    assert [one.candidate.label for one in diagnosis.effects] == ["backlash:3"]
    (effect,) = diagnosis.effects
    assert effect.claim is not None
    assert effect.claim.levels[LEVELS.index("cause")] >= PROVEN
    assert abs(effect.estimate[0]) == pytest.approx(size, abs=5 * effect.standard_error[0])
