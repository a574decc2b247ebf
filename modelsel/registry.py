"""The table of mechanisms: explicit, passed as an argument, never changed by an import.

An entry is a function `robot -> Mechanism` (None where it does not apply), or PerJoint for one that exists once a joint.
Outsiders join by the entry point group `modelsel.mechanisms`: () -> dict of entries (`with_plugins`).
"""
from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from .errors import StudyError, suggest
from .mechanisms import couplings, geometry, gravity_effects
from .robot import Robot
from .screws import Mechanism


@dataclass(frozen=True)
class PerJoint:
    """A mechanism that exists once a joint: `build(robot, joint)` for each of `joints(robot)`."""

    build: Callable[[Robot, int], Mechanism]
    joints: Callable[[Robot], tuple[int, ...]]


Entry = Callable[[Robot], Mechanism | None] | PerJoint
Registry = Mapping[str, Entry]

BUILTIN: Registry = {
    "geometric": geometry.geometric,
    "joint2-twist": gravity_effects.joint2_twist,
    "joint3-twist": gravity_effects.joint3_twist,
    "gravity-twist": gravity_effects.gravity_twist,
    "backlash": PerJoint(gravity_effects.backlash, gravity_effects.gravity_joints),
    "wrist-coupling": PerJoint(couplings.wrist_coupling, couplings.wrist_joints),
    "base-tilt": gravity_effects.base_tilt,
}


def parts(name: str, robot: Robot, registry: Registry = BUILTIN) -> tuple[Mechanism, ...]:
    """The mechanisms a registered name stands for on this robot, one a joint where it has joints.

    "backlash:3" is joint 3's alone. Empty where the name does not apply to the robot. Raises StudyError for an unknown
    name or joint.
    """
    stem, _, joint = name.partition(":")
    if stem not in registry:
        raise StudyError(f'unknown mechanism "{name}". {suggest(stem, registry)}')
    entry = registry[stem]
    if not isinstance(entry, PerJoint):
        if joint:
            raise StudyError(f'"{stem}" takes no joint; write "{stem}".')
        built = entry(robot)
        return () if built is None else (built,)
    joints = entry.joints(robot)
    if joint:
        if joint not in map(str, joints):
            raise StudyError(f'"{name}": {stem} applies to joints {", ".join(map(str, joints)) or "none"} of {robot.name}.')
        joints = (int(joint),)
    return tuple(entry.build(robot, j) for j in joints)


def mechanism(name: str, robot: Robot, registry: Registry = BUILTIN) -> Mechanism:
    """One mechanism for a name: all its joints together where it has joints. Raises StudyError where none applies."""
    found = parts(name, robot, registry)
    if not found:
        raise StudyError(f'"{name}" does not apply to {robot.name}.')
    if len(found) == 1:
        return found[0]
    return Mechanism(name, tuple(t for part in found for t in part.terms), " ".join(p.sentence for p in found),
                     "; ".join(p.equation for p in found), found[0].source)


def every(robot: Robot, registry: Registry = BUILTIN) -> tuple[Mechanism, ...]:
    """Every mechanism that applies to the robot, one a joint where it has joints."""
    return tuple(part for name in registry for part in parts(name, robot, registry))


def with_plugins(registry: Registry = BUILTIN) -> tuple[Registry, dict[str, str]]:
    """The registry with every installed plug-in's entries, and what went wrong with the plug-ins that could not load."""
    from importlib.metadata import entry_points
    table, broken = dict(registry), {}
    for point in sorted(entry_points(group="modelsel.mechanisms"), key=lambda p: p.name):
        try:
            table |= {name: entry for name, entry in point.load()().items() if name not in registry}
        except Exception as error:  # a stranger's code may fail in any way; it is listed and stops nothing
            broken[point.name] = f"{type(error).__name__}: {error}"
    return table, broken
