"""An axis whose tilt goes round is told as that, with two numbers, planted in exact positions: all beyond the
joint is tilted about a line that turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import OFF_AXIS, bind, seeds
from exact import flanges_of
from scipy.spatial.transform import Rotation
from searches import find_cause, search_separated

from modelsel._typing import Array
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.findings.outcome import Diagnosis
from modelsel.fitting.design import Model
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import build_mechanisms, every, mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Robot

NOISE_MM = 0.02
ROWS = 120
# how often a turn, with the joint's turning (1) or against it
WAYS = [(2, 1), (3, 1), (1, -1), (2, -1), (3, -1)]


def tilt(arm: Robot, joint: int, q: Array, tilts: Array) -> Array:
    """Places of the target of an arm, all beyond a joint tilted by rotations (m, 3) about its frame's axes
    before it turns."""
    lower = replace(arm, joints=arm.joints[: joint - 1], last=np.eye(4), coupling=None)
    start = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    if joint > 1:
        start = flanges_of(lower, q[:, : joint - 1])
    there = start @ arm.joints[joint - 1].before
    beyond = np.linalg.inv(there) @ flanges_of(arm, q) @ np.array([*OFF_AXIS, 1.0])[:, None]
    turned = Rotation.from_rotvec(tilts).apply(beyond[:, :3, 0])
    return np.asarray(there[:, :3, 3] + np.einsum("mij,mj->mi", there[:, :3, :3], turned))


def circle(angle: Array, amplitude: float, phase: float) -> Array:
    """Rotations (m, 3) of one amplitude about a line across z that stands at an angle."""
    line = [np.cos(angle + phase), np.sin(angle + phase), np.zeros(len(angle))]
    return amplitude * np.stack(line, axis=1)


def diagnose(joint: int, way: int, rng: np.random.Generator) -> tuple[Diagnosis, float]:
    """Diagnose an arm of which one axis wobbles twice a turn, by an amplitude."""
    arm = load_robot(("puma760", "irb120")[int(rng.integers(2))])
    q = arm.draw(rng, ROWS)
    amplitude = float(rng.uniform(4e-4, 6e-4))
    tilts = circle(2 * way * q[:, joint - 1], amplitude, float(rng.uniform(0, 6)))
    seen = tilt(arm, joint, q, tilts) + rng.normal(0, NOISE_MM, (ROWS, 3))
    at = bind(arm, build_measurements(q, seen))
    base = Model((mechanism("geometric", arm),))
    return search_separated(at, base, build_candidates(at, base, every(arm))), amplitude


@pytest.mark.slow
@seeds(1, 2)
def test_a_tilt_that_goes_round_against_the_joint_is_told(rng: np.random.Generator) -> None:
    diagnosis, amplitude = diagnose(2, -1, rng)
    effect = find_cause(diagnosis, "axis-wobble:2")
    assert len(effect.estimate) == 2
    found = float(np.hypot(*effect.estimate))
    assert found == pytest.approx(amplitude, abs=5 * effect.standard_error.max())


@pytest.mark.slow
@seeds(1, 2)
def test_one_that_goes_with_the_joint_is_told_with_what_moves_the_target_alike(
    rng: np.random.Generator,
) -> None:
    """A wave once a turn at the next frame does nearly the same: it had been told in the place of it."""
    joint = int(rng.integers(1, 3))
    diagnosis, amplitude = diagnose(joint, 1, rng)
    (effect,) = diagnosis.effects
    assert effect.candidate.label == f"axis-wobble:{joint}"
    assert len(effect.estimate) == 2
    found = float(np.hypot(*effect.estimate))
    assert found == pytest.approx(amplitude, abs=5 * effect.standard_error.max())
    assert all(entry.alike for entry in effect.named.entries)


@seeds(1)
def test_each_circle_is_a_tilt_of_one_amplitude(rng: np.random.Generator) -> None:
    arm = load_robot("irb120")
    q = arm.draw(rng, 20)
    at = bind(arm, build_measurements(q, np.zeros((20, 3))))
    circles = [one for one in build_mechanisms("axis-wobble:3", arm) if len(one.terms) == 2]
    for (often, way), one in zip(WAYS, circles, strict=True):
        amplitude, phase = float(rng.uniform(1, 2)), float(rng.uniform(0, 6))
        wanted = circle(way * often * q[:, 2], amplitude, phase)
        found = {"rx": np.zeros(20), "ry": np.zeros(20)}
        shares = amplitude * np.array([np.cos(phase), -way * np.sin(phase)])
        for term, share in zip(one.terms, shares, strict=True):
            for screw in term.screws:
                assert screw.frame == 3
                found[screw.axis] = found[screw.axis] + share * at.cause(screw.cause)
        np.testing.assert_allclose(np.stack(list(found.values()), 1), wanted[:, :2], atol=1e-12)


def test_once_with_the_joint_is_no_wobble() -> None:
    """What it turns stands askew, which is geometry."""
    arm = load_robot("irb120")
    for one in build_mechanisms("axis-wobble:2", arm):
        if len(one.terms) == 2 and "once" in one.sentence:
            assert "exp(-i q2)" in one.equation
