"""A robot as plain values: the record that a calibration stores, which is read back, and the card
that `modelsel robots` prints. (A robot file's table is read by `files` and written by `dh`.)"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from hashlib import sha256
from typing import Any

import numpy as np

from .._names import MAX_TEXT_LENGTH, find_name_problem
from .._typing import LARGEST, Array
from ..exceptions import StudyError
from .coupling import Coupling, find_coupling_problem, find_passive_problem
from .kinematics import Joint, Robot, forward

# a stored rotation, or a direction, differs from one by less
ROTATION_TOLERANCE = 1e-6
# no arm's flange reaches further [m]; postures in which that is looked at
MAX_REACH_M = 100.0
# of the numbers that a hash is made of: machines differ in the last digits of a sine
DECIMALS = 9
TRIED_POSTURES = 8


def check_robot_name(robot: Robot) -> None:
    """Raise ValueError where a robot's name or source cannot be one."""
    part = "name"
    problem = find_name_problem(robot.name)
    if problem is None:
        part = "source"
        source = robot.source or "none"
        problem = find_name_problem(source, MAX_TEXT_LENGTH)
    if problem is not None:
        raise ValueError(f"the robot's {part} is not valid: {problem}")


def check_reach(robot: Robot, unit: str, where: str) -> None:
    """Check that a robot whose file `where` has lengths in a `unit`, mm or m, has an arm's reach. Only
    how far turning joints move the flange counts: rows of nearly parallel axes have long lengths
    that cancel, and slides may be unbounded. Raises StudyError."""
    steps = np.arange(1.0, robot.n + 1)
    slides = np.array(robot.prismatic)
    steps[slides] = 0.0
    postures = np.arange(TRIED_POSTURES)
    readings = np.outer(postures, steps)
    flange = forward(robot, readings, np.zeros(3))
    middle = flange.mean(0)
    lengths = np.linalg.norm(flange - middle, axis=1)
    largest = lengths.max()
    reach = float(largest) / 1e3
    if reach <= MAX_REACH_M:
        return
    mistake = "some look wrong"
    if unit == "m":
        mistake = "these look like millimetres, so divide them by 1000"
    raise StudyError(
        f"{where}: its flange would reach {reach:.3g} m, further than any arm's "
        f"({MAX_REACH_M:.0f} m): lengths are expected in {unit}; {mistake}."
    )


def robot_record(robot: Robot) -> dict[str, Any]:
    """Return the nominal robot in full; `robot_from_record` reads it."""
    record: dict[str, Any] = {
        "name": robot.name,
        "source": robot.source,
        "gravity": None if robot.gravity is None else list(robot.gravity),
        "usual": list(robot.usual),
        "joints": [_joint_record(joint) for joint in robot.joints],
        "last_mm": robot.last[:3].tolist(),
    }
    if robot.coupling is not None:
        record["coupling"] = robot.coupling.matrix.tolist()
        if robot.coupling.passive:
            record["passive"] = list(robot.coupling.passive)
    if robot.payload_at_mm is not None:
        record["payload_at_mm"] = list(robot.payload_at_mm)
    return record


def hash_robot(robot: Robot) -> str:
    """Hash the nominal robot as it was read: the same on every machine, to 1e-9 mm."""
    record = robot_record(robot)
    rounded = _round(record)
    text = json.dumps(rounded, sort_keys=True)
    return sha256(text.encode()).hexdigest()


def _round(value: Any) -> Any:
    """Round all numbers of a record."""
    if isinstance(value, float):
        rounded = round(value, DECIMALS)
        return rounded + 0.0  # no negative zero
    if isinstance(value, list):
        return [_round(one) for one in value]
    if isinstance(value, dict):
        return {key: _round(one) for key, one in value.items()}
    return value


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
        coupling=_coupling_from_record(record.get("coupling"), record.get("passive") or (), joints),
        payload_at_mm=_place_from_record(record.get("payload_at_mm")),
    )


def _place_from_record(place: Sequence[float] | None) -> tuple[float, float, float] | None:
    if place is None:
        return None
    x, y, z = bounded_array(place).tolist()
    return x, y, z


