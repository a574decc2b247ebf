"""Gravity on the nominal chain: torque about every joint, moment on the base, and the joints that
gravity loads.

Masses are the robot file's; where it has none, 1 kg at each later frame's origin and at the target.
g = 9.81 m/s²."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._typing import Array
from .kinematics import Pose, Robot, cross_product, pose, rotate_frame

G = 9.81
# m of lever: a torque that changes by less than 1 kg on this lever does not change
NEGLIGIBLE_LEVER = 1e-6
# mm: a shorter lever tells no direction
MIN_LEVER = 50.0
# cosine between axes, or mm of motion: less is none
STILL = 1e-6
# mm in the flange frame: a target to look at gravity with
PROBE_TOOL = np.array([0.0, 0.0, 100.0])


def place_masses(robot: Robot, at: Pose, q: Array) -> tuple[Array, Array]:
    """Return masses (b,) [kg] and their positions (b, 3, m) [mm, frame 0]; body k moves with joint
    k, the last is the target."""
    if any(joint.mass for joint in robot.joints):
        masses = np.array([joint.mass or 0.0 for joint in robot.joints])
        positions = [_centre_of_mass(robot, at, q, k) for k in range(robot.n)]
        return masses, np.stack(positions)
    return np.ones(robot.n), np.concatenate([at.origins[1 : robot.n], at.target[None]])


def _centre_of_mass(robot: Robot, at: Pose, q: Array, k: int) -> Array:
    """Locate the centre of mass (3, m) [mm, frame 0] of the link that joint k (0-based) moves."""
    joint = robot.joints[k]
    R = at.axes[k, :3].transpose(1, 0, 2)
    origin = at.origins[k]
    if joint.prismatic:
        origin = origin + R[:, 2] * q[:, k]
    else:
        R = rotate_frame(R, 2, q[:, k])
    return np.asarray(origin + np.einsum("ijm,j->im", R, np.array(joint.com)))


def compute_joint_moments(robot: Robot, at: Pose, q: Array) -> Array:
    """Compute the moment of the weight beyond each joint about the x, y, z axes of its frame, (n,
    3, m) [N m]; about z (a slide: the force along z [N]) it is the joint's gravity torque."""
    masses, positions = place_masses(robot, at, q)
    direction = np.array(robot.gravity)[:, None]
    moments = np.empty((robot.n, 3, len(q)))
    for j, joint in enumerate(robot.joints):
        weight = masses[j:, None, None] * G * direction
        levers = (positions[j:] - at.origins[j]) / 1e3
        total = _sum_of_moments(levers, weight)
        moments[j] = np.einsum("aim,im->am", at.axes[j, :3], total)
        if joint.prismatic:
            moments[j, 2] = (at.axes[j, 2] * weight.sum(0)).sum(0)
    return moments


def _sum_of_moments(levers: Array, weights: Array) -> Array:
    """Sum the moments (3, m) of weights (b, 3, 1) at levers (b, 3, m)."""
    forces = np.broadcast_to(weights, levers.shape)
    moments = cross_product(levers.transpose(1, 0, 2), forces.transpose(1, 0, 2))
    return np.asarray(moments.sum(1))


def compute_joint_torques(robot: Robot, at: Pose, q: Array) -> Array:
    """Compute the gravity torque about each joint's axis, (n, m) [N m] (force [N] along the axis of
    a prismatic joint)."""
    return np.asarray(compute_joint_moments(robot, at, q)[:, 2])


def compute_unit_moments(robot: Robot, at: Pose) -> dict[tuple[int, int], Array]:
    """Compute (joint, frame) -> (3, m) moment about the joint's x, y, z axes of 1 kg at a later
    frame's origin (n+1: the target) [N m/kg]; about z (a slide: the force along z [N/kg]) it is the
    gravity torque."""
    bodies = np.concatenate([at.origins[: robot.n], at.target[None]])
    pull = np.broadcast_to(G * np.array(robot.gravity)[:, None], at.target.shape)
    moments = {}
    for j, joint in enumerate(robot.joints):
        for k in range(j + 1, robot.n + 1):
            lever = (bodies[k] - at.origins[j]) / 1e3
            moment = np.einsum("aim,im->am", at.axes[j, :3], cross_product(lever, pull))
            if joint.prismatic:
                moment[2] = (at.axes[j, 2] * pull).sum(0)
            moments[j + 1, k + 1] = moment
    return moments


