"""Robot -> URDF: links base, link1 … flange, with whatever else hangs on base or flange."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any
from xml.etree import ElementTree as ET
from xml.sax.saxutils import escape

import numpy as np

from .._typing import Array
from ..exceptions import one_line
from .kinematics import Joint, Robot
from .rigid import align_z, to_rpy, transform


def _add_fixed(root: ET.Element, parent: str, child: str, place: Array) -> None:
    """Add a link that hangs on another by a fixed joint."""
    joint = ET.SubElement(root, "joint", name=f"{parent}-{child}", type="fixed")
    _add_origin(joint, place)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(root, "link", name=child)


def _add_origin(joint: ET.Element, place: Array) -> None:
    R = place[:3, :3]
    offset = place[:3, 3]
    angles = [repr(angle) for angle in to_rpy(R)]
    ET.SubElement(joint, "origin", xyz=_format_metres(offset), rpy=" ".join(angles))


def _format_metres(lengths: Iterable[float]) -> str:
    """Write lengths [mm] in metres, in full."""
    words = []
    for length in lengths:
        metres = float(length) / 1e3
        words.append(repr(metres))
    return " ".join(words)


def _make_comment(note: str) -> Any:
    """Make a comment that its words cannot close: ElementTree writes them as they are, and -- ends
    one for some readers."""
    line = one_line(note)
    text = escape(line)
    # two hyphens close a comment
    spaced = re.sub("-(?=-)", "- ", text)
    return ET.Comment(f" {spaced} ")


def write_urdf(
    robot: Robot, tips: Mapping[str, Array], frames: Mapping[str, Array], notes: Sequence[str] = ()
) -> str:
    """Write a chain as a URDF: links base, link1 … flange; `tips` (4, 4) hang on the flange,
    `frames` (4, 4) on the base [mm]. Where the base does not stand upright it hangs on a link world
    that does.

    Inertias, efforts and velocities are 0: they are not known here.
    """
    root = ET.Element("robot", name=robot.name)
    for note in notes:
        comment = _make_comment(note)
        root.append(comment)
    down = (0.0, 0.0, -1.0)
    is_upright = robot.gravity is None or robot.gravity == down
    if is_upright:
        ET.SubElement(root, "link", name="base")
    else:
        ET.SubElement(root, "link", name="world")
        gravity = np.array(robot.gravity)
        up = -gravity
        to_upright = align_z(up).T
        base = transform(to_upright)
        _add_fixed(root, "world", "base", base)
    for k, joint in enumerate(robot.joints, 1):
        _add_joint(root, k, joint)
        _add_link(root, k, joint)
    last_link = f"link{robot.n}"
    _add_fixed(root, last_link, "flange", robot.last)
    for name, place in tips.items():
        _add_fixed(root, "flange", name, place)
    for name, place in frames.items():
        _add_fixed(root, "base", name, place)
    ET.indent(root)
    text = ET.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="utf-8"?>\n{text}\n'


def _add_joint(root: ET.Element, number: int, joint: Joint) -> None:
    kind = "revolute"
    if joint.prismatic:
        kind = "prismatic"
    elif joint.limits is None:
        kind = "continuous"
    element = ET.SubElement(root, "joint", name=f"joint{number}", type=kind)
    _add_origin(element, joint.before)
    parent = "base"
    if number > 1:
        parent = f"link{number - 1}"
    child = f"link{number}"
    ET.SubElement(element, "parent", link=parent)
    ET.SubElement(element, "child", link=child)
    ET.SubElement(element, "axis", xyz="0 0 1")
    if joint.limits is None:
        return
    scale = 1e3 if joint.prismatic else 1.0
    low, high = joint.limits
    lower = float(low / scale)
    upper = float(high / scale)
    ET.SubElement(element, "limit", lower=repr(lower), upper=repr(upper), effort="0", velocity="0")


def _add_link(root: ET.Element, number: int, joint: Joint) -> None:
    link = ET.SubElement(root, "link", name=f"link{number}")
    if joint.mass is None:
        return
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=_format_metres(joint.com), rpy="0 0 0")
    mass = float(joint.mass)
    ET.SubElement(inertial, "mass", value=repr(mass))
    moments = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    zeros = dict.fromkeys(moments, "0")
    ET.SubElement(inertial, "inertia", zeros)