def _coupling_from_record(
    rows: Sequence[Sequence[float]] | None, passive: Sequence[int], joints: tuple[Joint, ...]
) -> Coupling | None:
    if rows is None:
        return None
    count = len(joints)
    lengths = {len(rows), *(len(row) for row in rows)}
    if lengths != {count}:
        raise ValueError(f"the coupling is not a matrix of {count} x {count} numbers")
    matrix = bounded_array(rows)
    problem = find_coupling_problem(matrix, tuple(joint.prismatic for joint in joints))
    if problem is not None:
        raise ValueError(f"the coupling: {problem}")
    problem = find_passive_problem(passive, count)
    if problem is not None:
        raise ValueError(f"passive: {problem}")
    return Coupling(matrix, tuple(passive))


def _joint_from_record(number: int, record: Mapping[str, Any]) -> Joint:
    com = bounded_array(record["com_mm"])
    x, y, z = com.tolist()
    limits = record["limits"]
    mass = record["mass_kg"]
    if limits is not None:
        low = float(limits[0])
        high = float(limits[1])
        if not -LARGEST < low < high < LARGEST:
            raise ValueError(f"joint {number}: the lower limit must be below the upper one")
        limits = (low, high)
    if mass is not None:
        mass = float(mass)
        if not 0 <= mass <= LARGEST:
            raise ValueError(f"joint {number}: the mass must lie between 0 and {LARGEST:g} kg")
    return Joint(
        before=rigid_transform(record["before_mm"]),
        prismatic=record["prismatic"],
        limits=limits,
        mass=mass,
        com=(x, y, z),
    )


def _gravity_from_record(direction: Sequence[float] | None) -> tuple[float, float, float] | None:
    if direction is None:
        return None
    length = float(np.linalg.norm(direction))
    if abs(length - 1) > ROTATION_TOLERANCE:
        raise ValueError("the direction of gravity is not of length one")
    x, y, z = direction
    return (float(x), float(y), float(z))


def _usual_from_record(pair: Sequence[float]) -> tuple[float, float]:
    are_valid = all(0 < size < LARGEST for size in pair)
    if not are_valid:
        raise ValueError("the robot's usual errors (mm, rad) must be above 0")
    length = float(pair[0])
    angle = float(pair[1])
    return length, angle


def rigid_transform(rows: Sequence[Sequence[float]]) -> Array:
    """Complete the upper three rows of a transform [mm] to (4, 4). Raises ValueError."""
    upper = bounded_array(rows)
    R = check_rotation(upper[:, :3])
    offset = upper[:, 3]
    return np.vstack([np.column_stack([R, offset]), [0, 0, 0, 1]])


def check_rotation(rows: Array | Sequence[Sequence[float]]) -> Array:
    """Return the rotation (3, 3) of three rows. Raises ValueError."""
    R = bounded_array(rows)
    identity = np.eye(3)
    difference = R @ R.T - identity
    size = np.abs(difference)
    deviates = size.max() > ROTATION_TOLERANCE
    is_mirrored = np.linalg.det(R) < 0
    if deviates or is_mirrored:
        found = R.round(6).tolist()
        raise ValueError(f"three columns are not a rotation: {found}")
    return R


def bounded_array(value: Any) -> Array:
    """Convert to an array of lengths no arm or room exceeds. Raises ValueError."""
    array = np.array(value, dtype=float)
    size = np.abs(array)
    is_bounded = (size <= LARGEST).all()
    if not is_bounded:
        raise ValueError(f"a length is beyond {LARGEST:g}")
    return array


def robot_card(robot: Robot) -> dict[str, Any]:
    """Summarise a robot for people and programs: its chain, limits in words, length of its links in all."""
    return {
        "name": robot.name,
        "source": robot.source,
        "joints": robot.n,
        "links_mm": robot.reach,
        "gravity": robot.gravity,
        "payload_at_mm": robot.payload_at_mm,
        "chain": [_joint_card(joint) for joint in robot.joints],
        "last_mm": robot.last[:3].tolist(),
        "coupling": None if robot.coupling is None else robot.coupling.matrix.tolist(),
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
