"""URDF -> Robot: the one serial chain of moving joints in a file, base to tip."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET
from xml.sax.saxutils import escape

import numpy as np

from .._names import find_name_problem
from .._text import read_text
from .._typing import LARGEST, Array
from ..exceptions import StudyError, one_line, suggest
from .kinematics import Joint, Robot
from .rigid import align_z, from_rpy, inverse, to_rpy, transform

MOVING = ("revolute", "continuous", "prismatic")
AROUND = 'Or name a chain without it: base = "…", tip = "…".'
KINDS = (*MOVING, "fixed")  # planar and floating ones have more than one reading
UPRIGHT = 1e-3  # rad: files have 1.571 for a right angle, and no mount is known better


def _vector(element: ET.Element | None, key: str, default: tuple[float, ...]) -> Array:
    if element is None or element.get(key) is None:
        return np.array(default)
    try:
        out = np.array([float(v) for v in str(element.get(key)).split()])
    except ValueError:
        out = np.array([np.nan])
    if out.shape != (len(default),) or not (np.abs(out) <= LARGEST / 1e3).all():
        wanted = "one finite number" if len(default) == 1 else f"{len(default)} finite numbers"
        raise StudyError(
            f'<{element.tag} {key}="{element.get(key)}">: expected {wanted} below {LARGEST / 1e3:g}.'
        )
    return out


def _origin(element: ET.Element) -> Array:
    origin = element.find("origin")
    roll, pitch, yaw = _vector(origin, "rpy", (0.0, 0.0, 0.0))
    return transform(from_rpy(roll, pitch, yaw), _vector(origin, "xyz", (0.0, 0.0, 0.0)) * 1e3)


def _end(joint: ET.Element, which: str) -> str | None:
    """Name of a joint's parent or child link; None where it lacks one."""
    found = joint.find(which)
    return None if found is None else found.get("link")


def _child(joint: ET.Element) -> str:
    return str(_end(joint, "child"))


def _below(root: ET.Element) -> dict[str, list[ET.Element]]:
    """Link -> the joints that hang on it."""
    out: dict[str, list[ET.Element]] = {}
    for joint in root.findall("joint"):
        out.setdefault(str(_end(joint, "parent")), []).append(joint)
    return out


def _tree(root: ET.Element, where: str) -> None:
    """Refuses links and joints that are no tree, with every problem: what hangs twice, on itself or
    on nothing."""
    links = {link.get("name") for link in root.findall("link")}
    problems, hang = list[str](), set[str]()
    for joint in root.findall("joint"):
        said = f'{where}: joint "{joint.get("name")}"'
        for which in ("parent", "child"):
            if (end := _end(joint, which)) not in links:
                problems.append(
                    f'{said}: its {which} "{end}" is no <link> of the file. Name one that is.'
                    if end is not None
                    else f"{said}: it has no <{which} link=…/>. Add it."
                )
        child = _child(joint)
        if child in hang or child == _end(joint, "parent"):
            problems.append(
                f'{said}: link "{child}" hangs on another joint too, or on itself: a tree of links is expected. '
                "Remove one of the joints."
            )
        hang.add(child)
    if problems:
        raise StudyError(*problems)


def _chain(root: ET.Element, where: str, base: str | None, tip: str | None) -> list[ET.Element]:
    """The joints from the base link (the root) to the tip, without one to the tip with the most
    moving joints on its way."""
    below = _below(root)
    links = {*below, *(_child(j) for joints in below.values() for j in joints)}
    for word, name in (("base", base), ("tip", tip)):
        if name is not None and name not in links:
            raise StudyError(
                f'{where}: {word} = "{name}" is no link of the chain. {suggest(name, links)}'
            )
    roots = [
        link
        for link in below
        if link not in {_child(j) for joints in below.values() for j in joints}
    ]
    if not below:
        raise StudyError(f"{where}: expected one root link, found no joints. Is it a URDF?")
    if base is None and len(roots) != 1:
        raise StudyError(
            f"{where}: expected one root link, found {len(roots)}: {', '.join(sorted(roots)[:5])}. Say which: "
            'base = "…".'
        )
    paths: list[tuple[int, int, list[ET.Element]]] = []
    stack: list[tuple[str, list[ET.Element]]] = [(base or roots[0], [])]
    while stack:
        link, path = stack.pop()
        if len(path) > 1000:
            raise StudyError(f"{where}: the links form a loop. A serial chain is expected.")
        if tip is None or link == tip:
            paths.append((sum(j.get("type") in MOVING for j in path), -len(path), path))
        stack += [(_child(j), [*path, j]) for j in below.get(link, [])]
    if not paths:
        raise StudyError(
            f'{where}: no chain leads from "{base or roots[0]}" to "{tip}": the tip must hang on the base.'
        )
    best = max(count for count, _, _ in paths)
    if not best:
        raise StudyError(
            f"{where}: no moving joint found{'' if tip is None else f' on the way to {chr(34)}{tip}{chr(34)}'}."
        )
    return _only([path for count, _, path in paths if count == best], best, where)


