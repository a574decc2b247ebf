"""One error of the geometry that stands out is told: a zero that moved, planted by the exact chain among small
errors of all links; where none stands out, nothing is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import OFF_AXIS, bind, seeds
from exact import flanges_of
from scipy.spatial.transform import Rotation

from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import Fit, fit
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.geometry import build_setup
from modelsel.mechanisms.registry import mechanism
from modelsel.results.conclusions.largest_geometric_error import describe_largest_error
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Robot
from modelsel.robot.rigid import transform

NOISE_MM, ROWS = 0.03, 100
LINK_MM, LINK_RAD = 0.05, 1e-4


def fit_arm(robot: Robot, rng: np.random.Generator, zero: np.ndarray, size: float) -> Fit:
    """Fit the geometry to an arm whose links are a bit off, `size` times the usual, and its joints' zeros, measured
    by a tracker that stands anywhere."""
    joints = []
    for joint in robot.joints:
        turn = Rotation.from_rotvec(rng.normal(0, size * LINK_RAD, 3)).as_matrix()
        joints.append(
            replace(joint, before=joint.before @ transform(turn, rng.normal(0, size * LINK_MM, 3)))
        )
    arm = replace(robot, joints=tuple(joints))
    return fit_measured(robot, arm, robot.draw(rng, ROWS), zero, rng)


def fit_measured(
    robot: Robot, arm: Robot, q: np.ndarray, zero: np.ndarray, rng: np.random.Generator
) -> Fit:
    """Fit the geometry to what a tracker that stands anywhere measures of an arm whose joints' zeros are off."""
    flange = flanges_of(arm, q + zero)
    x = flange[:, :3, 3] + flange[:, :3, :3] @ np.array(OFF_AXIS)
    at = bind(robot, build_measurements(q, x + rng.normal(0, NOISE_MM, x.shape)))
    setup = build_setup(robot, 1, 1, True, False)
    return fit(at, Model((setup, mechanism("geometric", robot))))


@seeds(1, 2, slow=(3, 4, 5))
@pytest.mark.parametrize("name", ["irb120", "puma760"])
def test_a_zero_that_moved_is_told_with_its_size(name: str, rng: np.random.Generator) -> None:
    robot = load_robot(name)
    joint = int(rng.integers(2, 4))
    moved = rng.choice([-1.0, 1.0]) * rng.uniform(3e-3, 6e-3)
    zero = np.zeros(robot.n)
    zero[joint - 1] = moved
    said = describe_largest_error(fit_arm(robot, rng, zero, 1.0), robot)
    assert said is not None
    told, _, rest = said.partition(f"the zero of joint {joint} is off by about ")
    assert told.startswith("One error takes ")
    assert f" mrad (γ{joint})." in rest
    assert float(rest.split()[0]) == pytest.approx(1e3 * moved, rel=0.25)


@seeds(1, 2)
@pytest.mark.parametrize("name", ["irb120", "puma760"])
def test_errors_of_all_links_have_none_that_stands_out(name: str, rng: np.random.Generator) -> None:
    robot = load_robot(name)
    fitted = fit_arm(robot, rng, rng.normal(0, 5e-4, robot.n), 5.0)
    assert describe_largest_error(fitted, robot) is None


def test_what_explains_it_nearly_as_well_is_told(rng: np.random.Generator) -> None:
    """Axes 2, 3 and 4 of this arm are parallel: a zero of joint 3 resembles others where the arm hardly turns
    at the joints beyond it."""
    robot = load_robot("ur10e")
    zero = np.array([0, 0, 4e-3, 0, 0, 0])
    q = np.tile(robot.draw(rng, 1), (ROWS, 1)) + rng.normal(0, 0.25, (ROWS, robot.n))
    said = describe_largest_error(fit_measured(robot, robot, q, zero, rng), robot)
    assert said is not None
    assert "γ3" in said


def test_one_error_of_data_without_noise_is_all_of_it(rng: np.random.Generator) -> None:
    robot = load_robot("irb120")
    q = robot.draw(rng, ROWS)
    zero = np.array([0, 2e-4, 0, 0, 0, 0])
    at = bind(robot, build_measurements(q, flanges_of(robot, q + zero)[:, :3, 3]), (0, 0, 0))
    said = describe_largest_error(fit(at, Model((mechanism("geometric", robot),))), robot)
    assert said is not None
    assert "100 %" in said
    assert "the zero of joint 2 is off by about 0.20 mrad" in said


@pytest.mark.parametrize("names", [[], ["encoder-scale:2"]], ids=["nominal", "scale"])
def test_a_model_without_geometry_says_nothing(names: list[str], rng: np.random.Generator) -> None:
    robot = load_robot("irb120")
    q = robot.draw(rng, ROWS)
    at = bind(robot, build_measurements(q, flanges_of(robot, q)[:, :3, 3]))
    model = Model(tuple(mechanism(name, robot) for name in names))
    assert describe_largest_error(fit(at, model), robot) is None
