"""Effects of the instrument's beam, and of what holds the target, are told as themselves, planted in
exact positions by other equations than those that search for them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders import OFF_AXIS, bind, seeds
from exact import flanges_of
from searches import search_separated

from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.signatures import LEVELS, PROVEN
from modelsel.diagnosis.findings.outcome import Diagnosis
from modelsel.fitting.design import Model
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.compliance import joint_compliance
from modelsel.mechanisms.registry import build_mechanisms, every, mechanism
from modelsel.mechanisms.terms import ratio
from modelsel.robot.files import load_robot
from modelsel.robot.gravity import find_bearing_joints, find_gravity_joints
from modelsel.robot.kinematics import Robot

NOISE_MM = 0.02
ROWS = 90
TRACKER = np.array([2600.0, -1900.0, 700.0])
# poses (m, 4, 4) of the flange, payloads (m,) and a size: shifts (m, 3) of the target in frame 0
Plant = Callable[[np.ndarray, np.ndarray, float], np.ndarray]


def pull(flange: np.ndarray) -> np.ndarray:
    """Which way a plumb line hangs, in the flange: (m, 3)."""
    return np.asarray(-flange[:, 2, :3])


def stretch(flange: np.ndarray, payload: np.ndarray, size: float) -> np.ndarray:
    """Along the flange's axis, by the cosine of its angle to a plumb line."""
    return np.asarray(size * pull(flange)[:, 2:] * flange[:, :3, 2])


def fall(flange: np.ndarray, payload: np.ndarray, size: float) -> np.ndarray:
    """From one end of the play to the other."""
    hangs = pull(flange)[:, 2:] > 0
    return np.asarray(np.where(hangs, size, -size) * flange[:, :3, 2])


def yield_to_load(flange: np.ndarray, payload: np.ndarray, size: float) -> np.ndarray:
    """Downwards in the world by the payload, along the flange's axis a third as much."""
    down = np.array([0.0, 0.0, -1.0])
    along = (flange[:, :3, 2] @ down)[:, None] * flange[:, :3, 2]
    return np.asarray(size * payload[:, None] * (down - 2 / 3 * along))


TOOLS: dict[str, tuple[Plant, float]] = {
    "tool-stretch": (stretch, 0.25),
    "tool-play": (fall, 0.15),
    "payload-droop": (yield_to_load, 0.08),
}


def diagnose_shifted(arm: Robot, rng: np.random.Generator, name: str, size: float) -> Diagnosis:
    """Diagnose an arm whose target is shifted, with readings and payloads drawn."""
    q = arm.draw(rng, ROWS)
    payload = rng.choice([0.0, 2.0, 5.0], ROWS)
    flange = flanges_of(arm, q)
    position = flange[:, :3, 3] + flange[:, :3, :3] @ np.array(OFF_AXIS)
    if name == "tracker-range":
        beam = position - TRACKER
        shift = size * beam / np.linalg.norm(beam, axis=1)[:, None]
    else:
        shift = TOOLS[name][0](flange, payload, size)
    measured = position + shift + rng.normal(0, NOISE_MM, position.shape)
    covariates = {"payload_kg": payload}
    at = bind(arm, build_measurements(q, measured, covariates=covariates))
    at = replace(at, tracker=tuple(TRACKER))
    base = Model((mechanism("geometric", arm),))
    return search_separated(at, base, build_candidates(at, base, every(arm)))


@pytest.mark.slow
@seeds(1, 2)
@pytest.mark.parametrize("name", [*TOOLS, "tracker-range"])
def test_what_holds_and_what_sees_the_target_is_told(name: str, rng: np.random.Generator) -> None:
    arm = load_robot(("ur5e", "irb120", "puma560")[int(rng.integers(3))])
    least = 4.0 if name == "tracker-range" else TOOLS[name][1]
    size = float(rng.uniform(1, 2)) * least
    (effect,) = diagnose_shifted(arm, rng, name, size).effects
    assert effect.candidate.label == name
    assert effect.claim is not None
    assert effect.claim.levels[LEVELS.index("cause")] >= PROVEN
    # a payload's whole droop, across and along
    assert effect.estimate[0] == pytest.approx(size, abs=5 * effect.standard_error[0])
    if name == "payload-droop":
        assert effect.estimate[1] == pytest.approx(size / 3, abs=5 * effect.standard_error[1])


@pytest.mark.slow
@seeds(1, 2)
def test_what_is_even_about_the_reference_temperature_is_found(rng: np.random.Generator) -> None:
    arm = load_robot(("ur5e", "irb120", "puma560")[int(rng.integers(3))])
    q = arm.draw(rng, ROWS)
    celsius = rng.uniform(12, 28, ROWS)
    joint = int(rng.integers(2, 4))
    turned = q.copy()
    turned[:, joint - 1] += rng.uniform(1e-5, 3e-5) * (celsius - 20) ** 2
    flange = flanges_of(arm, turned)
    position = flange[:, :3, 3] + flange[:, :3, :3] @ np.array(OFF_AXIS)
    measured = position + rng.normal(0, NOISE_MM, position.shape)
    at = bind(arm, build_measurements(q, measured, covariates={"temperature_C": celsius}))
    base = Model((mechanism("geometric", arm),))
    effects = search_separated(at, base, build_candidates(at, base, every(arm))).effects
    assert effects[0].candidate.mechanism.names() == {"temperature_C"}
    assert {screw.frame for t in effects[0].candidate.mechanism.terms for screw in t.screws} == {
        joint
    }


def test_weight_loads_the_base_and_bearings_of_an_arm_whose_joints_it_does_not_turn(
    tmp_path: Path,
) -> None:
    rows = ["d_mm = 350, a_mm = 325", "a_mm = 275, alpha_deg = 180", "d_mm = 120", "d_mm = 30"]
    joints = [f"[[joint]]\ndh = {{ theta_deg = 0, {row} }}\n" for row in rows]
    joints[2] += 'kind = "prismatic"\n'
    text = 'name = "scara"\ngravity = [0, 0, -1]\nconvention = "standard"\n' + "".join(joints)
    (tmp_path / "robot.toml").write_text(text, encoding="utf-8")
    arm = load_robot(tmp_path / "robot.toml")
    assert find_gravity_joints(arm) == ()
    assert find_bearing_joints(arm) == (1, 2)
    assert {m.name for m in build_mechanisms("base-tilt", arm)} == {"base-tilt"}
    bearings = build_mechanisms("lateral-compliance", arm)
    assert {m.name for m in bearings} == {"lateral-compliance:1", "lateral-compliance:2"}
    for other in ("ur5e", "puma760"):
        arm = load_robot(other)
        assert find_bearing_joints(arm) == find_gravity_joints(arm)


def test_masses_that_hang_on_a_joint_pull_one_way() -> None:
    arm = load_robot("puma560")
    assert all(term.sign == 1 for term in joint_compliance(arm, 3, 1).terms)


def test_units_of_powers_are_written_as_such() -> None:
    assert ratio("mm", "°C °C") == "mm/°C²"
    assert ratio("rad", "N m N m") == "rad/(N² m²)"
    assert ratio("mm", "mm mm") == "1/mm"
