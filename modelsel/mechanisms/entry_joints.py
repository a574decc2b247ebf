"""The joints that an entry of the registry exists for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from numbers import Integral

from .._arguments import describe_value
from ..exceptions import StudyError
from ..robot.kinematics import Robot

Joints = Callable[[Robot], tuple[int, ...]] | Sequence[int]


def list_entry_joints(name: str, joints: Joints | None, robot: Robot) -> tuple[int, ...]:
    """List the joints of an entry on a robot: those that a function returns for it, or, of numbers
    that are given, those that it has. Raises StudyError where they are neither."""
    if joints is None:
        return ()
    if callable(joints):
        return joints(robot)
    is_listed = isinstance(joints, Sequence)
    if not is_listed or not all(_is_number(joint) for joint in joints):
        found = describe_value(joints)
        raise StudyError(
            f'the registry\'s "{name}": joints: their numbers, as (1, 2, 3), or a function robot -> '
            f"numbers was expected, found {found}."
        )
    once = dict.fromkeys(int(joint) for joint in joints)
    return tuple(joint for joint in once if 1 <= joint <= robot.n)


def choose_entry_joints(
    name: str, joint: str | None, robot: Robot, joints: Joints | None
) -> tuple[int, ...]:
    """Choose the joints of an entry that a name stands for: one, or all that it applies to. Raises
    StudyError for a joint that it does not apply to."""
    every = list_entry_joints(name, joints, robot)
    if joint is None:
        return every
    words = [str(j) for j in every]
    if joint in words:
        chosen = int(joint)
        return (chosen,)
    numbers = ", ".join(words)
    where = f"joint {numbers} of {robot.name}"
    if not words:
        where = f"no joint of {robot.name}"
    elif len(words) > 1:
        where = f"joints {numbers} of {robot.name}"
    stem, _, _ = name.partition(":")
    problem = f"{stem} applies to {where}"
    raise StudyError(f'"{name}": {problem}.')


def _is_number(joint: object) -> bool:
    return isinstance(joint, Integral) and not isinstance(joint, bool)
