"""The serial chain of a URDF: the joints from a base link to a tip."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from xml.etree import ElementTree as ET

import numpy as np

from .._typing import Array
from ..exceptions import StudyError, suggest
from .urdf_elements import (
    KINDS,
    child_of,
    find_end,
    group_by_parent,
    is_moving,
    read_joint_name,
    read_origin,
)

# joints from base to tip; more are a loop
MAX_CHAIN_LENGTH = 1000
# chains and roots that a message lists
MAX_LISTED = 10


def check_tree(root: ET.Element, where: str) -> None:
    """Refuse links and joints that form no tree, with every problem: what hangs twice, on itself or
    on nothing."""
    links = {link.get("name") for link in root.findall("link")}
    problems = list[str]()
    hanging = set[str]()
    names = set[str]()
    for joint in root.findall("joint"):
        name = joint.get("name")
        place = f'{where}: joint "{name}"'
        if name is not None and name in names:
            problems.append(f"{place}: another joint has this name, too. Rename one of them.")
        names.add(name or "")
        for problem in _find_end_problems(joint, links):
            problems.append(f"{place}: {problem}")
        child = child_of(joint)
        parent = find_end(joint, "parent")
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
        end = find_end(joint, which)
        if end is None and None not in links:
            problems.append(f"it has no <{which} link=…/>. Add it.")
        elif end not in links:
            problems.append(f'its {which} "{end}" is not a <link> of the file. Name one that is.')
    return problems


def find_chain(root: ET.Element, where: str, base: str | None, tip: str | None) -> list[ET.Element]:
    """Find the joints from the base link (the root) to the tip; without one, to the tip with the
    most moving joints on its way."""
    joints_on = group_by_parent(root)
    children = {child_of(joint) for joints in joints_on.values() for joint in joints}
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
    paths = _list_paths(joints_on, base, tip, where)
    if not paths:
        raise StudyError(
            f'{where}: no chain leads from "{base}" to "{tip}": the tip must hang on the base.'
        )
    counts = [sum(map(is_moving, path)) for path in paths]
    most = max(counts)
    if not most:
        destination = "" if tip is None else f' on the way to "{tip}"'
        unknown = _describe_unknown_kinds(paths)
        raise StudyError(f"{where}: no moving joint found{destination}.{unknown}")
    longest = []
    for path, count in zip(paths, counts, strict=True):
        has_most = count == most
        if has_most:
            longest.append(path)
    return _choose_path(longest, most, where)


def _describe_unknown_kinds(paths: Sequence[Sequence[ET.Element]]) -> str:
    """Name the first joint whose type is not one that is read; empty where there is none."""
    for joint in chain.from_iterable(paths):
        kind = joint.get("type")
        if kind not in KINDS:
            name = read_joint_name(joint)
            return f' Joint "{name}" has type "{kind}"; {", ".join(KINDS)} are known.'
    return ""


def _find_root(roots: list[str], where: str) -> str:
    """Return the one link that hangs on nothing. Raises StudyError where there are several, or
    none."""
    if len(roots) == 1:
        return roots[0]
    if not roots:
        raise StudyError(f"{where}: the links form a loop. A serial chain is expected.")
    listed = ", ".join(sorted(roots)[:5])
    raise StudyError(
        f"{where}: expected one root link, found {len(roots)}: {listed}. Say which: "
        'base = "…" under [robot] of a study, --base of a command.'
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
        is_loop = len(path) > MAX_CHAIN_LENGTH
        if is_loop:
            raise StudyError(f"{where}: the links form a loop. A serial chain is expected.")
        is_end = tip is None or link == tip
        if is_end:
            paths.append(path)
        following = joints_on.get(link, [])
        for joint in following:
            child = child_of(joint)
            longer = [*path, joint]
            stack.append((child, longer))
    return paths


def _choose_path(paths: Sequence[list[ET.Element]], moving: int, where: str) -> list[ET.Element]:
    """Choose, of paths with so many `moving` joints, the one that goes on furthest by fixed ones.
    Raises StudyError with the list where they are several arms, or end in several frames."""
    arms: dict[tuple[str, ...], list[list[ET.Element]]]
    arms = {}
    for path in paths:
        names = list_moving_names(path)
        arm = arms.setdefault(names, [])
        arm.append(path)
    ends = list[list[ET.Element]]()
    for arm in arms.values():
        furthest = max(map(len, arm))
        ends += [path for path in arm if len(path) == furthest]
    places = [_find_end_place(path) for path in ends]
    same_place = np.allclose(places, places[0], rtol=0, atol=1e-9)
    is_one_arm = len(arms) == 1
    if same_place and is_one_arm:
        return ends[0]
    described = []
    for path in ends:
        last_joint = path[-1]
        end = child_of(last_joint)
        joint_names = list_moving_names(path)
        joints = ", ".join(joint_names)
        described.append(f'"{end}" by {joints}')
    described.sort()
    shown = described[:MAX_LISTED]
    listed = "; ".join(shown)
    plural = "s" if moving > 1 else ""
    raise StudyError(
        f"{where}: {len(ends)} chains have {moving} moving joint{plural} each, and none "
        f"is the longest: to {listed}. Say which: "
        'tip = "…" under [robot] of a study, --tip of a command.'
    )


def list_moving_names(path: Sequence[ET.Element]) -> tuple[str, ...]:
    """List the names of the joints that move on a path."""
    names = []
    for joint in path:
        name = read_joint_name(joint)
        if is_moving(joint):
            names.append(name)
    return tuple(names)


def _find_end_place(path: Sequence[ET.Element]) -> Array:
    """Return the transform (4, 4) from a path's last moving joint to its end."""
    place = np.eye(4)
    for joint in reversed(path):
        if is_moving(joint):
            break
        place = read_origin(joint) @ place
    return place
