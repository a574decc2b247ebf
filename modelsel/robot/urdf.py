"""URDF -> Robot: the one serial chain of moving joints in a file, base to tip."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from .._names import find_name_problem
from .._text import read_text
from .._typing import LARGEST, Array
from ..exceptions import StudyError, one_line, suggest
from .kinematics import Joint, Robot
from .rigid import align_z, from_rpy, inverse, transform

MOVING = ("revolute", "continuous", "prismatic")
KINDS = (*MOVING, "fixed")  # planar and floating ones have more than one reading
OTHER_CHAIN = 'Or name a chain without it: base = "…", tip = "…".'
# rad: files have 1.571 for a right angle, and no mount is known better
UPRIGHT_TOLERANCE = 1e-3
# joints from base to tip; more are a loop
MAX_CHAIN_LENGTH = 1000
# chains and roots that a message lists
MAX_LISTED = 10


def _read_vector(element: ET.Element | None, key: str, default: tuple[float, ...]) -> Array:
    """Return the numbers of an attribute, the default where it is absent. Raises StudyError."""
    if element is None or element.get(key) is None:
        return np.array(default)
    text = str(element.get(key))
    try:
        vector = np.array([float(word) for word in text.split()])
    except ValueError:
        vector = np.array([np.nan])
    limit = LARGEST / 1e3
    if vector.shape == (len(default),) and (np.abs(vector) <= limit).all():
        return vector
    expected = "one finite number" if len(default) == 1 else f"{len(default)} finite numbers"
    raise StudyError(f'<{element.tag} {key}="{text}">: expected {expected} below {limit:g}.')


def _read_origin(element: ET.Element) -> Array:
    """Return the transform (4, 4) [mm] of an element's <origin>."""
    origin = element.find("origin")
    roll, pitch, yaw = _read_vector(origin, "rpy", (0.0, 0.0, 0.0))
    offset = _read_vector(origin, "xyz", (0.0, 0.0, 0.0)) * 1e3
    return transform(from_rpy(roll, pitch, yaw), offset)


def _read_axis(joint: ET.Element) -> Array:
    return _read_vector(joint.find("axis"), "xyz", (1.0, 0.0, 0.0))


def _name_of(joint: ET.Element) -> str:
    return str(joint.get("name"))


def _is_moving(joint: ET.Element) -> bool:
    return joint.get("type") in MOVING


def _find_end(joint: ET.Element, which: str) -> str | None:
    """Return the name of a joint's parent or child link; None where it lacks one."""
    end = joint.find(which)
    return None if end is None else end.get("link")


def _child(joint: ET.Element) -> str:
    return str(_find_end(joint, "child"))


def _parent(joint: ET.Element) -> str:
    return str(_find_end(joint, "parent"))


def _group_by_parent(root: ET.Element) -> dict[str, list[ET.Element]]:
    """Map each link to the joints that hang on it."""
    joints_on: dict[str, list[ET.Element]] = {}
    for joint in root.findall("joint"):
        joints_on.setdefault(_parent(joint), []).append(joint)
    return joints_on


def _check_tree(root: ET.Element, where: str) -> None:
    """Refuse links and joints that form no tree, with every problem: what hangs twice, on itself or
    on nothing."""
    links = {link.get("name") for link in root.findall("link")}
    problems, hanging = list[str](), set[str]()
    for joint in root.findall("joint"):
        place = f'{where}: joint "{joint.get("name")}"'
        problems += [f"{place}: {problem}" for problem in _find_end_problems(joint, links)]
        child = _child(joint)
        if child in hanging or child == _find_end(joint, "parent"):
            problems.append(
                f'{place}: link "{child}" hangs on another joint too, or on itself: a tree of '
                "links is expected. Remove one of the joints."
            )
        hanging.add(child)
    if problems:
        raise StudyError(*problems)


def _find_end_problems(joint: ET.Element, links: set[str | None]) -> list[str]:
    problems = []
    for which in ("parent", "child"):
        end = _find_end(joint, which)
        if end is None and None not in links:
            problems.append(f"it has no <{which} link=…/>. Add it.")
        elif end not in links:
            problems.append(f'its {which} "{end}" is not a <link> of the file. Name one that is.')
    return problems


