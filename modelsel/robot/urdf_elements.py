"""Elements of a URDF: their attributes as numbers, and how joints connect links."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np

from .._typing import LARGEST, Array
from ..exceptions import StudyError
from .rigid import from_rpy, transform

# kinds of joints that have one reading each
MOVING = ("revolute", "continuous", "prismatic")
# kinds that are read: planar and floating ones have more than one reading
KINDS = (*MOVING, "fixed")


def read_vector(element: ET.Element | None, key: str, default: tuple[float, ...]) -> Array:
    """Return the numbers of an attribute, the default where it is absent. Raises StudyError."""
    if element is None or element.get(key) is None:
        return np.array(default)
    text = str(element.get(key))
    words = text.split()
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = [np.nan]
    vector = np.array(numbers)
    count = len(default)
    limit = LARGEST / 1e3
    has_count = vector.shape == (count,)
    is_bounded = (np.abs(vector) <= limit).all()
    if has_count and is_bounded:
        return vector
    expected = "one finite number"
    if count > 1:
        expected = f"{count} finite numbers"
    place = f'<{element.tag} {key}="{text}">'
    raise StudyError(f"{place}: expected {expected} below {limit:g}.")


def read_origin(element: ET.Element) -> Array:
    """Return the transform (4, 4) [mm] of an element's <origin>."""
    origin = element.find("origin")
    zeros = (0.0, 0.0, 0.0)
    roll, pitch, yaw = read_vector(origin, "rpy", zeros)
    metres = read_vector(origin, "xyz", zeros)
    R = from_rpy(roll, pitch, yaw)
    return transform(R, metres * 1e3)


def read_axis(joint: ET.Element) -> Array:
    """Return the axis of a joint in its own frame, not normalised."""
    axis = joint.find("axis")
    return read_vector(axis, "xyz", default=(1.0, 0.0, 0.0))


def read_joint_name(joint: ET.Element) -> str:
    """Return the name of a joint."""
    return str(joint.get("name"))


def is_moving(joint: ET.Element) -> bool:
    """Return whether a joint has a reading."""
    kind = joint.get("type")
    return kind in MOVING


def find_end(joint: ET.Element, which: str) -> str | None:
    """Return the name of a joint's parent or child link; None where it lacks one."""
    end = joint.find(which)
    if end is None:
        return None
    return end.get("link")


def child_of(joint: ET.Element) -> str:
    """Return the name of the link that hangs on a joint."""
    return str(find_end(joint, "child"))


def parent_of(joint: ET.Element) -> str:
    """Return the name of the link that a joint hangs on."""
    return str(find_end(joint, "parent"))


def group_by_parent(root: ET.Element) -> dict[str, list[ET.Element]]:
    """Map each link to the joints that hang on it."""
    joints_on: dict[str, list[ET.Element]] = {}
    for joint in root.findall("joint"):
        parent = parent_of(joint)
        hanging = joints_on.setdefault(parent, [])
        hanging.append(joint)
    return joints_on
