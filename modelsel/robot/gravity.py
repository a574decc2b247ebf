"""Gravity on the nominal chain: torque about every joint, moment on the base, and which joints lie
under gravity.

Masses are the robot file's; where it has none, 1 kg at each later frame's origin and at the target.
g = 9.81 m/s²."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._typing import Array
from .kinematics import Pose, Robot, cross_product, pose, rotate_frame

G = 9.81
NEGLIGIBLE = 1e-6  # of a metre of lever


def place_masses(robot: Robot, at: Pose, q: Array) -> tuple[Array, Array]:
    """Masses (b,) [kg] and their positions (b, 3, m) [mm, frame 0]; body k moves with joint k, the
    last is the target."""
    if any(joint.mass for joint in robot.joints):
        positions = []
        for k, joint in enumerate(robot.joints):
            R, o = at.axes[k, :3].transpose(1, 0, 2), at.origins[k]
            o = o + R[:, 2] * q[:, k] if joint.prismatic else o
            R = R if joint.prismatic else rotate_frame(R, 2, q[:, k])
            positions.append(o + np.einsum("ijm,j->im", R, np.array(joint.com)))
        return np.array([joint.mass or 0.0 for joint in robot.joints]), np.stack(positions)
    return np.ones(robot.n), np.concatenate([at.origins[1 : robot.n], at.target[None]])


def compute_joint_moments(robot: Robot, at: Pose, q: Array) -> Array:
    """Moment of the weight beyond each joint about the x, y, z axes of its frame, (n, 3, m) [N m];
    about z (a slide: the force along z [N]) it is the joint's gravity torque."""
    mass, position = place_masses(robot, at, q)
    g = np.array(robot.gravity)[:, None]
    out = np.empty((robot.n, 3, len(q)))
    for j, joint in enumerate(robot.joints):
        weight = mass[j:, None, None] * G * g
        arm = (position[j:] - at.origins[j]) / 1e3
        total = cross_product(
            arm.transpose(1, 0, 2), np.broadcast_to(weight, arm.shape).transpose(1, 0, 2)
        ).sum(1)
        out[j] = np.einsum("aim,im->am", at.axes[j, :3], total)
        if joint.prismatic:
            out[j, 2] = (at.axes[j, 2] * weight.sum(0)).sum(0)
    return out


def compute_joint_torques(robot: Robot, at: Pose, q: Array) -> Array:
    """Gravity torque about each joint's axis, (n, m) [N m] (force [N] along the axis of a prismatic
    joint)."""
    return np.asarray(compute_joint_moments(robot, at, q)[:, 2])


def compute_unit_moments(robot: Robot, at: Pose) -> dict[tuple[int, int], Array]:
    """(joint, frame) -> (3, m) moment about the joint's x, y, z axes of 1 kg at a later frame's
    origin (n+1: the target) [N m/kg]; about z (a slide: the force along z [N/kg]) it is the gravity
    torque."""
    g = np.array(robot.gravity)[:, None]
    ends = np.concatenate([at.origins[: robot.n], at.target[None]])
    out = {}
    for j, joint in enumerate(robot.joints):
        for k in range(j + 1, robot.n + 1):
            pull = np.broadcast_to(G * g, ends[k].shape)
            out[j + 1, k + 1] = np.einsum(
                "aim,im->am", at.axes[j, :3], cross_product((ends[k] - at.origins[j]) / 1e3, pull)
            )
            if joint.prismatic:
                out[j + 1, k + 1][2] = (at.axes[j, 2] * pull).sum(0)
    return out


def compute_base_moment(robot: Robot, at: Pose, q: Array) -> Array:
    """Moment of the whole arm's weight about frame 0's origin, (3, m) [N m]."""
    mass, position = place_masses(robot, at, q)
    weight = mass[:, None, None] * G * np.array(robot.gravity)[None, :, None]
    return np.asarray(
        cross_product(
            position.transpose(1, 0, 2) / 1e3,
            np.broadcast_to(weight, position.shape).transpose(1, 0, 2),
        ).sum(1)
    )