def compute_base_moment(robot: Robot, at: Pose, q: Array) -> Array:
    """Compute the moment of the whole arm's weight about frame 0's origin, (3, m) [N m]."""
    masses, positions = place_masses(robot, at, q)
    weights = masses[:, None, None] * G * np.array(robot.gravity)[None, :, None]
    return _sum_of_moments(positions / 1e3, weights)


def _draw_sample(robot: Robot) -> tuple[Array, Pose]:
    """Draw joint readings (64, n) within the limits, the same every time, and their pose."""
    q = robot.draw(np.random.default_rng(0), 64)
    return q, pose(robot, q, PROBE_TOOL)


def find_gravity_joints(robot: Robot) -> tuple[int, ...]:
    """Find the revolute joints (1-based) whose gravity torque changes with the configuration; none
    where gravity is not known."""
    if robot.gravity is None:
        return ()
    q, at = _draw_sample(robot)
    spread = np.ptp(compute_joint_torques(robot, at, q), axis=1)
    changing = spread > NEGLIGIBLE_LEVER * G
    joints = enumerate(robot.joints, 1)
    return tuple(j for j, joint in joints if changing[j - 1] and not joint.prismatic)


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


def _find_phase(lever: Array) -> tuple[float, int]:
    """Find phase in (-π/2, π/2] and sign of A cos(q + phase) from its values at q = 0 and π/2."""
    phase, sign = float(np.arctan2(-lever[1], lever[0])), 1
    if not -np.pi / 2 + 1e-9 < phase <= np.pi / 2 + 1e-9:
        phase, sign = phase + (-np.pi if phase > 0 else np.pi), -1
    return (0.0 if abs(phase) < 1e-9 else phase), sign


def _fixed_frames_beyond(robot: Robot, joint: int) -> list[int]:
    """List the frames (0-based) beyond a joint whose origins later joints do not move, the farthest
    first: the wrist's centre, and not an offset on the way to it; then every frame beyond it."""
    q = robot.draw(np.random.default_rng(1), 8)
    q[:, : joint + 1] = 0.0
    origins = pose(robot, q, PROBE_TOOL).origins
    motion = np.ptp(origins, axis=2).max(axis=1)
    fixed = [k for k in range(joint + 1, robot.n) if motion[k] < STILL]
    return [*reversed(fixed), *range(joint + 1, robot.n + 1)]


def find_arm_pair(robot: Robot) -> ArmPair | None:
    """Find the first two successive joints that stay horizontal and parallel (shoulder and elbow);
    None where there are none."""
    if robot.gravity is None:
        return None
    _, at = _draw_sample(robot)
    direction = np.array(robot.gravity)[:, None]
    horizontal = [
        not joint.prismatic and np.abs((at.axes[j, 2] * direction).sum(0)).max() < STILL
        for j, joint in enumerate(robot.joints)
    ]
    for j in range(robot.n - 1):
        if not (horizontal[j] and horizontal[j + 1]):
            continue
        cosine = (at.axes[j, 2] * at.axes[j + 1, 2]).sum(0)
        parallel = np.ptp(cosine) < STILL and abs(abs(cosine[0]) - 1) < STILL
        if parallel and (pair := _measure_pair(robot, j, round(float(cosine[0])))) is not None:
            return pair
    return None


def _measure_pair(robot: Robot, j: int, parallel: int) -> ArmPair | None:
    """Measure the levers of upper arm and forearm beyond joint j (0-based) at two of its angles, 0
    and 90°; None where one is too short."""
    q = np.zeros((2, robot.n))
    q[1, j] = np.pi / 2
    at = pose(robot, q, PROBE_TOOL)
    origins = np.concatenate([at.origins[: robot.n], at.target[None]])
    pull = np.broadcast_to(np.array(robot.gravity)[:, None], at.target.shape)

    def lever(start: int, end: int) -> Array:
        moment = cross_product(origins[end] - origins[start], pull)
        return np.asarray((at.axes[j, 2] * moment).sum(0))

    near = lever(j, j + 1)
    candidates = (lever(j + 1, k) for k in _fixed_frames_beyond(robot, j + 1))
    far = next((levers for levers in candidates if np.hypot(*levers) > MIN_LEVER), None)
    if far is None or np.hypot(*near) < MIN_LEVER:
        return None
    near_phase, near_sign = _find_phase(near)
    far_phase, far_sign = _find_phase(far)
    return ArmPair(j + 1, j + 2, parallel, near_phase, far_phase, near_sign, far_sign)
