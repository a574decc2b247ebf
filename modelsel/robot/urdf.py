"""URDF -> Robot: the one serial chain of moving joints in a file, base to tip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from .._names import find_name_problem, quote_name
from .._text import read_text
from .._typing import Array
from ..exceptions import StudyError, one_line
from .kinematics import Joint, Robot, UrdfSource
from .plain_values import check_reach
from .rigid import align_z, inverse, transform
from .urdf_chain import check_tree, find_chain, list_moving_names
from .urdf_elements import (
    KINDS,
    child_of,
    group_by_parent,
    parent_of,
    read_axis,
    read_joint_name,
    read_origin,
    read_vector,
)

OTHER_CHAIN = 'Or name a chain without it: base = "…", tip = "…".'
# rad: files have 1.571 for a right angle, and no mount is known better
UPRIGHT_TOLERANCE = 1e-3


def _list_joints_above(root: ET.Element, link: str, where: str) -> list[ET.Element]:
    """List the joints from the link that everything hangs on down to a link. Raises StudyError for
    links in a circle."""
    joint_above = {child_of(joint): joint for joint in root.findall("joint")}
    above = list[ET.Element]()
    visited = {link}
    while link in joint_above:
        joint = joint_above[link]
        above.insert(0, joint)
        link = parent_of(joint)
        if link in visited:
            raise StudyError(f"{where}: the links form a loop. A serial chain is expected.")
        visited.add(link)
    return above


def _find_gravity(root: ET.Element, base: str, where: str) -> tuple[float, float, float] | None:
    """Find the direction of gravity in a link: -z of the link that everything hangs on (REP 103),
    turned by the joints between; None where one of them turns about an axis that is not upright.
    Raises StudyError for links in a circle."""
    g = np.array([0.0, 0.0, -1.0])
    for joint in _list_joints_above(root, base, where):
        kind = joint.get("type")
        origin = read_origin(joint)
        R = origin[:3, :3]
        g = R.T @ g
        axis = read_axis(joint)
        turns = kind not in ("fixed", "prismatic")
        tilt = np.linalg.norm(np.cross(axis, g))
        length = np.linalg.norm(axis)
        is_tilted = tilt > UPRIGHT_TOLERANCE * length
        if kind == "floating":
            return None
        if turns and is_tilted:
            return None
    is_small = np.abs(g) < UPRIGHT_TOLERANCE
    g = np.where(is_small, 0.0, g)
    direction = g / np.linalg.norm(g)
    x, y, z = direction.tolist()
    return x, y, z


def _read_body(link: ET.Element | None, place: Array) -> tuple[float, Array] | None:
    """Return (mass [kg], centre of mass [mm] where the link's frame stands at `place`); None where
    the link has no mass."""
    if link is None:
        return None
    inertial = link.find("inertial")
    if inertial is None:
        return None
    element = inertial.find("mass")
    if element is None:
        return None
    values = read_vector(element, "value", default=(0.0,))
    mass = float(values[0])
    centre = place @ read_origin(inertial)
    return mass, centre[:3, 3]


def _sum_weights(root: ET.Element, start: str, stop: set[str]) -> tuple[float, Array] | None:
    """Sum (mass [kg], centre of mass [mm] in the frame of link `start`) of all that moves with it:
    the links on it and on them, at zero readings, but for those that hang on the joints `stop`;
    None where no link has a mass."""
    links = {str(link.get("name")): link for link in root.iter("link")}
    joints_on = group_by_parent(root)
    bodies = list[tuple[float, Array]]()
    stack = [(start, np.eye(4))]
    while stack:
        name, place = stack.pop()
        link = links.get(name)
        body = _read_body(link, place)
        if body is not None:
            bodies.append(body)
        for joint in joints_on.get(name, []):
            if read_joint_name(joint) in stop:
                continue
            child = child_of(joint)
            origin = read_origin(joint)
            child_place = place @ origin
            stack.append((child, child_place))
    if not bodies:
        return None
    total = sum(mass for mass, _ in bodies)
    if not total:
        return total, np.zeros(3)
    moment = np.zeros(3)
    for mass, centre in bodies:
        moment += mass * centre
    return total, moment / total


def read_urdf(path: Path, base: str | None = None, tip: str | None = None) -> Robot:
    """Read a robot from a URDF file. Raises StudyError."""
    text = read_text(path, "the URDF", as_it_is=True)
    return read_urdf_text(text, path.name, base, tip)


def read_urdf_text(text: str, where: str, base: str | None = None, tip: str | None = None) -> Robot:
    """Read a robot from a URDF's text (lengths m -> mm): the serial chain from link `base` to link
    `tip`. A joint carries the masses of all links that move with it, a gripper's and a tool's too.
    Raises StudyError.

    Entities and document types are refused: a URDF needs none, and they are how XML files attack
    their reader."""
    root = parse_urdf(text, where)
    try:
        check_tree(root, where)
        chain = find_chain(root, where, base, tip)
        robot = _read_chain(root, chain, where)
        check_reach(robot, "m", where)
    except StudyError as error:
        placed = [p if p.startswith(where) else f"{where}: {p}" for p in error.problems]
        raise StudyError(*placed) from None
    first_link = parent_of(chain[0])
    last_link = child_of(chain[-1])
    for link in (first_link, last_link):
        problem = find_name_problem(link)
        if problem is not None:
            raise StudyError(
                f"{where}: the name of link {quote_name(link)} is not valid: {problem}."
            )
    return replace(robot, urdf=UrdfSource(text, first_link, last_link))


def read_joint_names(robot: Robot) -> tuple[str, ...]:
    """Return the names of a robot's joints, from the base on; none where it is not from a URDF."""
    return () if robot.urdf is None else _read_moving_names(robot.urdf)


@lru_cache(maxsize=8)
def _read_moving_names(source: UrdfSource) -> tuple[str, ...]:
    root = parse_urdf(source.text, "the URDF")
    return list_moving_names(find_chain(root, "the URDF", source.base, source.tip))


def parse_urdf(text: str, where: str) -> ET.Element:
    """Parse a URDF's text. Raises StudyError for what is not XML, and for what XML files attack
    their reader with."""
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise StudyError(f"{where}: a document type or entity in a URDF is refused. Remove it.")
    try:
        return ET.fromstring(text)
    except ET.ParseError as error:
        remedy = "Correct this place."
        if not text.lstrip().startswith("<"):
            remedy = "A URDF is expected, which begins with <robot>."
        raise StudyError(f"{where}: not valid XML: {error}. {remedy}") from None


def _read_chain(root: ET.Element, chain: Sequence[ET.Element], where: str) -> Robot:
    moving = set(list_moving_names(chain))
    pending = np.eye(4)
    joints = []
    for element in chain:
        pending = pending @ read_origin(element)
        name = element.get("name")
        place = f'{where}: joint "{name}"'
        _check_kind(element, place)
        if element.get("type") == "fixed":
            continue
        axis = _check_axis(element, place)
        to_axis = transform(align_z(axis))
        limits = _read_limits(element, place)
        weights = _sum_weights(root, child_of(element), moving)
        joint = _build_joint(element, pending, to_axis, limits, weights)
        joints.append(joint)
        pending = inverse(to_axis)
    robot_name = str(root.get("name", Path(where).stem))
    problem = find_name_problem(robot_name)
    if problem is not None:
        raise StudyError(f"{where}: the robot's name is not valid: {problem}.")
    first_link = parent_of(chain[0])
    return Robot(
        robot_name,
        source=f"URDF {one_line(where)}",
        joints=tuple(joints),
        last=pending,
        gravity=_find_gravity(root, first_link, where),
    )


def _build_joint(
    element: ET.Element,
    pending: Array,
    to_axis: Array,
    limits: tuple[float, float] | None,
    weights: tuple[float, Array] | None,
) -> Joint:
    """Build the joint of an element from the transform that leads to it and the one to its axis."""
    mass = None
    com = np.zeros(3)
    if weights is not None:
        mass, centre = weights
        R = to_axis[:3, :3]
        com = R.T @ centre
    x, y, z = com.tolist()
    return Joint(
        before=pending @ to_axis,
        prismatic=element.get("type") == "prismatic",
        limits=limits,
        mass=mass,
        com=(x, y, z),
    )


def _check_kind(element: ET.Element, place: str) -> None:
    """Refuse a joint that has not exactly one reading of its own."""
    kind = element.get("type")
    if kind not in KINDS:
        raise StudyError(f'{place}: type "{kind}"; {", ".join(KINDS)} are known. {OTHER_CHAIN}')
    if kind != "fixed" and element.find("mimic") is not None:
        raise StudyError(
            f"{place} mimics another joint: every joint of the chain needs a reading of its own. "
            f"Remove <mimic> where it has one. {OTHER_CHAIN}"
        )


def _check_axis(element: ET.Element, place: str) -> Array:
    axis = read_axis(element)
    if np.linalg.norm(axis) < 1e-9:
        raise StudyError(f'{place}: the axis has no length. Give its direction: xyz="0 0 1".')
    return axis


def _read_limits(element: ET.Element, place: str) -> tuple[float, float] | None:
    """Return a joint's limits [rad or mm]; None where it has none."""
    limit = element.find("limit")
    kind = element.get("type")
    if limit is None or kind == "continuous":
        return None
    if not limit.get("upper"):
        return None
    scale = 1e3 if kind == "prismatic" else 1.0
    lower = read_vector(limit, "lower", (0.0,))
    upper = read_vector(limit, "upper", (0.0,))
    low = float(lower[0]) * scale
    high = float(upper[0]) * scale
    if low > high:
        raise StudyError(f"{place}: its lower limit is above the upper one. Exchange them.")
    return low, high
