"""Gravity on the nominal chain: torque about every joint, moment on the base, and the joints that
gravity loads.

Masses are the robot file's; where it has none, 1 kg at each later frame's origin and at the target
(the mean of several).
g = 9.81 m/s²."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

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
# and one beside the last joint's axis, as a payload may hang
PROBE_PAYLOAD = np.array([70.0, 50.0, 100.0])
# robots in play, of which what many mechanisms ask for is worked out once
REMEMBERED = 16


def declares_masses(robot: Robot) -> bool:
    """Return whether the robot file has the mass of a link."""
    return any(joint.mass for joint in robot.joints)


def declares_masses_beyond(robot: Robot, joint: int) -> bool:
    """Return whether the robot file has the mass of every link that a joint (from 1) carries, and these weigh
    something: what is missing there is missing in the torque about it."""
    carried = [one.mass for one in robot.joints[joint - 1 :]]
    return None not in carried and any(carried)


def place_masses(robot: Robot, at: Pose, q: Array) -> tuple[Array, Array]:
    """Return masses (b,) [kg] and their positions (b, 3, m) [mm, frame 0]; body k moves with joint
    k, the last is the target."""
    if not declares_masses(robot):
        frames = at.origins[1 : robot.n]
        target = at.target[None]
        positions = np.concatenate([frames, target])
        return np.ones(robot.n), positions
    masses = []
    centres = []
    for k, joint in enumerate(robot.joints):
        centre = _centre_of_mass(robot, at, q, k)
        masses.append(joint.mass or 0.0)
        centres.append(centre)
    return np.array(masses), np.stack(centres)


def _centre_of_mass(robot: Robot, at: Pose, q: Array, k: int) -> Array:
    """Locate the centre of mass (3, m) [mm, frame 0] of the link that joint k (0-based) moves."""
    joint = robot.joints[k]
    readings = q[:, k]
    origin = at.origins[k]
    axes = at.axes[k, :3]
    R = axes.transpose(1, 0, 2)
    if joint.prismatic:
        direction = R[:, 2]
        travel = direction * readings
        origin = origin + travel
    else:
        R = rotate_frame(R, 2, readings)
    com = np.array(joint.com)
    offset = np.einsum("ijm,j->im", R, com)
    centre = origin + offset
    return np.asarray(centre)


def compute_joint_moments(robot: Robot, at: Pose, q: Array) -> Array:
    """Compute the moment of the weight beyond each joint about the x, y, z axes of its frame, (n,
    3, m) [N m]; about z (a slide: the force along z [N]) it is the joint's gravity torque."""
    masses, positions = place_masses(robot, at, q)
    direction = np.array(robot.gravity)[:, None]
    m = len(q)
    moments = np.empty((robot.n, 3, m))
    for j, joint in enumerate(robot.joints):
        beyond = masses[j:, None, None]
        weights = beyond * G * direction
        levers = positions[j:] - at.origins[j]
        total = _sum_of_moments(levers / 1e3, weights)
        moments[j] = np.einsum("aim,im->am", at.axes[j, :3], total)
        if joint.prismatic:
            force = at.axes[j, 2] * weights.sum(0)
            moments[j, 2] = force.sum(0)
    return moments


def _sum_of_moments(levers: Array, weights: Array) -> Array:
    """Sum the moments (3, m) of weights (b, 3, 1) at levers (b, 3, m)."""
    forces = np.broadcast_to(weights, levers.shape)
    moments = cross_product(levers.transpose(1, 0, 2), forces.transpose(1, 0, 2))
    total = moments.sum(1)
    return np.asarray(total)


def compute_joint_torques(robot: Robot, at: Pose, q: Array) -> Array:
    """Compute the gravity torque about each joint's axis, (n, m) [N m] (force [N] along the axis of
    a prismatic joint)."""
    moments = compute_joint_moments(robot, at, q)
    torques: Array = moments[:, 2]
    return torques


def compute_unit_moments(robot: Robot, at: Pose) -> dict[tuple[int, int], Array]:
    """Compute (joint, frame) -> (3, m) moment about the joint's x, y, z axes of 1 kg at a later
    frame's origin (n+1: the target) [N m/kg]; about z (a slide: the force along z [N/kg]) it is the
    gravity torque."""
    frames = at.origins[: robot.n]
    target = at.target[None]
    bodies = np.concatenate([frames, target])
    direction = np.array(robot.gravity)[:, None]
    pull = np.broadcast_to(G * direction, at.target.shape)
    moments = {}
    for j, joint in enumerate(robot.joints):
        axes = at.axes[j, :3]
        for k in range(j + 1, robot.n + 1):
            lever = bodies[k] - at.origins[j]
            in_base = cross_product(lever / 1e3, pull)
            moment = np.einsum("aim,im->am", axes, in_base)
            if joint.prismatic:
                force = axes[2] * pull
                moment[2] = force.sum(0)
            moments[j + 1, k + 1] = moment
    return moments


