"""What a tool does on the flange acts along the last joint's axis and across it, along whichever axis of
the flange's frame that lies."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from builders import bind
from exact import flanges_of
from scipy.spatial.transform import Rotation

from modelsel.diagnosis.rivals.tool_falls import DIRECTIONS, build_fall
from modelsel.fitting.design import compute_design
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import build_mechanisms
from modelsel.mechanisms.terms import Mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Robot, find_flange_axis

TOOL = np.array([60.0, -45.0, 185.0])
DOWN = np.array([0.0, 0.0, -1.0])
# the flange's frame as URDF files have it, its axis along x or y, and one that is askew
FRAMES = {
    "z": Rotation.identity(),
    "x": Rotation.from_euler("y", -90, degrees=True),
    "-y": Rotation.from_euler("x", -90, degrees=True),
    "askew": Rotation.from_rotvec([0.4, -0.7, 0.3]),
}


def turn_flange(arm: Robot, turn: Rotation) -> Robot:
    """The same arm with another frame on its flange."""
    frame = np.eye(4)
    frame[:3, :3] = turn.as_matrix()
    return replace(arm, last=arm.last @ frame)


def displace(arm: Robot, mechanism: Mechanism, q: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """The target's displacement (m, 3) by one unit of a mechanism of one term, 1 kg of payload."""
    columns = {"payload_kg": np.ones(len(q))}
    data = build_measurements(q, np.zeros((len(q), 3)), covariates=columns)
    at = bind(arm, data, tuple(tool))
    return np.asarray(compute_design(at, mechanism.terms[:1])[0].reshape(len(q), 3))


def draw(rng: np.random.Generator, turn: Rotation) -> tuple[Robot, np.ndarray, np.ndarray]:
    """An arm, its target in its flange's frame, and configurations."""
    arm = turn_flange(load_robot("ur5e"), turn)
    return arm, turn.inv().apply(TOOL), arm.draw(rng, 30)


@pytest.mark.parametrize("frame", FRAMES)
def test_a_tool_droops_across_the_axis_of_the_last_joint(
    frame: str, rng: np.random.Generator
) -> None:
    arm, tool, q = draw(rng, FRAMES[frame])
    axis = flanges_of(load_robot("ur5e"), q)[:, :3, 2]
    along = (axis @ DOWN)[:, None] * axis
    expected = {
        "tool-droop": DOWN - along,
        "tool-stretch": along,
        "tool-play": np.sign(axis @ DOWN)[:, None] * axis,
        "payload-droop": DOWN - along,
    }
    for name, moved in expected.items():
        mechanism, *_ = build_mechanisms(name, arm)
        np.testing.assert_allclose(displace(arm, mechanism, q, tool), moved, atol=1e-4)


@pytest.mark.parametrize("frame", FRAMES)
def test_a_tool_turns_by_the_moment_of_a_weight_at_the_target(
    frame: str, rng: np.random.Generator
) -> None:
    arm, tool, q = draw(rng, FRAMES[frame])
    _, bending = build_mechanisms("tool-droop", arm)
    lever = flanges_of(arm, q)[:, :3, :3] @ tool
    moment = np.cross(lever / 1e3, 9.81 * DOWN)
    np.testing.assert_allclose(
        displace(arm, bending, q, tool), np.cross(moment, lever), rtol=1e-4, atol=1e-6
    )


@pytest.mark.parametrize("frame", FRAMES)
def test_a_tool_falls_to_either_side_of_lines_across_the_axis(
    frame: str, rng: np.random.Generator
) -> None:
    arm, tool, q = draw(rng, FRAMES[frame])
    axis = flanges_of(load_robot("ur5e"), q)[:, :3, 2]
    lines = []
    for degrees in DIRECTIONS[::6]:
        fall = build_fall(arm.n + 1, find_flange_axis(arm), degrees)
        moved = displace(arm, fall, q, tool)
        np.testing.assert_allclose(np.linalg.norm(moved, axis=1), 1, atol=1e-4)
        np.testing.assert_allclose(np.sum(moved * axis, axis=1), 0, atol=1e-4)
        assert np.all(moved @ DOWN > 0)
        lines.append(np.einsum("mij,mi->mj", flanges_of(arm, q)[:, :3, :3], moved)[0])
    cosines = np.abs([one @ other for one, other in pairwise(lines)])
    np.testing.assert_allclose(cosines, np.cos(np.radians(30)), atol=1e-4)
