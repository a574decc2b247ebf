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
    rpy = " ".join(repr(angle) for angle in to_rpy(place[:3, :3]))
    ET.SubElement(joint, "origin", xyz=_format_metres(place[:3, 3]), rpy=rpy)


def _format_metres(lengths: Iterable[float]) -> str:
    """Write lengths [mm] in metres, in full."""
    return " ".join(repr(float(length) / 1e3) for length in lengths)


def _make_comment(note: str) -> Any:
    """Make a comment that its words cannot close: ElementTree writes them as they are, and -- ends
    one for some readers."""
    text = escape(one_line(note))
    return ET.Comment(f" {re.sub('-(?=-)', '- ', text)} ")


def write_urdf(
    robot: Robot, tips: Mapping[str, Array], frames: Mapping[str, Array], notes: Sequence[str] = ()
) -> str:
    """Write a chain as a URDF: links base, link1 … flange; `tips` (4, 4) hang on the flange,
    `frames` (4, 4) on the base [mm]. Where the base does not stand upright it hangs on a link world
    that does.

    Inertias, efforts and velocities are 0: they are not known here.
    """
    root = ET.Element("robot", name=robot.name)
    root.extend(_make_comment(note) for note in notes)
    if robot.gravity is None or robot.gravity == (0.0, 0.0, -1.0):
        ET.SubElement(root, "link", name="base")
    else:
        ET.SubElement(root, "link", name="world")
        _add_fixed(root, "world", "base", transform(align_z(-np.array(robot.gravity)).T))
    for k, joint in enumerate(robot.joints, 1):
        _add_joint(root, k, joint)
        _add_link(root, k, joint)
    _add_fixed(root, f"link{robot.n}", "flange", robot.last)
    for parent, places in (("flange", tips), ("base", frames)):
        for name, place in places.items():
            _add_fixed(root, parent, name, place)
    ET.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _add_joint(root: ET.Element, number: int, joint: Joint) -> None:
    kind = "continuous" if joint.limits is None else "revolute"
    if joint.prismatic:
        kind = "prismatic"
    element = ET.SubElement(root, "joint", name=f"joint{number}", type=kind)
    _add_origin(element, joint.before)
    parent = "base" if number == 1 else f"link{number - 1}"
    ET.SubElement(element, "parent", link=parent)
    ET.SubElement(element, "child", link=f"link{number}")
    ET.SubElement(element, "axis", xyz="0 0 1")
    if joint.limits is None:
        return
    scale = 1e3 if joint.prismatic else 1.0
    low, high = (repr(float(limit / scale)) for limit in joint.limits)
    ET.SubElement(element, "limit", lower=low, upper=high, effort="0", velocity="0")


def _add_link(root: ET.Element, number: int, joint: Joint) -> None:
    link = ET.SubElement(root, "link", name=f"link{number}")
    if joint.mass is None:
        return
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=_format_metres(joint.com), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=repr(float(joint.mass)))
    zeros = dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), "0")
    ET.SubElement(inertial, "inertia", zeros)