def _find_chain(
    root: ET.Element, where: str, base: str | None, tip: str | None
) -> list[ET.Element]:
    """Find the joints from the base link (the root) to the tip; without one, to the tip with the
    most moving joints on its way."""
    joints_on = _group_by_parent(root)
    children = {_child(joint) for joints in joints_on.values() for joint in joints}
    links = {*joints_on, *children}
    for word, name in (("base", base), ("tip", tip)):
        if name is not None and name not in links:
            raise StudyError(
                f'{where}: {word} = "{name}" is not a link of the chain. {suggest(name, links)}'
            )
    if not joints_on:
        raise StudyError(f"{where}: expected one root link, found no joints. Is it a URDF?")
    if base is None:
        base = _find_root([link for link in joints_on if link not in children], where)
    paths = _list_paths(joints_on, base, tip, where)
    if not paths:
        raise StudyError(
            f'{where}: no chain leads from "{base}" to "{tip}": the tip must hang on the base.'
        )
    counts = [sum(map(_is_moving, path)) for path in paths]
    most = max(counts)
    if not most:
        destination = "" if tip is None else f' on the way to "{tip}"'
        raise StudyError(f"{where}: no moving joint found{destination}.")
    longest = [path for path, count in zip(paths, counts, strict=True) if count == most]
    return _choose_path(longest, most, where)


def _find_root(roots: list[str], where: str) -> str:
    """Return the one link that hangs on nothing. Raises StudyError where there are several."""
    if len(roots) == 1:
        return roots[0]
    listed = ", ".join(sorted(roots)[:5])
    raise StudyError(
        f'{where}: expected one root link, found {len(roots)}: {listed}. Say which: base = "…".'
    )


def _list_paths(
    joints_on: Mapping[str, list[ET.Element]], base: str, tip: str | None, where: str
) -> list[list[ET.Element]]:
    """List the joints on the way from the base to the tip, or to every link."""
    paths = list[list[ET.Element]]()
    stack: list[tuple[str, list[ET.Element]]] = [(base, [])]
    while stack:
        link, path = stack.pop()
        if len(path) > MAX_CHAIN_LENGTH:
            raise StudyError(f"{where}: the links form a loop. A serial chain is expected.")
        if tip is None or link == tip:
            paths.append(path)
        stack += [(_child(joint), [*path, joint]) for joint in joints_on.get(link, [])]
    return paths


def _choose_path(paths: Sequence[list[ET.Element]], moving: int, where: str) -> list[ET.Element]:
    """Choose, of paths with so many `moving` joints, the one that goes on furthest by fixed ones.
    Raises StudyError with the list where they are several arms, or end in several frames."""
    arms: dict[tuple[str, ...], list[list[ET.Element]]] = {}
    for path in paths:
        arms.setdefault(_moving_names(path), []).append(path)
    ends = list[list[ET.Element]]()
    for arm in arms.values():
        furthest = max(map(len, arm))
        ends += [path for path in arm if len(path) == furthest]
    places = [_find_end_place(path) for path in ends]
    same_place = all(np.allclose(place, places[0], rtol=0, atol=1e-9) for place in places)
    if same_place and len(arms) == 1:
        return ends[0]
    described = sorted(f'"{_child(path[-1])}" by {", ".join(_moving_names(path))}' for path in ends)
    raise StudyError(
        f"{where}: {len(ends)} chains have {moving} moving joint{'s' * (moving > 1)} each, and none "
        f"is the longest: to {'; '.join(described[:MAX_LISTED])}. Say which: "
        'tip = "…" under [robot] of a study, --tip of check.'
    )


def _moving_names(path: Sequence[ET.Element]) -> tuple[str, ...]:
    return tuple(_name_of(joint) for joint in path if _is_moving(joint))


def _find_end_place(path: Sequence[ET.Element]) -> Array:
    """Return the transform (4, 4) from a path's last moving joint to its end."""
    place = np.eye(4)
    for joint in reversed(path):
        if _is_moving(joint):
            break
        place = _read_origin(joint) @ place
    return place


def _list_joints_above(root: ET.Element, link: str, where: str) -> list[ET.Element]:
    """List the joints from the link that everything hangs on down to a link. Raises StudyError for
    links in a circle."""
    joint_above = {_child(joint): joint for joint in root.findall("joint")}
    above, visited = list[ET.Element](), {link}
    while link in joint_above:
        above.insert(0, joint_above[link])
        link = _parent(joint_above[link])
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
        g = _read_origin(joint)[:3, :3].T @ g
        axis = _read_axis(joint)
        turns = joint.get("type") not in ("fixed", "prismatic")
        tilt = np.linalg.norm(np.cross(axis, g))
        tilts = turns and tilt > UPRIGHT_TOLERANCE * np.linalg.norm(axis)
        if tilts or joint.get("type") == "floating":
            return None
    g = np.where(np.abs(g) < UPRIGHT_TOLERANCE, 0.0, g)
    x, y, z = (g / np.linalg.norm(g)).tolist()
    return x, y, z


