"""A base that rocks turns the arm about edges of its own, to the side that weight pulls."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import OFF_AXIS, bind
from scipy.spatial.transform import Rotation

from modelsel.fitting.design import compute_design
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.gravity_effects import EDGES, base_rocking, list_edges
from modelsel.mechanisms.registry import build_mechanisms
from modelsel.robot.files import load_robot
from modelsel.robot.gravity import compute_base_moment
from modelsel.robot.kinematics import forward, pose

GRAVITIES = [(0.0, 0.0, -1.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, -1.0, 0.0)]


@pytest.mark.parametrize("gravity", GRAVITIES)
@pytest.mark.parametrize("name", ["puma560", "irb1600"])
def test_each_edge_turns_the_arm_to_the_side_of_its_moment(
    name: str, gravity: tuple[float, float, float], rng: np.random.Generator
) -> None:
    """Every term is the rotation about a horizontal edge through frame 0, by the sign of the moment
    of the weight about it; the edges are at right angles."""
    robot = replace(load_robot(name), gravity=gravity)
    m = 40
    q = robot.draw(rng, m)
    target = forward(robot, q, np.array(OFF_AXIS))
    at = bind(robot, build_measurements(q, target))
    moment = compute_base_moment(robot, pose(robot, q, np.array(OFF_AXIS)), q)
    level = [np.eye(3)[axis] for axis in range(3) if not gravity[axis]]
    for degrees in EDGES:
        columns = compute_design(at, base_rocking(robot, degrees).terms)[0]
        moved = columns.reshape(m, 3, 2)
        turned = Rotation.from_rotvec(np.cross(level[0], level[1]) * np.radians(degrees))
        for k, edge in enumerate(turned.apply(level)):
            side = np.sign(edge @ moment)
            np.testing.assert_allclose(
                moved[:, :, k], side[:, None] * np.cross(edge, target), atol=1e-6
            )


def test_there_is_none_where_weight_tips_nothing() -> None:
    robot = load_robot("ur5e")
    assert list_edges(robot) == EDGES
    assert list_edges(replace(robot, gravity=None)) == ()
    assert build_mechanisms("base-rocking", replace(robot, gravity=None)) == ()
    assert len(build_mechanisms("base-rocking", robot)) == len(EDGES)