def _sample(robot: Robot) -> tuple[Array, Pose]:
    q = robot.draw(np.random.default_rng(0), 64)
    return q, pose(robot, q, np.array([0.0, 0.0, 100.0]))


def find_gravity_joints(robot: Robot) -> tuple[int, ...]:
    """Revolute joints (1-based) whose gravity torque changes with the configuration; none where
    gravity is not known."""
    if robot.gravity is None:
        return ()
    q, at = _sample(robot)
    spread = np.ptp(compute_joint_torques(robot, at, q), axis=1)
    return tuple(
        j + 1
        for j in range(robot.n)
        if not robot.joints[j].prismatic and spread[j] > NEGLIGIBLE * G
    )


@dataclass(frozen=True)
class ArmPair:
    """Two successive horizontal parallel joints: torque of a far mass about the first ∝ cos(q_upper
    + near_phase) for the upper arm and cos(q_upper ± q_fore + far_phase) for the forearm;
    `parallel` is ±1; the signs are those of the torques."""

    upper: int
    fore: int
    parallel: int
    near_phase: float
    far_phase: float
    near_sign: int
    far_sign: int


def _phase(lever: Array) -> tuple[float, int]:
    """Phase in (-π/2, π/2] and sign of A cos(q + phase) from its values at q = 0 and π/2."""
    phase = float(np.arctan2(-lever[1], lever[0]))
    if phase <= -np.pi / 2 + 1e-9 or phase > np.pi / 2 + 1e-9:
        phase += -np.pi if phase > 0 else np.pi
        return (0.0 if abs(phase) < 1e-9 else phase), -1
    return (0.0 if abs(phase) < 1e-9 else phase), 1


def _fixed_behind(robot: Robot, joint: int) -> list[int]:
    """Frames (0-based) behind a joint whose origins later joints do not move, the farthest first:
    the wrist's centre, and not an offset on the way to it; then the next frame in any case."""
    q = robot.draw(np.random.default_rng(1), 8)
    q[:, : joint + 1] = 0.0
    origins = pose(robot, q, np.array([0.0, 0.0, 100.0])).origins
    still = [k for k in range(joint + 1, robot.n) if float(np.ptp(origins[k], axis=1).max()) < 1e-6]
    return [*sorted(still, key=lambda k: -k), *range(joint + 1, robot.n + 1)]


def find_arm_pair(robot: Robot) -> ArmPair | None:
    """The first two successive joints that stay horizontal and parallel (shoulder and elbow), or
    None."""
    if robot.gravity is None:
        return None
    _, at = _sample(robot)
    g = np.array(robot.gravity)[:, None]
    level = [
        not joint.prismatic and float(np.abs((at.axes[j, 2] * g).sum(0)).max()) < 1e-6
        for j, joint in enumerate(robot.joints)
    ]
    for j in range(robot.n - 1):
        along = (at.axes[j, 2] * at.axes[j + 1, 2]).sum(0)
        if not (
            level[j] and level[j + 1] and np.ptp(along) < 1e-6 and abs(abs(along[0]) - 1) < 1e-6
        ):
            continue
        probe = np.zeros((2, robot.n))
        probe[1, j] = np.pi / 2
        turned = pose(robot, probe, np.array([0.0, 0.0, 100.0]))
        ends = np.concatenate([turned.origins[: robot.n], turned.target[None]])
        axis = turned.axes[j, 2]

        def lever(a: Array, b: Array, axis: Array = axis) -> Array:
            return np.asarray((axis * cross_product(b - a, np.broadcast_to(g, a.shape))).sum(0))

        near = lever(ends[j], ends[j + 1])
        fixed = _fixed_behind(robot, j + 1)
        far = next((x for k in fixed if np.hypot(*(x := lever(ends[j + 1], ends[k]))) > 50.0), None)
        if far is None or np.hypot(*near) < 50.0:
            continue
        (near_phase, near_sign), (far_phase, far_sign) = _phase(near), _phase(far)
        return ArmPair(
            j + 1, j + 2, round(float(along[0])), near_phase, far_phase, near_sign, far_sign
        )
    return None
