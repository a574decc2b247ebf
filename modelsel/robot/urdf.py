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


def _read_origin(element: ET.Element) -> Array:
    """Return the transform (4, 4) [mm] of an element's <origin>."""
    origin = element.find("origin")
    zeros = (0.0, 0.0, 0.0)
    roll, pitch, yaw = _read_vector(
        origin,
        "rpy",
        zeros,
    )
    metres = _read_vector(
        origin,
        "xyz",
        zeros,
    )
    R = from_rpy(roll, pitch, yaw)
    return transform(R, metres * 1e3)


def _read_axis(joint: ET.Element) -> Array:
    axis = joint.find("axis")
    return _read_vector(
        axis,
        "xyz",
        default=(1.0, 0.0, 0.0),
    )


def _name_of(joint: ET.Element) -> str:
    return str(joint.get("name"))


def _is_moving(joint: ET.Element) -> bool:
    kind = joint.get("type")
    return kind in MOVING


def _find_end(joint: ET.Element, which: str) -> str | None:
    """Return the name of a joint's parent or child link; None where it lacks one."""
    end = joint.find(which)
    if end is None:
        return None
    return end.get("link")


def _child(joint: ET.Element) -> str:
    return str(_find_end(joint, "child"))


def _parent(joint: ET.Element) -> str:
    return str(_find_end(joint, "parent"))


def _group_by_parent(root: ET.Element) -> dict[str, list[ET.Element]]:
    """Map each link to the joints that hang on it."""
    joints_on: dict[str, list[ET.Element]] = {}
    for joint in root.findall("joint"):
        parent = _parent(joint)
        hanging = joints_on.setdefault(parent, [])
        hanging.append(joint)
    return joints_on


def _check_tree(root: ET.Element, where: str) -> None:
    """Refuse links and joints that form no tree, with every problem: what hangs twice, on itself or
    on nothing."""
    links = {link.get("name") for link in root.findall("link")}
    problems = list[str]()
    hanging = set[str]()
    for joint in root.findall("joint"):
        name = joint.get("name")
        place = f'{where}: joint "{name}"'
        for problem in _find_end_problems(joint, links):
            problems.append(f"{place}: {problem}")
        child = _child(joint)
        parent = _find_end(joint, "parent")
        if child in hanging or child == parent:
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
            suggestion = suggest(name, links)
            raise StudyError(f'{where}: {word} = "{name}" is not a link of the chain. {suggestion}')
    if not joints_on:
        raise StudyError(f"{where}: expected one root link, found no joints. Is it a URDF?")
    if base is None:
        roots = [link for link in joints_on if link not in children]
        base = _find_root(roots, where)
    paths = _list_paths(
        joints_on,
        base,
        tip,
        where,
    )
    if not paths:
        raise StudyError(
            f'{where}: no chain leads from "{base}" to "{tip}": the tip must hang on the base.'
        )
    counts = [sum(map(_is_moving, path)) for path in paths]
    most = max(counts)
    if not most:
        destination = "" if tip is None else f' on the way to "{tip}"'
        raise StudyError(f"{where}: no moving joint found{destination}.")
    longest = []
    for path, count in zip(paths, counts, strict=True):
        has_most = count == most
        if has_most:
            longest.append(path)
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
    stack: list[tuple[str, list[ET.Element]]]
    stack = [(base, [])]
    while stack:
        link, path = stack.pop()
        if len(path) > MAX_CHAIN_LENGTH:
            raise StudyError(f"{where}: the links form a loop. A serial chain is expected.")
        is_end = tip is None or link == tip
        if is_end:
            paths.append(path)
        hanging = joints_on.get(link, [])
        for joint in hanging:
            child = _child(joint)
            longer = [*path, joint]
            stack.append((child, longer))
    return paths


def _choose_path(paths: Sequence[list[ET.Element]], moving: int, where: str) -> list[ET.Element]:
    """Choose, of paths with so many `moving` joints, the one that goes on furthest by fixed ones.
    Raises StudyError with the list where they are several arms, or end in several frames."""
    arms: dict[tuple[str, ...], list[list[ET.Element]]]
    arms = {}
    for path in paths:
        names = _moving_names(path)
        arm = arms.setdefault(names, [])
        arm.append(path)
    ends = list[list[ET.Element]]()
    for arm in arms.values():
        furthest = max(map(len, arm))
        ends += [path for path in arm if len(path) == furthest]
    places = [_find_end_place(path) for path in ends]
    same_place = np.allclose(
        places,
        places[0],
        rtol=0,
        atol=1e-9,
    )
    if same_place and len(arms) == 1:
        return ends[0]
    described = []
    for path in ends:
        end = _child(path[-1])
        joints = ", ".join(_moving_names(path))
        described.append(f'"{end}" by {joints}')
    described.sort()
    listed = "; ".join(described[:MAX_LISTED])
    plural = "s" if moving > 1 else ""
    raise StudyError(
        f"{where}: {len(ends)} chains have {moving} moving joint{plural} each, and none "
        f"is the longest: to {listed}. Say which: "
        'tip = "…" under [robot] of a study, --tip of check.'
    )


