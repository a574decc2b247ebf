"""What joints of an arm hold: its masses and a payload at the target, by masses times lever arms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from exact import flanges_of

from modelsel._typing import Array
from modelsel.robot.kinematics import Robot

WEIGHT = np.array([0.0, 0.0, -9.81])
# mm, on the flange
TOOL = np.array([60.0, -50.0, 80.0])
# kg
RATED = {"irb120": 3.0, "ur5e": 5.0, "ur10e": 12.0}


def frame_of(arm: Robot, joint: int, q: Array) -> Array:
    """The poses (m, 4, 4) of the link that a joint moves, which turns with it."""
    lower = replace(arm, joints=arm.joints[:joint], last=np.eye(4), coupling=None)
    return flanges_of(lower, q[:, :joint])


def place_of(frames: Array, point: Array) -> Array:
    return np.asarray(frames[:, :3, 3] + frames[:, :3, :3] @ point)


def torques_of(
    arm: Robot, joint: int, q: Array, payload: Array, tool: Array
) -> tuple[Array, Array]:
    """Torques (m,) about a joint [N m]: of the masses beyond it, and of a payload at the target."""
    at_joint = frame_of(arm, joint, q)
    origin, axis = at_joint[:, :3, 3], at_joint[:, :3, 2]
    own = np.zeros(len(q))
    for k in range(joint, arm.n + 1):
        link = arm.joints[k - 1]
        lever = place_of(frame_of(arm, k, q), np.array(link.com)) - origin
        moment = np.cross(lever / 1e3, (link.mass or 0.0) * WEIGHT)
        own += np.sum(moment * axis, axis=1)
    lever = place_of(flanges_of(arm, q), tool) - origin
    moment = np.cross(lever / 1e3, payload[:, None] * WEIGHT)
    return own, np.sum(moment * axis, axis=1)
