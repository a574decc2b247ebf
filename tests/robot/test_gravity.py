"""Gravity on the chain: published torques, the slope of the potential, levers of the arm pair, tilt
of the base."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import bind, drawn

from modelsel.fitting.design import compute_design
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import build_mechanisms, mechanism
from modelsel.robot.files import builtin_names, load_robot, robot_from_table
from modelsel.robot.gravity import (
    G,
    compute_base_moment,
    compute_joint_torques,
    find_arm_pair,
    find_gravity_joints,
    find_payload_joints,
)
from modelsel.robot.kinematics import Robot, forward, pose
from modelsel.robot.rigid import rotation_matrix, transform


def test_puma560_published_gravity_load() -> None:
    """robotics-toolbox-python, tests/test_DHRobot.py: gravload(qn); the actuators' torque, the
    weight's with the other sign."""
    robot, q = load_robot("puma560"), np.radians([[0, 45, 180, 0, 45, 0]])
    found = compute_joint_torques(robot, pose(robot, q, np.zeros(3)), q)[:, 0]
    np.testing.assert_allclose(-found, [0, 31.6399, 6.0351, 0, 0.0283, 0], atol=5e-5)


@pytest.mark.parametrize("name", builtin_names())
def test_torque_is_the_slope_of_the_potential(name, rng) -> None:
    """dU/dq of the masses of the robot file, or 1 kg at each later frame's origin and the target:
    own sum."""
    at = drawn(name, rng, 4)
    robot, q, tool = at.robot, at.data.q, at.tools[0]
    given = any(j.mass for j in robot.joints)

    def potential(q: np.ndarray, first: int) -> np.ndarray:
        frames = pose(robot, q, tool)
        if not given:
            bodies = [(1.0, frames.origins[k]) for k in range(first + 1, robot.n)] + [
                (1.0, frames.target)
            ]
        else:
            bodies = [
                (
                    j.mass or 0.0,
                    np.stack([(exact_frame(robot, x, k) @ [*j.com, 1])[:3] for x in q], 1),
                )
                for k, j in enumerate(robot.joints)
            ]
        return sum(m * G * np.array(robot.gravity) @ p / 1e3 for m, p in bodies)

    found = compute_joint_torques(robot, pose(robot, q, tool), q)
    for k in range(robot.n):
        step = np.eye(robot.n)[k] * 1e-5
        np.testing.assert_allclose(
            found[k], (potential(q + step, k) - potential(q - step, k)) / 2e-5, atol=1e-6
        )


def exact_frame(robot: Robot, q: np.ndarray, last: int) -> np.ndarray:
    T = np.eye(4)
    for joint, value in list(zip(robot.joints, q, strict=True))[: last + 1]:
        T = T @ joint.before @ transform(rotation_matrix(2, value))
    return T


def test_which_joints_lie_under_gravity() -> None:
    assert find_gravity_joints(load_robot("puma760")) == (
        2,
        3,
        4,
        5,
    )  # joint 1 is vertical, joint 6 has the target on its axis
    assert find_arm_pair(load_robot("iiwa14")) is None  # no two successive joints stay parallel


def test_a_payload_beside_the_last_axis_loads_the_last_joint() -> None:
    """The masses of the arm's own joint 6 lie on its axis, those on its flange may not."""
    robot = load_robot("irb1600")
    assert find_gravity_joints(robot) == (2, 3, 4, 5)
    assert find_payload_joints(robot) == (2, 3, 4, 5, 6)
    mechanism("payload-deflection:6", robot)
    # a tool may hang there that the file's masses leave out
    built = build_mechanisms("joint-compliance:6", load_robot("ur5e"))
    symbols = [[term.symbol for term in one.terms] for one in built]
    assert symbols == [["c6"], ["c6m7"], ["c6"]]
    assert ["payload_kg" in one.names() for one in built] == [False, False, True]
    turned = replace(robot, gravity=None)
    assert find_payload_joints(turned) == ()