def compute_base_moment(robot: Robot, at: Pose, q: Array) -> Array:
    """Compute the moment of the whole arm's weight about frame 0's origin, (3, m) [N m]."""
    masses, positions = place_masses(robot, at, q)
    direction = np.array(robot.gravity)
    of_bodies = masses[:, None, None] * G
    weights = of_bodies * direction[None, :, None]
    levers = positions / 1e3
    return _sum_of_moments(levers, weights)


def _draw_sample(robot: Robot, target: Array = PROBE_TOOL) -> tuple[Array, Pose]:
    """Draw joint readings (64, n) within the limits, the same every time, and their pose."""
    seed = 0
    rng = np.random.default_rng(seed)
    q = robot.draw(rng, 64)
    at = pose(robot, q, target)
    return q, at


@lru_cache(maxsize=REMEMBERED)
def find_gravity_joints(robot: Robot) -> tuple[int, ...]:
    """Find the revolute joints (1-based) whose gravity torque changes with the configuration; none
    where gravity is not known."""
    if robot.gravity is None:
        return ()
    q, at = _draw_sample(robot)
    return _list_loaded(robot, compute_joint_torques(robot, at, q))


def find_payload_joints(robot: Robot) -> tuple[int, ...]:
    """Find the revolute joints (1-based) that a weight at the target may load, the target being
    anywhere on the flange; none where gravity is not known."""
    if robot.gravity is None:
        return ()
    _, at = _draw_sample(robot, PROBE_PAYLOAD)
    moments = compute_unit_moments(robot, at)
    last = robot.n + 1
    joints = range(1, last)
    torques = np.array([moments[joint, last][2] for joint in joints])
    return _list_loaded(robot, torques)


@lru_cache(maxsize=REMEMBERED)
def find_tilting_bodies(robot: Robot, joint: int) -> tuple[int, ...]:
    """Find the later frames (n+1: the target) where a weight has a moment across a joint's axis that changes with
    the configuration; none where gravity is not known."""
    if robot.gravity is None:
        return ()
    _, at = _draw_sample(robot, PROBE_PAYLOAD)
    moments = compute_unit_moments(robot, at)
    found = []
    for body in range(joint + 1, robot.n + 2):
        across = moments[joint, body][:2]
        spread = np.ptp(across, axis=1)
        if spread.max() > NEGLIGIBLE_LEVER * G:
            found.append(body)
    return tuple(found)


def loads_base(robot: Robot) -> bool:
    """Whether the moment of the arm's weight on its base changes with the configuration; not where
    gravity is not known."""
    if robot.gravity is None:
        return False
    q, at = _draw_sample(robot)
    moments = compute_base_moment(robot, at, q)
    spread = np.ptp(moments, axis=1)
    largest = spread.max()
    return bool(largest > NEGLIGIBLE_LEVER * G)


def keeps_slide_upright(robot: Robot, joint: int) -> bool:
    """Whether a slide (1-based) is along gravity in every posture; not where gravity is not known."""
    if robot.gravity is None:
        return False
    _, at = _draw_sample(robot)
    direction = np.array(robot.gravity)
    axis = at.axes[joint - 1, 2]
    along = np.abs(axis.T @ direction)
    least = along.min()
    return bool(least > 1 - STILL)


def draw_places(robot: Robot) -> Array:
    """Draw places (n+1, 3, 64) [mm, frame 0] of the frames' origins (the last: of a target beside the last
    joint's axis) within the limits, the same every time."""
    _, at = _draw_sample(robot, PROBE_PAYLOAD)
    frames = at.origins[: robot.n]
    return np.concatenate([frames, at.target[None]])


def turns_in_gravity(robot: Robot, joint: int) -> bool:
    """Return whether what carries a joint (1-based) turns against gravity, so that the pull changes its
    direction there; not where gravity is not known."""
    if robot.gravity is None:
        return False
    _, at = _draw_sample(robot)
    direction = np.array(robot.gravity)
    axes = at.axes[joint - 1, :3]
    pulls = np.einsum("aim,i->am", axes, direction)
    spread = np.ptp(pulls, axis=1)
    largest = spread.max()
    return bool(largest > STILL)