def _read_body(link: ET.Element | None, place: Array) -> tuple[float, Array] | None:
    """Return (mass [kg], centre of mass [mm] where the link's frame stands at `place`); None where
    the link has no mass."""
    inertial = None if link is None else link.find("inertial")
    element = None if inertial is None else inertial.find("mass")
    if inertial is None or element is None:
        return None
    mass = float(_read_vector(element, "value", (0.0,))[0])
    return mass, (place @ _read_origin(inertial))[:3, 3]


def _sum_weights(root: ET.Element, start: str, stop: set[str]) -> tuple[float, Array] | None:
    """Sum (mass [kg], centre of mass [mm] in the frame of link `start`) of all that moves with it:
    the links on it and on them, at zero readings, but for those that hang on the joints `stop`;
    None where no link has a mass."""
    links = {str(link.get("name")): link for link in root.iter("link")}
    joints_on = _group_by_parent(root)
    bodies = list[tuple[float, Array]]()
    stack = [(start, np.eye(4))]
    while stack:
        name, place = stack.pop()
        body = _read_body(links.get(name), place)
        if body is not None:
            bodies.append(body)
        carried = [joint for joint in joints_on.get(name, []) if _name_of(joint) not in stop]
        stack += [(_child(joint), place @ _read_origin(joint)) for joint in carried]
    if not bodies:
        return None
    total = sum(mass for mass, _ in bodies)
    if not total:
        return total, np.zeros(3)
    return total, np.asarray(sum(mass * centre for mass, centre in bodies) / total)


def read_urdf(path: Path, base: str | None = None, tip: str | None = None) -> Robot:
    """A robot from a URDF file. Raises StudyError."""
    return read_urdf_text(read_text(path, "the URDF"), path.name, base, tip)


def read_urdf_text(text: str, where: str, base: str | None = None, tip: str | None = None) -> Robot:
    """A robot from a URDF's text (lengths m -> mm): the serial chain from link `base` to link
    `tip`. A joint carries the masses of all links that move with it, a gripper's and a tool's too.
    Raises StudyError.

    Entities and document types are refused: a URDF needs none, and they are how XML files attack
    their reader."""
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise StudyError(f"{where}: a document type or entity in a URDF is refused. Remove it.")
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise StudyError(f"{where}: not valid XML: {error}. Correct this place.") from None
    try:
        return _read_chain(root, where, base, tip)
    except StudyError as error:
        placed = [p if p.startswith(where) else f"{where}: {p}" for p in error.problems]
        raise StudyError(*placed) from None


def _read_chain(root: ET.Element, where: str, base: str | None, tip: str | None) -> Robot:
    _check_tree(root, where)
    chain = _find_chain(root, where, base, tip)
    moving = set(_moving_names(chain))
    pending, joints = np.eye(4), []
    for element in chain:
        pending = pending @ _read_origin(element)
        place = f'{where}: joint "{element.get("name")}"'
        _check_kind(element, place)
        if element.get("type") == "fixed":
            continue
        to_axis = transform(align_z(_check_axis(element, place)))
        limits = _read_limits(element, place)
        mass, com = None, np.zeros(3)
        weights = _sum_weights(root, _child(element), moving)
        if weights is not None:
            mass, com = weights[0], to_axis[:3, :3].T @ weights[1]
        x, y, z = com.tolist()
        prismatic = element.get("type") == "prismatic"
        joints.append(Joint(pending @ to_axis, prismatic, limits, mass, (x, y, z)))
        pending = inverse(to_axis)
    name = str(root.get("name", Path(where).stem))
    problem = find_name_problem(name)
    if problem is not None:
        raise StudyError(f"{where}: the robot's name is not valid: {problem}.")
    gravity = _find_gravity(root, _parent(chain[0]), where)
    return Robot(name, f"URDF {one_line(where)}", tuple(joints), pending, gravity)


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
    axis = _read_axis(element)
    if np.linalg.norm(axis) < 1e-9:
        raise StudyError(f'{place}: the axis has no length. Give its direction: xyz="0 0 1".')
    return axis


def _read_limits(element: ET.Element, place: str) -> tuple[float, float] | None:
    """Return a joint's limits [rad or mm]; None where it has none."""
    limit, kind = element.find("limit"), element.get("type")
    if limit is None or kind == "continuous" or not limit.get("upper"):
        return None
    scale = 1e3 if kind == "prismatic" else 1.0
    low = float(_read_vector(limit, "lower", (0.0,))[0]) * scale
    high = float(_read_vector(limit, "upper", (0.0,))[0]) * scale
    if low > high:
        raise StudyError(f"{place}: its lower limit is above the upper one. Exchange them.")
    return low, high
