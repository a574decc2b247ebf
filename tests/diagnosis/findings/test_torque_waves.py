"""Of a joint whose gravity torque is a wave once a turn an uneven gear and wind-up are told as one, planted in
exact positions, by masses times levers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders import bind, seeds
from exact import flanges_of
from searches import search_separated

from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.findings.effect_sentences import describe_effect
from modelsel.diagnosis.findings.torque_waves import find_mixed_joint
from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.compliance import DECLARED, UNKNOWN
from modelsel.mechanisms.registry import build_mechanisms, every, mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Robot

NOISE_MM = 0.02
ROWS = 90
TOOL = np.array([60.0, -50.0, 80.0])
# places, axes, masses [kg] and their centres along the level arm that joint 2 carries [mm]
LINKS = [
    ([0, 0, 400], [0, 0, 1], 8.0, 0.0),
    ([0, 0, 0], [0, 1, 0], 5.0, 250.0),
    ([500, 0, 0], [1, 0, 0], 2.0, 60.0),
]
TOLD = (
    "the gravity torque about joint 2 goes once a turn, too: what joint 2 turns unevenly and what"
)


@pytest.fixture
def arm(tmp_path: Path) -> Robot:
    """An arm whose level joint 2 stands on an upright one, and whose third turns about its own weight."""
    lines = ['name = "nodding"', 'source = "drawing"', "gravity = [0, 0, -1]"]
    for place, axis, mass, ahead in LINKS:
        # the frame of joint 2 has z along y of the base, that of joint 3 along x
        centre = [0, 0, ahead] if axis[0] else [ahead, 0, 0]
        lines += ["[[joint]]", f"xyz_mm = {place}", f"axis = {axis}", "limits_deg = [-150, 150]"]
        lines += [f"mass_kg = {mass}", f"com_mm = {centre}"]
    lines += ["[last]", "xyz_mm = [100, 0, 0]"]
    file = tmp_path / "robot.toml"
    file.write_text("\n".join(lines), encoding="utf-8")
    return load_robot(file)


def build_problem(arm: Robot, q: np.ndarray, seen: np.ndarray) -> Problem:
    return bind(arm, build_measurements(q, seen), TOOL)


@pytest.mark.slow
@seeds(1, 2)
def test_a_wave_with_wind_up_in_it_says_so(arm: Robot, rng: np.random.Generator) -> None:
    q = arm.draw(rng, ROWS)
    torque = -9.81 * (5.0 * 0.25 + 2.0 * 0.56) * np.cos(q[:, 1])
    turned = q.copy()
    turned[:, 1] += 3e-4 * np.sin(q[:, 1] + rng.uniform(0, 6)) + rng.uniform(1, 2) * 1e-5 * torque
    flange = flanges_of(arm, turned)
    seen = flange[:, :3, 3] + flange[:, :3, :3] @ TOOL + rng.normal(0, NOISE_MM, (ROWS, 3))
    at = build_problem(arm, q, seen)
    base = Model((mechanism("geometric", arm),))
    diagnosis = search_separated(at, base, build_candidates(at, base, every(arm)))
    told = [describe_effect(one) for one in diagnosis.effects]
    assert len(told) == 1
    assert TOLD in told[0]


@seeds(1)
def test_both_names_of_it_are_told(arm: Robot, rng: np.random.Generator) -> None:
    """And none of masses that are not known, nor of a joint whose torque another one changes."""
    q = arm.draw(rng, ROWS)
    at = build_problem(arm, q, np.zeros((ROWS, 3)))
    spring = build_mechanisms("joint-compliance:2", arm)
    assert find_mixed_joint(at, mechanism("gear-eccentricity:2", arm)) == 2
    assert find_mixed_joint(at, spring[DECLARED]) == 2
    assert find_mixed_joint(at, spring[UNKNOWN]) is None
    assert find_mixed_joint(at, mechanism("encoder-eccentricity:2", arm)) is None
    assert find_mixed_joint(at, mechanism("gear-eccentricity:1", arm)) is None
    joints = [*arm.joints[:2], replace(arm.joints[2], com=(0.0, 500.0, 60.0))]
    aside = replace(at, robot=replace(arm, joints=tuple(joints)))
    assert find_mixed_joint(aside, mechanism("gear-eccentricity:2", aside.robot)) is None
    two = load_robot("irb120")
    other = bind(two, build_measurements(two.draw(rng, ROWS), np.zeros((ROWS, 3))), TOOL)
    for name in ("gear-eccentricity:2", "gear-eccentricity:3", "joint-compliance:5"):
        assert find_mixed_joint(other, mechanism(name, two)) is None


@seeds(1)
def test_a_forearm_that_a_parallelogram_carries_is_both_without_masses(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    """The motors stand as the upper arm and the forearm do, level or upright, so that the weight of each goes
    once a turn of its motor; of an arm in series it does not."""
    places = [[0, 0, 600], [300, 0, 0], [0, 0, 1000], [200, 0, 200], [1000, 0, 0], [170, 0, 0]]
    axes = [[0, 0, 1], [0, 1, 0], [0, 1, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0]]
    coupling = np.eye(6)
    coupling[2, 1] = -1
    text = 'name = "six"\nsource = "drawing"\ngravity = [0, 0, -1]\n'
    joints = "".join(
        f"[[joint]]\nxyz_mm = {place}\naxis = {axis}\nlimits_deg = [-100, 100]\n"
        for place, axis in zip(places, axes, strict=True)
    )
    for coupled in (True, False):
        file = tmp_path / f"{coupled}.toml"
        file.write_text(text + f"coupling = {coupling.tolist()}\n" * coupled + joints)
        six = load_robot(file)
        q = six.draw(rng, ROWS)
        at = bind(six, build_measurements(q, np.zeros((ROWS, 3))), TOOL)
        for joint in (2, 3):
            found = find_mixed_joint(at, mechanism(f"gear-eccentricity:{joint}", six))
            assert found == (joint if coupled else None)
