"""What a drive does to the joints: its own joint alone, or, where motors are coupled, every joint
that its motor moves.

Drives err with the motor's reading, its torque and its motion, and an error of motor k moves joint
j by C[j, k] (`robot.coupling`). Bearings, links and couplings err with the joints' angles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..robot.gravity import declares_masses_beyond, find_gravity_joints, find_payload_joints
from ..robot.kinematics import Robot
from .causes import Cause, Named, q
from .terms import Screw


def joint_axis(robot: Robot, joint: int) -> str:
    """Return the axis that a joint moves along (tz) or about (rz)."""
    joint_moved = robot.joints[joint - 1]
    if joint_moved.prismatic:
        return "tz"
    return "rz"


def is_joint_motion(robot: Robot, place: tuple[int, str]) -> bool:
    """Return whether a place (frame, axis) is where a joint moves."""
    frame, axis = place
    if frame > robot.n:
        return False
    own = joint_axis(robot, frame)
    return axis == own


def is_coupled(robot: Robot, motor: int) -> bool:
    """Whether a motor moves more than its own joint, or reads more than its angle."""
    if robot.coupling is None:
        return False
    alone = {motor: 1.0}
    moved = robot.coupling.moved_joints(motor)
    read = robot.coupling.read_joints(motor)
    return moved != alone or read != alone


def name_drive(robot: Robot, motor: int) -> str:
    """Name what a drive turns in a sentence: "joint 3", or "motor 3" where it is coupled."""
    return f"{'motor' if is_coupled(robot, motor) else 'joint'} {motor}"


def drive_angle(robot: Robot, motor: int) -> str:
    """Write what a drive should give in an equation: its joint's reading, or its motor's."""
    if is_coupled(robot, motor):
        return f"motor {motor} = {motor_reading(robot, motor)}"
    return f"θ{motor} = q{motor}"


def motor_reading(robot: Robot, motor: int) -> Cause:
    """Build the reading of a motor from the joints' angles: q2+q3 of a parallelogram's third."""
    if robot.coupling is None:
        return q(motor, robot.unit(motor))
    ratios = robot.coupling.read_joints(motor)
    return _add_weighted({q(joint, robot.unit(joint)): ratio for joint, ratio in ratios.items()})


def motor_torque(robot: Robot, motor: int, body: int | None = None) -> Cause:
    """Build the gravity torque [N m] that a motor holds; of 1 kg at the origin of a later frame
    alone [N m/kg] where `body` names it."""
    suffix, unit = ("", "N m") if body is None else (f"_{body}", "N m/kg")
    torques: dict[Cause, float] = {}
    for joint, ratio in moved_joints(robot, motor).items():
        if body is None or joint < body:
            torques[Named(f"torque{joint}{suffix}", unit)] = ratio
    return _add_weighted(torques)


def moved_joints(robot: Robot, motor: int) -> Mapping[int, float]:
    """Return the joints (from 1) that a motor moves, each with its ratio."""
    if robot.coupling is None:
        return {motor: 1.0}
    return robot.coupling.moved_joints(motor)


def knows_held_masses(robot: Robot, motor: int) -> bool:
    """Return whether the masses of all links that a motor holds are declared."""
    first = min(moved_joints(robot, motor))
    return declares_masses_beyond(robot, first)


def drive_screws(robot: Robot, motor: int, cause: Cause) -> tuple[Screw, ...]:
    """Build the screws of a drive that stands off by the cause: a turn (or shift) of every joint
    that its motor moves."""
    screws = []
    for joint, ratio in moved_joints(robot, motor).items():
        screw = Screw(joint, joint_axis(robot, joint), _weigh(cause, ratio))
        screws.append(screw)
    return tuple(screws)


def find_gravity_motors(robot: Robot) -> tuple[int, ...]:
    """Find the drives (from 1) of which gravity loads a joint."""
    return _find_motors(robot, find_gravity_joints(robot))


def find_payload_motors(robot: Robot) -> tuple[int, ...]:
    """Find the drives (from 1) of which a weight at the target may load a joint."""
    return _find_motors(robot, find_payload_joints(robot))


def _find_motors(robot: Robot, joints: Sequence[int]) -> tuple[int, ...]:
    """Find the drives (from 1) that move one of some joints."""
    loaded = set(joints)
    motors = range(1, robot.n + 1)
    return tuple(motor for motor in motors if loaded & moved_joints(robot, motor).keys())


def _weigh(cause: Cause, ratio: float) -> Cause:
    return cause if ratio == 1 else ratio * cause


def _add_weighted(causes: Mapping[Cause, float]) -> Cause:
    """Add causes by their ratios, those with positive ones first."""
    ordered = sorted(causes.items(), key=lambda item: item[1] < 0)
    (first, ratio), *others = ordered
    total = _weigh(first, ratio)
    for cause, share in others:
        total = total + _weigh(cause, share) if share > 0 else total - _weigh(cause, -share)
    return total