def _moving_names(path: Sequence[ET.Element]) -> tuple[str, ...]:
    names = []
    for joint in path:
        name = _name_of(joint)
        if _is_moving(joint):
            names.append(name)
    return tuple(names)


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
    above = list[ET.Element]()
    visited = {link}
    while link in joint_above:
        joint = joint_above[link]
        above.insert(0, joint)
        link = _parent(joint)
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
        origin = _read_origin(joint)
        R = origin[:3, :3]
        g = R.T @ g
        axis = _read_axis(joint)
        turns = kind not in ("fixed", "prismatic")
        tilt = np.linalg.norm(np.cross(axis, g))
        length = np.linalg.norm(axis)
        is_tilted = tilt > UPRIGHT_TOLERANCE * length
        if kind == "floating":
            return None
        if turns and is_tilted:
            return None
    is_small = np.abs(g) < UPRIGHT_TOLERANCE
    g = np.where(
        is_small,
        0.0,
        g,
    )
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
    values = _read_vector(
        element,
        "value",
        default=(0.0,),
    )
    mass = float(values[0])
    centre = place @ _read_origin(inertial)
    return mass, centre[:3, 3]


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
        link = links.get(name)
        body = _read_body(link, place)
        if body is not None:
            bodies.append(body)
        for joint in joints_on.get(name, []):
            if _name_of(joint) in stop:
                continue
            child = _child(joint)
            origin = _read_origin(joint)
            child_place = place @ origin
            stack.append((child, child_place))
    if not bodies:
        return None
    total = 0.0
    moment = np.zeros(3)
    for mass, centre in bodies:
        total += mass
        moment += mass * centre
    if not total:
        return total, np.zeros(3)
    return total, moment / total


def read_urdf(path: Path, base: str | None = None, tip: str | None = None) -> Robot:
    """A robot from a URDF file. Raises StudyError."""
    text = read_text(path, "the URDF")
    return read_urdf_text(
        text,
        path.name,
        base,
        tip,
    )


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
    chain = _find_chain(
        root,
        where,
        base,
        tip,
    )
    moving = set(_moving_names(chain))
    pending = np.eye(4)
    joints = []
    for element in chain:
        pending = pending @ _read_origin(element)
        name = element.get("name")
        place = f'{where}: joint "{name}"'
        _check_kind(element, place)
        kind = element.get("type")
        if kind == "fixed":
            continue
        axis = _check_axis(element, place)
        to_axis = transform(align_z(axis))
        limits = _read_limits(element, place)
        mass = None
        com = np.zeros(3)
        weights = _sum_weights(
            root,
            _child(element),
            moving,
        )
        if weights is not None:
            mass, centre = weights
            R = to_axis[:3, :3]
            com = R.T @ centre
        x, y, z = com.tolist()
        joint = Joint(
            before=pending @ to_axis,
            prismatic=kind == "prismatic",
            limits=limits,
            mass=mass,
            com=(x, y, z),
        )
        joints.append(joint)
        pending = inverse(to_axis)
    robot_name = str(root.get("name", Path(where).stem))
    problem = find_name_problem(robot_name)
    if problem is not None:
        raise StudyError(f"{where}: the robot's name is not valid: {problem}.")
    first_link = _parent(chain[0])
    return Robot(
        robot_name,
        source=f"URDF {one_line(where)}",
        joints=tuple(joints),
        last=pending,
        gravity=_find_gravity(root, first_link, where),
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
    axis = _read_axis(element)
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
    lower = _read_vector(limit, "lower", (0.0,))
    upper = _read_vector(limit, "upper", (0.0,))
    low = float(lower[0]) * scale
    high = float(upper[0]) * scale
    if low > high:
        raise StudyError(f"{place}: its lower limit is above the upper one. Exchange them.")
    return low, high
