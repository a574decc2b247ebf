"""Payloads that hang anywhere on the flange of an arm whose joints yield, by exact kinematics."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from modelsel._typing import Array
from modelsel.robot.kinematics import Robot

TOOL = np.array([40.0, -25.0, 110.0])
WEIGHT = np.array([0.0, 0.0, -9.81])


def chain(arm: Robot, q: Array) -> list[Array]:
    """The poses (m, 4, 4) of every joint's frame once it has turned, and of the flange."""
    pose = np.tile(np.eye(4), (len(q), 1, 1))
    poses = []
    for joint, angle in zip(arm.joints, q.T, strict=True):
        turn = np.tile(np.eye(4), (len(q), 1, 1))
        turn[:, :3, :3] = Rotation.from_rotvec(angle[:, None] * [0.0, 0.0, 1.0]).as_matrix()
        pose = pose @ joint.before @ turn
        poses.append(pose)
    return [*poses, pose @ arm.last]


def place(pose: Array, where: Array) -> Array:
    """Where a point of a frame is (m, 3)."""
    return np.asarray(pose[:, :3, :3] @ where + pose[:, :3, 3])


def wind_up(arm: Robot, joints: list[int], q: Array, payload: Array, hangs: Array) -> Array:
    """The readings of an arm whose joints yield to a payload, each by 0.02 rad at most."""
    poses = chain(arm, q)
    at = place(poses[-1], hangs)
    wound = q.copy()
    for joint in joints:
        own = poses[joint - 1]
        moment = np.cross((at - own[:, :3, 3]) / 1e3, payload[:, None] * WEIGHT)
        torque = np.einsum("mi,mi->m", moment, own[:, :3, 2])
        wound[:, joint - 1] += 2e-3 * torque / np.abs(torque).max()
    return wound
