"""A joint that is behind its reading in motion is told by its speed, and by nothing that happens where
an arm stops. Campaigns by exact chains of the tests' own."""

from __future__ import annotations

import numpy as np
import pytest
from builders import bind, drawn, seeds
from hidden_arm import Arm, State, arm
from hidden_arm import measured as measure

from modelsel.diagnosis.candidates.signatures import PROVEN
from modelsel.diagnosis.candidates.usable_names import list_lacking
from modelsel.diagnosis.findings.effects import Effect
from modelsel.diagnosis.findings.sentences import label_effect
from modelsel.diagnosis.procedure import diagnose
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.files import load_robot

TOOL = (40.0, -30.0, 110.0)
SIGMA = 0.02
Rng = np.random.Generator


def follow(
    rng: Rng, body: Arm, m: int, waves: tuple[int, int] = (2, 8)
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (m,) of a path of two sines a joint, each of so many waves, its readings and speeds (m, n)."""
    time = 0.6 * np.cumsum(rng.uniform(0.7, 1.3, m))
    low, high = body.limits.clip(-2.6, 2.6).T
    q = np.tile((low + high) / 2, (m, 1))
    rate = np.zeros_like(q)
    for share in (0.3, 0.15):
        speed = rng.uniform(*waves, body.n) * 2 * np.pi / time[-1]
        angle = np.outer(time, speed) + rng.uniform(0, 2 * np.pi, body.n)
        q += share * (high - low) * np.sin(angle)
        rate += share * (high - low) * speed * np.cos(angle)
    return time, q, rate


def explain(
    rng: Rng, body: Arm, q: np.ndarray, stands: np.ndarray, time: np.ndarray
) -> tuple[Effect, ...]:
    position = measure(body, State(body, stands), ())
    position = position + rng.normal(0, SIGMA, position.shape)
    data = build_measurements(q, position, covariates={"time_s": time})
    return diagnose(Problem(load_robot(body.name), data, np.array([TOOL]))).effects


def list_proven(effects: tuple[Effect, ...], level: int = -1) -> set[str]:
    """Names of effects that are proven at a level, by default their cause."""
    return {
        label_effect(effect)
        for effect in effects
        if effect.claim is not None and effect.claim.levels[level] >= PROVEN
    }


@seeds(1)
def test_the_speed_is_asked_where_the_arm_moves_on(rng: Rng) -> None:
    body = arm(load_robot("ur5e"), rng, TOOL)
    time, q, _ = follow(rng, body, 60)
    moving = bind("ur5e", build_measurements(q, np.zeros((60, 3)), covariates={"time_s": time}))
    lag = mechanism("servo-lag:2", moving.robot)
    assert list_lacking(moving, [lag]) == [frozenset()]
    settle = mechanism("settle:2", moving.robot)
    assert list_lacking(drawn("ur5e", rng, 60), [lag, settle]) == [{"rate2"}, frozenset()]


def test_a_lag_is_a_time_that_a_joint_is_behind() -> None:
    (term,) = mechanism("servo-lag:3", load_robot("ur5e")).terms
    assert term.unit == "s"
    assert term.sign == -1


@pytest.mark.slow
@seeds(1, 2, 3)
def test_joints_that_follow_late_are_told_by_their_speed(rng: Rng) -> None:
    """They were told as moves that had not settled, of an arm that never stood still."""
    body = arm(load_robot("irb120"), rng, TOOL)
    time, q, rate = follow(rng, body, 180)
    late = rng.choice(4, 2, replace=False)
    stands = q.copy()
    stands[:, late] -= rng.uniform(1.5e-3, 3e-3, 2) * rate[:, late]
    effects = explain(rng, body, q, stands, time)
    names = {label_effect(effect) for effect in effects}
    assert names == {f"servo-lag:{joint + 1}" for joint in late}
    assert list_proven(effects)


@pytest.mark.slow
@seeds(1, 2, 3)
def test_friction_in_motion_has_the_direction_of_the_speed(rng: Rng) -> None:
    """It was told as a part of the last move that levels off."""
    body = arm(load_robot("ur5e"), rng, TOOL)
    time, q, rate = follow(rng, body, 180, (6, 14))
    joint = int(rng.integers(1, 4))
    stands = q.copy()
    stands[:, joint - 1] -= 2e-4 * np.sign(rate[:, joint - 1])
    effects = explain(rng, body, q, stands, time)
    assert list_proven(effects) == {f"approach-backlash:{joint}"}
    assert len(effects) == 1


@pytest.mark.slow
@seeds(1, 2)
def test_nothing_is_told_of_a_motion_without_an_error(rng: Rng) -> None:
    body = arm(load_robot("irb120"), rng, TOOL)
    time, q, _ = follow(rng, body, 150)
    assert not list_proven(explain(rng, body, q, q, time), 0)


@pytest.mark.slow
@seeds(1, 2)
def test_an_arm_that_stops_too_short_a_time_is_told_as_before(rng: Rng) -> None:
    body = arm(load_robot("irb120"), rng, TOOL)
    q = body.draw(rng, 90, 2.4)
    stands = q.copy()
    stands[:, 1] -= 6e-4 * State(body, q).move[:, 1]
    time = np.cumsum(rng.uniform(4, 9, 90))
    assert "settle:2" in list_proven(explain(rng, body, q, stands, time))
