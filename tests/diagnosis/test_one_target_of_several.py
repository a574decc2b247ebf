"""Of several targets one that droops, grows or shifts by itself is told by its name; all that do so
alike are told together. Planted in exact positions by other equations than those that search."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from builders import seeds
from exact import flanges_of

from modelsel.diagnosis.candidates.signatures import LEVELS, PROVEN
from modelsel.diagnosis.findings.outcome import Diagnosis
from modelsel.diagnosis.findings.sentences import label_effect
from modelsel.diagnosis.procedure import diagnose
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Robot

NOISE_MM = 0.02
ROWS = 70
NAMES = ("A", "B", "C", "D")
TOOLS = np.array(
    [[90.0, 30.0, 70.0], [-60.0, -110.0, 150.0], [30.0, 95.0, 60.0], [-70.0, 40.0, 110.0]]
)
Rng = np.random.Generator
# poses (m, 4, 4) of the flange, temperatures and payloads (m,): shifts (m, 3) of a target in frame 0
Plant = Callable[[Rng, np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def grow(rng: Rng, flange: np.ndarray, celsius: np.ndarray, payload: np.ndarray) -> np.ndarray:
    """A stem that grows in some direction of the flange."""
    stem = rng.normal(size=3)
    stem *= rng.uniform(0.02, 0.04) / np.linalg.norm(stem)
    return np.asarray((celsius - 20)[:, None] * (flange[:, :3, :3] @ stem))


def stand_aside(
    rng: Rng, flange: np.ndarray, celsius: np.ndarray, payload: np.ndarray
) -> np.ndarray:
    """A nest that sits elsewhere in the gripper of every payload."""
    return grow(rng, flange, 20 + payload, payload)


def sink(rng: Rng, flange: np.ndarray, celsius: np.ndarray, payload: np.ndarray) -> np.ndarray:
    """A holder that lets the target sink by its load, a third as much along the flange's axis."""
    axis = flange[:, :3, 2]
    down = np.array([0.0, 0.0, -1.0]) + 2 / 3 * axis[:, 2:] * axis
    return rng.uniform(0.03, 0.05) * payload[:, None] * down


def droop(rng: Rng, flange: np.ndarray, celsius: np.ndarray, payload: np.ndarray) -> np.ndarray:
    """A cantilever along the flange's axis, which sinks where it lies level."""
    axis = flange[:, :3, 2]
    across = np.array([0.0, 0.0, -1.0]) + axis[:, 2:] * axis
    return rng.uniform(0.2, 0.3) * across


PLANTS: dict[str, Plant] = {
    "thermal-shift": grow,
    "payload-shift": stand_aside,
    "payload-droop": sink,
    "tool-droop": droop,
}


def measure(
    arm: Robot, rng: Rng, count: int, plant: Plant | None, moved: list[int], warm_zero: float = 0.0
) -> Problem:
    """A campaign of some targets, of which some move; the last joint's zero follows the temperature."""
    q = arm.draw(rng, ROWS)
    celsius = rng.uniform(14, 28, ROWS)
    payload = rng.choice([0.0, 2.0, 5.0], ROWS)
    turned = q.copy()
    turned[:, -1] += warm_zero * (celsius - 20)
    flange = flanges_of(arm, turned)
    turned_tools = np.einsum("mij,tj->mti", flange[:, :3, :3], TOOLS[:count])
    position = flange[:, None, :3, 3] + turned_tools
    if plant is not None:
        position[:, moved] += plant(rng, flange, celsius, payload)[:, None]
    position += rng.normal(0, NOISE_MM, position.shape)
    columns = {"temperature_C": np.repeat(celsius, count), "payload_kg": np.repeat(payload, count)}
    data = build_measurements(
        np.repeat(q, count, axis=0),
        position.reshape(-1, 3),
        target=np.tile(NAMES[:count], ROWS),
        covariates=columns,
    )
    return Problem(arm, data, TOOLS[:count])


def draw_arm(rng: Rng) -> Robot:
    """One of some arms that the search knows nothing else of."""
    return load_robot(("ur5e", "irb120", "puma560")[int(rng.integers(3))])


def check_told(found: Diagnosis, name: str) -> None:
    """Check that one effect is told, by its cause, and no target is louder nor an axis."""
    (effect,) = found.effects
    assert label_effect(effect) == name
    assert effect.claim is not None
    assert effect.claim.levels[LEVELS.index("cause")] >= PROVEN
    assert found.errors.names == ()


@pytest.mark.slow
@seeds(1, 2)
@pytest.mark.parametrize("name", PLANTS)
def test_one_target_is_told_by_its_name(name: str, rng: Rng) -> None:
    """It was told of all targets, half as large, of joint 6, or as noise along an axis."""
    count = int(rng.choice([2, 4]))
    one = int(rng.integers(count))
    at = measure(draw_arm(rng), rng, count, PLANTS[name], [one])
    check_told(diagnose(at), f"{name}:{NAMES[one]}")


@pytest.mark.slow
@seeds(1)
@pytest.mark.parametrize("name", PLANTS)
def test_all_targets_alike_are_told_together(name: str, rng: Rng) -> None:
    count = int(rng.choice([1, 2, 4]))
    at = measure(draw_arm(rng), rng, count, PLANTS[name], list(range(count)))
    check_told(diagnose(at), name)


@pytest.mark.slow
@seeds(1, 2)
def test_the_last_joint_keeps_its_zero(rng: Rng) -> None:
    """Three free numbers of the target do what one of the joint does, and are no likelier."""
    arm = draw_arm(rng)
    count = int(rng.choice([1, 2]))
    at = measure(arm, rng, count, None, [], rng.uniform(3e-4, 6e-4))
    check_told(diagnose(at), f"thermal-zero:{arm.n}")


@pytest.mark.slow
@seeds(1, 2, 3)
def test_targets_that_stay_are_not_told(rng: Rng) -> None:
    at = measure(draw_arm(rng), rng, int(rng.choice([2, 4])), None, [])
    assert not [label_effect(effect) for effect in diagnose(at).effects]