def find_bearing_joints(robot: Robot) -> tuple[int, ...]:
    """Find the revolute joints (1-based) whose bearings a weight loads across their axes: those that it
    turns, too; where it turns none, as in a SCARA arm, all those of which the moment across changes."""
    loaded = find_gravity_joints(robot)
    if loaded or robot.gravity is None:
        return loaded
    q, at = _draw_sample(robot)
    moments = compute_joint_moments(robot, at, q)
    about_x = _list_loaded(robot, moments[:, 0])
    about_y = _list_loaded(robot, moments[:, 1])
    return tuple(sorted({*about_x, *about_y}))


def _list_loaded(robot: Robot, torques: Array) -> tuple[int, ...]:
    """List the revolute joints (1-based) whose torques (n, m) change."""
    spread = np.ptp(torques, axis=1)
    changing = spread > NEGLIGIBLE_LEVER * G
    found = []
    for j, joint in enumerate(robot.joints):
        turns = not joint.prismatic
        if turns and changing[j]:
            number = j + 1
            found.append(number)
    return tuple(found)


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
    at_zero, at_right_angle = lever
    sign = 1
    phase = float(np.arctan2(-at_right_angle, at_zero))
    half = np.pi / 2
    tolerance = 1e-9
    is_half_turned = not -half + tolerance < phase <= half + tolerance
    if is_half_turned:
        sign = -1
        turn = -np.pi if phase > 0 else np.pi
        phase = phase + turn
    if abs(phase) < tolerance:
        phase = 0.0
    return phase, sign


def _fixed_frames_beyond(robot: Robot, joint: int) -> list[int]:
    """List the frames (0-based) beyond a joint whose origins later joints do not move, the farthest
    first: the wrist's centre, and not an offset on the way to it; then every frame beyond it."""
    rng = np.random.default_rng(1)
    q = robot.draw(rng, 8)
    first = joint + 1
    q[:, :first] = 0.0
    at = pose(robot, q, PROBE_TOOL)
    motion = np.ptp(at.origins, axis=2)
    largest = motion.max(axis=1)
    fixed = [k for k in range(first, robot.n) if largest[k] < STILL]
    fixed.reverse()
    beyond = range(first, robot.n + 1)
    return [*fixed, *beyond]


@lru_cache(maxsize=REMEMBERED)
def find_arm_pair(robot: Robot) -> ArmPair | None:
    """Find the first two successive joints that stay horizontal and parallel (shoulder and elbow);
    None where there are none."""
    if robot.gravity is None:
        return None
    _, at = _draw_sample(robot)
    direction = np.array(robot.gravity)[:, None]
    horizontal = []
    for j, joint in enumerate(robot.joints):
        along = at.axes[j, 2] * direction
        cosine = np.abs(along.sum(0))
        is_level = cosine.max() < STILL
        turns = not joint.prismatic
        horizontal.append(turns and is_level)
    for j in range(robot.n - 1):
        both = horizontal[j] and horizontal[j + 1]
        if not both:
            continue
        product = at.axes[j, 2] * at.axes[j + 1, 2]
        cosine = product.sum(0)
        first = float(cosine[0])
        stays = np.ptp(cosine) < STILL
        is_unit = abs(abs(first) - 1) < STILL
        if not (stays and is_unit):
            continue
        pair = _measure_pair(robot, j, round(first))
        if pair is not None:
            return pair
    return None


def _measure_pair(robot: Robot, j: int, parallel: int) -> ArmPair | None:
    """Measure the levers of upper arm and forearm beyond joint j (0-based) at two of its angles, 0
    and 90°; None where one is too short."""
    q = np.zeros((2, robot.n))
    q[1, j] = np.pi / 2
    at = pose(robot, q, PROBE_TOOL)
    frames = at.origins[: robot.n]
    target = at.target[None]
    origins = np.concatenate([frames, target])
    direction = np.array(robot.gravity)[:, None]
    pull = np.broadcast_to(direction, at.target.shape)

    def lever(start: int, end: int) -> Array:
        offset = origins[end] - origins[start]
        moment = cross_product(offset, pull)
        about_axis = at.axes[j, 2] * moment
        total = about_axis.sum(0)
        return np.asarray(total)

    near = lever(j, j + 1)
    if np.hypot(*near) < MIN_LEVER:
        return None
    for k in _fixed_frames_beyond(robot, j + 1):
        far = lever(j + 1, k)
        if np.hypot(*far) > MIN_LEVER:
            break
    else:
        return None
    near_phase, near_sign = _find_phase(near)
    far_phase, far_sign = _find_phase(far)
    return ArmPair(
        upper=j + 1,
        fore=j + 2,
        parallel=parallel,
        near_phase=near_phase,
        far_phase=far_phase,
        near_sign=near_sign,
        far_sign=far_sign,
    )
