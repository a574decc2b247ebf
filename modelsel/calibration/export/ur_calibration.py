"""The kinematics file of Universal Robots' ROS driver: what its package ur_calibration writes of an
arm, and ur_description reads."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from hashlib import sha256
from typing import TYPE_CHECKING

import numpy as np

from ..._typing import Array
from ...exceptions import StudyError, one_line
from ...robot.alignment import USUAL_BASES, Alignment, align_chains
from ...robot.kinematics import Joint, Robot, forward
from ...robot.rigid import from_rpy, inverse, rotation_matrix, to_rpy, transform
from ...robot.ur_kinematics import LINKS
from ..constant_part import build_constant_chain
from .chains import describe_link_places, measure_chain
from .form import Exported

if TYPE_CHECKING:
    from ..calibration import Calibration

LENGTHS = ("x", "y", "z")
ANGLES = ("roll", "pitch", "yaw")


def to_ur_calibration(c: Calibration, notes: Sequence[str] = ()) -> Exported:
    """Write the calibrated chain in the frames of ur_description: the origins of its six joints,
    the first in its link base_link_inertia, the controller's base. Raises StudyError for an arm
    that is not built like Universal Robots'."""
    made = build_constant_chain(c)
    alignment = _align(c.robot)
    before = [joint.before for joint in made.robot.joints]
    origins = alignment.express(before)
    to_tool = inverse(alignment.frames[-1]) @ made.robot.last
    places = {name: to_tool @ place for name, place in made.targets.items()}
    remarks = _describe(places, alignment.base)
    text = _format(origins, [made.robot.source, *notes, *remarks])
    from_base = inverse(alignment.base)

    def read(text: str, target: int) -> Callable[[Array], Array]:
        joints = tuple(Joint(origin) for origin in _parse(text))
        back = Robot("export", "", joints, np.eye(4))
        offset = places[c.targets[target]][:3, 3]
        R = from_base[:3, :3]
        t = from_base[:3, 3]
        return lambda q: forward(back, q, offset) @ R.T + t

    return measure_chain(c, text, read, remarks)


def _align(robot: Robot) -> Alignment:
    """Align a nominal arm with the frames of ur_description. Raises StudyError where it is none of
    Universal Robots'."""
    reason = f"it has {robot.n} joints"
    if robot.n == len(LINKS) and not any(robot.prismatic):
        for base in USUAL_BASES:
            reference = _build_reference(robot, base)
            try:
                return align_chains(robot, reference)
            except ValueError as error:
                reason = str(error)
    raise StudyError(
        f'"{robot.name}" is not an arm of Universal Robots with the controller\'s joint signs and zeros: '
        f'{reason}. The forms "urdf" and "mdh" take another arm.'
    )


def _build_reference(robot: Robot, base: Array) -> Robot:
    """Build the nominal arm of ur_description with the lengths of a robot, whose frame 0 stands at
    `base` in the controller's: at zero readings the arm is stretched along -x, axes 2, 3, 4 and 6
    point along -y, axis 5 along -z, and a joint's frame stands where its link's normal leaves."""
    frames = []
    at = base
    for joint in robot.joints:
        at = at @ joint.before
        frames.append(at)
    flange = at @ robot.last
    d1 = frames[1][2, 3]
    x3 = frames[2][0, 3]
    x4 = frames[3][0, 3]
    d4 = -frames[4][1, 3]
    d5 = d1 - frames[5][2, 3]
    d6 = -flange[1, 3] - d4
    upright = rotation_matrix(0, np.pi / 2)
    befores = (
        transform(None, (0, 0, d1)),
        transform(upright),
        transform(None, (x3, 0, 0)),
        transform(None, (x4 - x3, 0, d4)),
        transform(upright, (0, -d5, 0)),
        transform(upright.T, (0, d6, 0)),
    )
    return replace(robot, joints=tuple(map(Joint, befores)))


def _describe(places: Mapping[str, Array], base: Array) -> tuple[str, ...]:
    """Describe what the file has no place for: targets, frame 0, and whose file it is."""
    remarks = describe_link_places("base", "tool0", places, base)
    remarks.append(
        "the hash is not the controller's: the driver will say that the calibration is not the "
        "robot's own; this warning is expected"
    )
    return tuple(remarks)


def _format(origins: Sequence[Array], notes: Sequence[str]) -> str:
    """Write the file: metres and radians in full, roll-pitch-yaw as in a URDF."""
    lines = ["kinematics:"]
    for link, origin in zip(LINKS, origins, strict=True):
        lines.append(f"  {link}:")
        metres = origin[:3, 3] / 1e3
        for key, value in zip(LENGTHS, metres.tolist(), strict=True):
            lines.append(f"    {key}: {_format_number(value)}")
        angles = to_rpy(origin[:3, :3])
        for key, value in zip(ANGLES, angles, strict=True):
            lines.append(f"    {key}: {_format_number(value)}")
    digest = sha256("\n".join(lines).encode()).hexdigest()
    lines.append(f"  hash: modelsel_{digest[:16]}")
    comments = [f"# {one_line(note)}" for note in notes]
    return "\n".join([*comments, *lines]) + "\n"


def _format_number(value: float) -> str:
    """Write a number in full, with a point: YAML 1.1 takes 1e-05 for a word."""
    written = repr(value)
    digits, exponent, power = written.partition("e")
    if exponent and "." not in digits:
        digits += ".0"
    return f"{digits}{exponent}{power}"


def _parse(text: str) -> list[Array]:
    """Return the origins (6, 4, 4) [mm] of a file of this form."""
    numbers: dict[str, dict[str, float]] = {}
    link = ""
    for line in text.splitlines():
        key, _, value = line.strip().partition(": ")
        if key.rstrip(":") in LINKS:
            link = key.rstrip(":")
            numbers[link] = {}
        elif key in LENGTHS or key in ANGLES:
            numbers[link][key] = float(value)
    origins = []
    for link in LINKS:
        metres = np.array([numbers[link][key] for key in LENGTHS])
        roll, pitch, yaw = (numbers[link][key] for key in ANGLES)
        origins.append(transform(from_rpy(roll, pitch, yaw), metres * 1e3))
    return origins