def test_arm_pair_of_the_paper() -> None:
    """h1..h4's causes on the paper's arm, from chain and gravity alone."""
    terms = {
        t.symbol: t.screws
        for name in ("joint2-twist", "joint3-twist", "backlash:3")
        for t in mechanism(name, load_robot("puma760")).terms
    }
    assert [str(s[0]) for s in terms.values()] == [
        "frame 2 rz · cos(q2+q3)",
        "frame 2 rz · cos(q2)",
        "frame 3 rz · cos(q2+q3)",
        "frame 3 rz · sign(cos(q2+q3))",
    ]


@pytest.mark.parametrize("flip", [1, -1], ids=["parallel", "antiparallel"])
@pytest.mark.parametrize("turned", [0, 40, 200], ids=lambda v: f"zero{v}deg")
def test_twist_follows_the_load_of_any_planar_arm(flip, turned, rng) -> None:
    """A mass at the wrist alone: the twists' causes are its levers, and with positive compliance
    their sign is physics'."""
    robot = robot_from_table(
        {
            "gravity": [0, 0, -1],
            "joint": [
                {"xyz_mm": [0, 0, 300], "axis": [0, 0, 1]},
                {"xyz_mm": [0, 0, 100], "rpy_deg": [0, turned, 0], "axis": [0, 1, 0]},
                {"xyz_mm": [600, 0, 0], "axis": [0, flip, 0]},
                {"xyz_mm": [500, 0, 0], "axis": [1, 0, 0], "mass_kg": 1.0, "com_mm": [0, 0, 0]},
            ],
        },
        "planar.toml",
    )
    q = rng.uniform(-3, 3, (40, 4))
    at = bind(robot, build_measurements(q, forward(robot, q, np.zeros(3))), (0, 0, 0))
    shoulder, elbow = mechanism("joint2-twist", robot), mechanism("joint3-twist", robot)
    upper, fore = compute_joint_torques(robot, pose(robot, q, np.zeros(3)), q)[1:3]
    h1, h2 = (t.sign * t.screws[0].cause.of(at) for t in shoulder.terms)
    (h3,) = (t.sign * t.screws[0].cause.of(at) for t in elbow.terms)
    np.testing.assert_allclose(upper, G * (0.5 * h1 + 0.6 * h2), atol=1e-9)
    np.testing.assert_allclose(fore, G * 0.5 * h3, atol=1e-9)


@pytest.mark.parametrize("name", ["puma760", "irb120", "ur10"])
def test_base_tilt_turns_frame_0_about_its_origin(name, rng) -> None:
    """Whatever stands between frame 0 and joint 1, the columns are moment * (axis x target)."""
    at = drawn(name, rng, 10)
    tilt = mechanism("base-tilt", at.robot)
    columns = compute_design(at, tilt.terms)[0]
    M = compute_base_moment(at.robot, at.pose(slice(None)), at.data.q)
    for k in range(2):
        np.testing.assert_allclose(
            columns[:, :, k], M[k][:, None] * np.cross(np.eye(3)[k], at.data.position), atol=1e-6
        )


@pytest.mark.parametrize("down", [(0.0, 0.0, -1.0), (0.6, 0.0, -0.8), (-1.0, 0.0, 0.0)])
def test_payload_tilt_turns_frame_0_with_the_moment_of_the_load(down, rng) -> None:
    """Standing, leaning and on a wall: the columns are kilograms times (lever x down) about the
    axis, times (axis x target)."""
    at = drawn("ur10", rng, 10)
    at = replace(at, robot=replace(at.robot, gravity=down))
    tilt = mechanism("payload-tilt", at.robot)
    columns = compute_design(at, tilt.terms)[0]
    moved = at.data.covariates["payload_kg"][:, None] * np.cross(at.data.position, down)
    for k, term in enumerate(tilt.terms):
        axis = "xyz".index(term.symbol[1])
        wanted = moved[:, axis, None] * np.cross(np.eye(3)[axis], at.data.position)
        np.testing.assert_allclose(columns[:, :, k], wanted, atol=1e-6)
        assert term.unit == "rad/(kg mm)"
    assert len(tilt.terms) == 3 - (1.0 in np.abs(down))