def _only(paths: Sequence[list[ET.Element]], moving: int, where: str) -> list[ET.Element]:
    """Of paths with so many `moving` joints the one that goes on furthest by fixed ones. Raises
    StudyError with the list where they are several arms, or end in several frames."""
    arms: dict[tuple[str | None, ...], list[list[ET.Element]]] = {}
    for path in paths:
        arms.setdefault(tuple(j.get("name") for j in path if j.get("type") in MOVING), []).append(
            path
        )
    furthest = {names: max(map(len, some)) for names, some in arms.items()}
    ends = [path for names, some in arms.items() for path in some if len(path) == furthest[names]]
    places = [_end_of(path) for path in ends]
    if all(np.allclose(place, places[0], rtol=0, atol=1e-9) for place in places) and len(arms) == 1:
        return ends[0]
    listed = "; ".join(
        sorted(
            f'"{_child(path[-1])}" by '
            f"{', '.join(str(j.get('name')) for j in path if j.get('type') in MOVING)}"
            for path in ends
        )[:10]
    )
    raise StudyError(
        f"{where}: {len(ends)} chains have {moving} moving joint{'s' * (moving > 1)} each, and none is the longest: "
        f'to {listed}. Say which: tip = "…" under [robot] of a study, --tip of check.'
    )


def _end_of(path: Sequence[ET.Element]) -> Array:
    """(4, 4) where a path ends, seen from its last moving joint."""
    place = np.eye(4)
    for joint in reversed(path):
        if joint.get("type") in MOVING:
            break
        place = _origin(joint) @ place
    return place


def _gravity(root: ET.Element, base: str, where: str) -> tuple[float, float, float] | None:
    """Direction of gravity in a link: -z of the link that everything hangs on (REP 103), turned by
    the joints between; None where one of them turns about an axis that is not upright. Raises
    StudyError for links in a circle."""
    above, down, seen = {_child(j): j for j in root.findall("joint")}, list[ET.Element](), {base}
    while base in above:
        down.insert(0, above[base])
        base = str(_end(above[base], "parent"))
        if base in seen:
            raise StudyError(f"{where}: the links form a loop. A serial chain is expected.")
        seen.add(base)
    g = np.array([0.0, 0.0, -1.0])
    for joint in down:
        g = _origin(joint)[:3, :3].T @ g
        axis = _vector(joint.find("axis"), "xyz", (1.0, 0.0, 0.0))
        turns = joint.get("type") not in ("fixed", "prismatic")
        if (
            joint.get("type") == "floating"
            or turns
            and np.linalg.norm(np.cross(axis, g)) > UPRIGHT * np.linalg.norm(axis)
        ):
            return None
    g = np.where(np.abs(g) < UPRIGHT, 0.0, g)
    x, y, z = (g / np.linalg.norm(g)).tolist()
    return x, y, z


def _weights(root: ET.Element, start: str, stop: set[str]) -> tuple[float, Array] | None:
    """(mass [kg], centre of mass [mm] in the frame of link `start`) of all that moves with it: the
    links on it and on them, at zero readings, but for those that hang on the joints `stop`; None
    where no link has a mass."""
    links = {str(link.get("name")): link for link in root.iter("link")}
    below, found = _below(root), list[tuple[float, Array]]()
    stack = [(start, np.eye(4))]
    while stack:
        name, place = stack.pop()
        inertial = links[name].find("inertial") if name in links else None
        if inertial is not None and inertial.find("mass") is not None:
            found.append(
                (
                    float(_vector(inertial.find("mass"), "value", (0.0,))[0]),
                    (place @ _origin(inertial))[:3, 3],
                )
            )
        stack += [
            (_child(j), place @ _origin(j))
            for j in below.get(name, [])
            if str(j.get("name")) not in stop
        ]
    total = sum(mass for mass, _ in found)
    if not found:
        return None
    return total, np.asarray(sum(m * c for m, c in found) / total if total else np.zeros(3))


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
        return _robot(root, where, base, tip)
    except StudyError as error:
        raise StudyError(
            *(p if p.startswith(where) else f"{where}: {p}" for p in error.problems)
        ) from None


