"""A robot as plain values: the record that a calibration stores, which is read back, and the card
that `modelsel robots` prints. (A robot file's table is read by `files` and written by `dh`.)"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .._json import PAIR, TRIPLE, Each, Maybe
from .._names import MAX_TEXT_LENGTH, find_name_problem
from .._typing import LARGEST, Array
from .kinematics import Joint, Robot

# a stored rotation, or a direction, differs from one by less
ROTATION_TOLERANCE = 1e-6
# shapes of the stored values
ROTATION, TRANSFORM = Each(TRIPLE, 3), Each(Each(float, 4), 3)
JOINT = {
    "before_mm": TRANSFORM,
    "prismatic": bool,
    "limits": Maybe(PAIR),
    "mass_kg": Maybe(float),
    "com_mm": TRIPLE,
}


def check_robot_name(robot: Robot) -> None:
    """Raise ValueError where a robot's name or source cannot be one."""
    problem, part = find_name_problem(robot.name), "name"
    if problem is None:
        problem, part = find_name_problem(robot.source or "none", MAX_TEXT_LENGTH), "source"
    if problem is not None:
        raise ValueError(f"the robot's {part} is not valid: {problem}")


def robot_record(robot: Robot) -> dict[str, Any]:
    """Return the nominal robot in full; `robot_from_record` reads it."""
    return {
        "name": robot.name,
        "source": robot.source,
        "gravity": None if robot.gravity is None else list(robot.gravity),
        "usual": list(robot.usual),
        "joints": [_joint_record(joint) for joint in robot.joints],
        "last_mm": robot.last[:3].tolist(),
    }


def _joint_record(joint: Joint) -> dict[str, Any]:
    return {
        "before_mm": joint.before[:3].tolist(),
        "prismatic": joint.prismatic,
        "limits": None if joint.limits is None else list(joint.limits),
        "mass_kg": joint.mass,
        "com_mm": list(joint.com),
    }


def robot_from_record(record: Mapping[str, Any]) -> Robot:
    """Restore the nominal robot of a record of its shape. Raises ValueError where a transform is
    not rigid, or a limit, a mass or a direction is not valid."""
    joints = tuple(_joint_from_record(k, joint) for k, joint in enumerate(record["joints"], 1))
    return Robot(
        record["name"],
        record["source"],
        joints,
        rigid_transform(record["last_mm"]),
        _gravity_from_record(record["gravity"]),
        _usual_from_record(record.get("usual", Robot.usual)),
    )


def _joint_from_record(number: int, record: Mapping[str, Any]) -> Joint:
    x, y, z = bounded_array(record["com_mm"]).tolist()
    limits, mass = record["limits"], record["mass_kg"]
    if limits is not None:
        low, high = float(limits[0]), float(limits[1])
        if not -LARGEST < low < high < LARGEST:
            raise ValueError(f"joint {number}: the lower limit must be below the upper one")
        limits = (low, high)
    if mass is not None:
        mass = float(mass)
        if not 0 <= mass <= LARGEST:
            raise ValueError(f"joint {number}: the mass must lie between 0 and {LARGEST:g} kg")
    before = rigid_transform(record["before_mm"])
    return Joint(before, record["prismatic"], limits, mass, (x, y, z))


def _gravity_from_record(direction: Sequence[float] | None) -> tuple[float, float, float] | None:
    if direction is None:
        return None
    if abs(float(np.linalg.norm(direction)) - 1) > ROTATION_TOLERANCE:
        raise ValueError("the direction of gravity is not of length one")
    x, y, z = (float(v) for v in direction)
    return x, y, z


def _usual_from_record(pair: Sequence[float]) -> tuple[float, float]:
    if not all(0 < size < LARGEST for size in pair):
        raise ValueError("the robot's usual errors (mm, rad) must be above 0")
    return float(pair[0]), float(pair[1])


def rigid_transform(rows: Sequence[Sequence[float]]) -> Array:
    """Complete the upper three rows of a transform [mm] to (4, 4). Raises ValueError."""
    upper = bounded_array(rows)
    rotation = check_rotation(upper[:, :3])
    return np.vstack([np.column_stack([rotation, upper[:, 3]]), [0, 0, 0, 1]])


def check_rotation(rows: Array | Sequence[Sequence[float]]) -> Array:
    """Return the rotation (3, 3) of three rows. Raises ValueError."""
    R = bounded_array(rows)
    deviation = np.abs(R @ R.T - np.eye(3)).max()
    if deviation > ROTATION_TOLERANCE or np.linalg.det(R) < 0:
        raise ValueError(f"three columns are not a rotation: {R.round(6).tolist()}")
    return R


def bounded_array(value: Any) -> Array:
    """Convert to an array of lengths no arm or room exceeds. Raises ValueError."""
    array = np.array(value, dtype=float)
    if not (np.abs(array) <= LARGEST).all():
        raise ValueError(f"a length is beyond {LARGEST:g}")
    return array


def robot_card(robot: Robot) -> dict[str, Any]:
    """Summarise a robot for people and programs: its chain, limits in words, reach."""
    return {
        "name": robot.name,
        "source": robot.source,
        "joints": robot.n,
        "reach_mm": robot.reach,
        "gravity": robot.gravity,
        "chain": [_joint_card(joint) for joint in robot.joints],
        "last_mm": robot.last[:3].tolist(),
    }


def _joint_card(joint: Joint) -> dict[str, Any]:
    return {
        "kind": "prismatic" if joint.prismatic else "revolute",
        "limits": _describe_limits(joint),
        "mass_kg": joint.mass,
        "transform_mm": joint.before[:3].tolist(),
    }


def _describe_limits(joint: Joint) -> str:
    if joint.limits is None:
        return "not known"
    if joint.prismatic:
        low, high = joint.limits
        return f"{low:.4g} to {high:.4g} mm"
    low, high = np.degrees(joint.limits)
    return f"{low:.4g} to {high:.4g} deg"
