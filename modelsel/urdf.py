"""URDF -> Robot: the one serial chain of moving joints in a file, base to tip."""
from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from .errors import StudyError
from .rigid import Array, align_z, inverse, rpy, transform
from .robot import Joint, Robot

MOVING = ("revolute", "continuous", "prismatic")


def _vector(element: ET.Element | None, key: str, default: tuple[float, ...]) -> Array:
    if element is None or element.get(key) is None:
        return np.array(default)
    try:
        out = np.array([float(v) for v in str(element.get(key)).split()])
    except ValueError:
        out = np.array([np.nan])
    if out.shape != (len(default),) or not np.isfinite(out).all():
        raise StudyError(f'<{element.tag} {key}="{element.get(key)}">: expected {len(default)} finite numbers')
    return out


def _origin(element: ET.Element) -> Array:
    origin = element.find("origin")
    roll, pitch, yaw = _vector(origin, "rpy", (0.0, 0.0, 0.0))
    return transform(rpy(roll, pitch, yaw), _vector(origin, "xyz", (0.0, 0.0, 0.0)) * 1e3)


def _chain(root: ET.Element, where: str) -> list[ET.Element]:
    """The joints from the root link to the tip with the most moving joints below it."""
    below: dict[str, list[ET.Element]] = {}
    children = set[str]()
    for joint in root.iter("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is None or child is None:
            continue
        below.setdefault(str(parent.get("link")), []).append(joint)
        children.add(str(child.get("link")))
    roots = [link for link in below if link not in children]
    if len(roots) != 1:
        raise StudyError(f"{where}: expected one root link, found {len(roots)}: {', '.join(sorted(roots)[:5])}")

    paths: list[tuple[int, int, list[ET.Element]]] = []
    stack: list[tuple[str, list[ET.Element]]] = [(roots[0], [])]
    while stack:
        link, path = stack.pop()
        if len(path) > 1000:
            raise StudyError(f"{where}: the links form a loop; a serial chain is expected")
        paths.append((sum(j.get("type") in MOVING for j in path), -len(path), path))
        stack += [(str(j.find("child").get("link")), [*path, j]) for j in below.get(link, [])]  # type: ignore[union-attr]
    best = max(count for count, _, _ in paths)
    if not best:
        raise StudyError(f"{where}: no moving joint found")
    longest = [path for count, _, path in paths if count == best]
    return max(longest, key=len)


def read_urdf(path: Path) -> Robot:
    """A robot from a URDF file (lengths m -> mm; masses and centres of mass kept). Raises StudyError.

    Entities and document types are refused: a URDF needs none, and they are how XML files attack their reader.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise StudyError(f"{path.name}: the URDF cannot be read: {getattr(error, 'strerror', None) or 'not text'}") from None
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise StudyError(f"{path.name}: a document type or entity in a URDF is refused; remove it")
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise StudyError(f"{path.name}: not valid XML: {error}") from None
    links = {str(link.get("name")): link for link in root.iter("link")}
    pending, joints = np.eye(4), []
    for element in _chain(root, path.name):
        pending = pending @ _origin(element)
        kind = element.get("type")
        if kind not in MOVING:
            continue
        axis = _vector(element.find("axis"), "xyz", (1.0, 0.0, 0.0))
        if not axis.any():
            raise StudyError(f'{path.name}: joint "{element.get("name")}": the axis has no length')
        B = transform(align_z(axis))
        limit, limits = element.find("limit"), None
        if limit is not None and kind != "continuous" and limit.get("upper"):
            scale = 1e3 if kind == "prismatic" else 1.0
            limits = (float(_vector(limit, "lower", (0.0,))[0]) * scale, float(_vector(limit, "upper", (0.0,))[0]) * scale)
        child = links.get(str(element.find("child").get("link")))  # type: ignore[union-attr]
        inertial = child.find("inertial") if child is not None else None
        mass, com = None, np.zeros(3)
        if inertial is not None and inertial.find("mass") is not None:
            mass = float(_vector(inertial.find("mass"), "value", (0.0,))[0])
            com = B[:3, :3].T @ _origin(inertial)[:3, 3]
        joints.append(Joint(pending @ B, kind == "prismatic", limits, mass, (float(com[0]), float(com[1]), float(com[2]))))
        pending = inverse(B)
    return Robot(str(root.get("name", path.stem)), f"URDF {path.name}", tuple(joints), pending)