def _robot(root: ET.Element, where: str, base: str | None, tip: str | None) -> Robot:
    _tree(root, where)
    pending, joints = np.eye(4), []
    chain = _chain(root, where, base, tip)
    moving = {str(j.get("name")) for j in chain if j.get("type") in MOVING}
    for element in chain:
        pending = pending @ _origin(element)
        kind, said = element.get("type"), f'{where}: joint "{element.get("name")}"'
        if kind not in KINDS:
            raise StudyError(f'{said}: type "{kind}"; {", ".join(KINDS)} are known. {AROUND}')
        if kind == "fixed":
            continue
        if element.find("mimic") is not None:
            raise StudyError(
                f"{said} mimics another joint: every joint of the chain needs a reading of its own. Take <mimic> "
                f"out where it has one. {AROUND}"
            )
        axis = _vector(element.find("axis"), "xyz", (1.0, 0.0, 0.0))
        if np.linalg.norm(axis) < 1e-9:
            raise StudyError(f'{said}: the axis has no length. Give its direction: xyz="0 0 1".')
        B = transform(align_z(axis))
        limit, limits = element.find("limit"), None
        if limit is not None and kind != "continuous" and limit.get("upper"):
            scale = 1e3 if kind == "prismatic" else 1.0
            limits = (
                float(_vector(limit, "lower", (0.0,))[0]) * scale,
                float(_vector(limit, "upper", (0.0,))[0]) * scale,
            )
            if limits[0] > limits[1]:
                raise StudyError(f"{said}: its lower limit is above the upper one. Exchange them.")
        mass, com = None, np.zeros(3)
        if (carried := _weights(root, _child(element), moving)) is not None:
            mass, com = carried[0], B[:3, :3].T @ carried[1]
        joints.append(
            Joint(
                pending @ B,
                kind == "prismatic",
                limits,
                mass,
                (float(com[0]), float(com[1]), float(com[2])),
            )
        )
        pending = inverse(B)
    name = str(root.get("name", Path(where).stem))
    if (why := find_name_problem(name)) is not None:
        raise StudyError(f"{where}: the robot's name is not one: {why}.")
    gravity = _gravity(root, str(_end(chain[0], "parent")), where)
    return Robot(name, f"URDF {one_line(where)}", tuple(joints), pending, gravity)


def _fixed(root: ET.Element, parent: str, child: str, place: Array) -> None:
    joint = ET.SubElement(root, "joint", name=f"{parent}-{child}", type="fixed")
    _place(joint, place)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(root, "link", name=child)


def _place(joint: ET.Element, place: Array) -> None:
    ET.SubElement(
        joint,
        "origin",
        xyz=" ".join(repr(float(v) / 1e3) for v in place[:3, 3]),
        rpy=" ".join(repr(v) for v in to_rpy(place[:3, :3])),
    )


def _comment(note: str) -> Any:
    """A comment that its words cannot close: ElementTree writes them as they are, and -- ends one
    for some readers."""
    return ET.Comment(f" {re.sub('-(?=-)', '- ', escape(one_line(note)))} ")


def write_urdf(
    robot: Robot, tips: Mapping[str, Array], frames: Mapping[str, Array], notes: Sequence[str] = ()
) -> str:
    """A URDF of a chain: links base, link1 … flange; `tips` (4, 4) hang on the flange, `frames` (4,
    4) on the base [mm]. Where the base does not stand upright it hangs on a link world that does.

    Inertias are nought and efforts and velocities are 0: they are not known here.
    """
    root = ET.Element("robot", name=robot.name)
    root.extend(_comment(note) for note in notes)
    if robot.gravity is None or robot.gravity == (0.0, 0.0, -1.0):
        ET.SubElement(root, "link", name="base")
    else:
        ET.SubElement(root, "link", name="world")
        _fixed(root, "world", "base", transform(align_z(-np.array(robot.gravity)).T))
    for k, joint in enumerate(robot.joints, 1):
        kind = "prismatic" if joint.prismatic else "revolute" if joint.limits else "continuous"
        element = ET.SubElement(root, "joint", name=f"joint{k}", type=kind)
        _place(element, joint.before)
        ET.SubElement(element, "parent", link="base" if k == 1 else f"link{k - 1}")
        ET.SubElement(element, "child", link=f"link{k}")
        ET.SubElement(element, "axis", xyz="0 0 1")
        if joint.limits is not None:
            low, high = (v / 1e3 if joint.prismatic else v for v in joint.limits)
            ET.SubElement(
                element,
                "limit",
                lower=repr(float(low)),
                upper=repr(float(high)),
                effort="0",
                velocity="0",
            )
        link = ET.SubElement(root, "link", name=f"link{k}")
        if joint.mass is not None:
            inertial = ET.SubElement(link, "inertial")
            ET.SubElement(
                inertial,
                "origin",
                xyz=" ".join(repr(float(v) / 1e3) for v in joint.com),
                rpy="0 0 0",
            )
            ET.SubElement(inertial, "mass", value=repr(float(joint.mass)))
            ET.SubElement(inertial, "inertia", ixx="0", ixy="0", ixz="0", iyy="0", iyz="0", izz="0")
    _fixed(root, f"link{robot.n}", "flange", robot.last)
    for parent, places in (("flange", tips), ("base", frames)):
        for name, place in places.items():
            _fixed(root, parent, name, place)
    ET.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
