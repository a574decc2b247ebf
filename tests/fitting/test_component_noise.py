"""Noise of orientations against that of positions: told beside what the errors share, and whatever
effects hid it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import OFF_AXIS, bind, seeds

from modelsel._typing import Array
from modelsel.config.study_file import parse_study
from modelsel.fitting.component_noise import POSITION, ROTATION, compare_noise, scale_noise
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.noise import weigh
from modelsel.fitting.possible_parts import list_parts
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Robot, pose
from modelsel.robot.rigid import rotation_matrix
from modelsel.study.pipeline.pipeline import analyse

ARM = load_robot("puma760")
NOISE_MM = 0.05


def measure(robot: Robot, q: Array, moved: Array, rng: np.random.Generator, rad: float) -> Problem:
    """Readings `q` of an arm whose joints are at `moved`: its full poses, with noise."""
    at = pose(robot, moved, np.array(OFF_AXIS))
    position = at.target.T + rng.normal(0, NOISE_MM, (len(q), 3))
    rotation = at.rotation.transpose(2, 0, 1)
    for axis, angle in enumerate(rng.normal(0, rad, (3, len(q)))):
        rotation = rotation @ rotation_matrix(axis, angle)
    return bind(robot, replace(build_measurements(q, position), rotation=rotation))


@seeds(1, slow=(2, 3))
def test_the_scales_are_told_beside_a_joint_that_does_not_repeat(rng: np.random.Generator) -> None:
    q = ARM.draw(rng, 150)
    loose = rng.integers(1, 6)
    moved = q.copy()
    moved[:, loose] += rng.normal(0, 3e-4, len(q))
    rad = float(np.exp(rng.uniform(np.log(3e-5), np.log(1e-3))))
    factor = float(np.exp(rng.uniform(-1.5, 1.5)))
    at, _ = weigh(measure(ARM, q, moved, rng, rad), None, NOISE_MM, rad / factor)
    everywhere = np.ones(len(at), bool)
    fitted = fit(at, Model((mechanism("geometric", ARM),)))
    parts = list_parts(at, everywhere)
    assert compare_noise(at, everywhere, fitted, parts) == pytest.approx(factor, rel=0.2)
    for components, change in ((ROTATION, factor), (POSITION, 1 / factor)):
        right = scale_noise(at, components, change)
        assert compare_noise(right, everywhere, fitted, parts) == pytest.approx(1, rel=0.2)


STUDY = f"""
name = "full poses"
[robot]
name = "puma760"
tool_mm = {list(OFF_AXIS)}
[measurements]
file = "none.csv"
[split]
estimation = 110
[model]
candidates = ["encoder-eccentricity", "gear-eccentricity"]
"""


@pytest.mark.slow
@seeds(4, 5)
@pytest.mark.parametrize("rad", [5e-5, 1e-3])
def test_an_effect_that_hid_the_noise_leaves_no_part(rng: np.random.Generator, rad: float) -> None:
    """White noise, every joint repeats: what the base leaves of an uneven joint is no measure of
    either noise."""
    q = ARM.draw(rng, 140)
    moved = q.copy()
    joint = int(rng.integers(1, 4))
    moved[:, joint] += 1.5e-3 * np.sin(q[:, joint])
    at = measure(ARM, q, moved, rng, rad)
    result = analyse(parse_study(STUDY, "study.toml"), ARM, at.data)
    instrument, *others = result.run.diagnosis.search.errors.parts
    assert [part.name for part in others] == []
    assert 0.8 * instrument.low < NOISE_MM < 1.25 * instrument.high
