"""How the far end of a link moves under the weight beyond it.

Either its end alone yields, as a flange does: it turns with the moment there. Or the link bends all
along as a beam that is clamped where its own joint is (Euler and Bernoulli): under a moment M and a
force F at its end, at L from where it is clamped, it turns there by c (M + L×F/2) and shifts by
c (M/2 + L×F/3)×L, with one compliance c. A moment along it twists it, a round tube of metal by 1.3 c
times that moment; or by a compliance of its own."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from .._typing import Array
from ..robot.gravity import G, declares_masses, keeps_slide_upright
from ..robot.kinematics import Robot
from .causes import ONE, Cause, Named, Number
from .terms import Screw

# mm: a shorter link yields at its end
SHORTEST = 50.0
# how much more a round tube of metal yields to a moment along it than to one across: 1 + 0.3, Poisson's ratio
ROUND = 1.3
# digits of the numbers of a beam
DIGITS = 9
NOTHING: Mapping[str, Cause] = MappingProxyType({})
# N m, of 1 kg
OF_ONE_KG = "N m/kg"


def find_length(robot: Robot, link: int) -> Array:
    """Find the line (3,) [mm] from a link's own joint to the next, along the axes of the next one's
    frame."""
    joint = robot.joints[link]
    R = joint.before[:3, :3]
    line = joint.before[:3, 3]
    length: Array = R.T @ line
    return length


def can_bend(robot: Robot, link: int) -> bool:
    """Return whether a link is long enough to bend, and all that loads its end is known: of a slide the
    moment about its own axis is not, unless it is upright."""
    length = find_length(robot, link)
    if np.linalg.norm(length) < SHORTEST:
        return False
    joint = robot.joints[link]
    if joint.prismatic:
        return keeps_slide_upright(robot, link + 1)
    return True


def weight_moment(frame: int, axis: str, body: int | None = None) -> Named:
    """Name the moment of the weight beyond joint `frame` about that frame's x, y or z axis [N m];
    of 1 kg at the origin of a later frame alone (n+1: at the target) where `body` names it [N
    m/kg]."""
    name = f"moment{frame}_{axis}"
    if axis == "z":
        name = f"torque{frame}"
    if body is None:
        return Named(name, "N m")
    return Named(f"{name}_{body}", OF_ONE_KG)


def name_moments(robot: Robot, frame: int, body: int | None = None) -> dict[str, Cause]:
    """Name the moments about the axes of a frame: of a slide, across it alone; none of what weighs at its
    own origin."""
    if body == frame:
        return {}
    joint = robot.joints[frame - 1]
    axes = "xyz"
    if joint.prismatic:
        axes = "xy"
    moments: dict[str, Cause] = {}
    for axis in axes:
        moments[axis] = weight_moment(frame, axis, body)
    return moments


def turn_end(robot: Robot, link: int, body: int | None = None) -> dict[str, Cause]:
    """Build what turns a link's end about each axis where its end alone yields: the moment of the
    weight beyond it, or of 1 kg at a body."""
    frame = link + 1
    moments = name_moments(robot, frame, body)
    turned = {}
    for axis, moment in moments.items():
        turned[f"r{axis}"] = moment
    return turned


def bend_tube(robot: Robot, link: int, body: int | None = None) -> dict[str, Cause]:
    """Build what turns and shifts a link's end along each axis where it bends and twists as a round tube
    does, per unit of its compliance: under the weight beyond it, or under 1 kg at a body."""
    return bend_beam(robot, link, body, ROUND)


def twist_beam(robot: Robot, link: int, body: int | None = None) -> dict[str, Cause]:
    """Build what twists a link about itself: the moment along it."""
    along = _find_direction(robot, link)
    frame = link + 1
    moments = name_moments(robot, frame, body)
    twisted: dict[str, Cause] = {}
    for axis, share in zip("xyz", along, strict=True):
        shares = share * along
        parts = _weigh(shares, moments, "1")
        if parts:
            twisted[f"r{axis}"] = _add(parts)
    return twisted


def bend_beam(
    robot: Robot, link: int, body: int | None = None, twist: float = 0.0
) -> dict[str, Cause]:
    """Build what turns and shifts a link's end along each axis where it bends as a beam does, per unit
    of its compliance; it twists by so many times as much as it bends."""
    frame = link + 1
    length = find_length(robot, link)
    weight, unit = 1.0, OF_ONE_KG
    if body is None:
        weight, unit = _weigh_beyond(robot, frame), "N m"
    moments = name_moments(robot, frame, body)
    pulls: dict[str, Cause] = {axis: Named(f"down{frame}_{axis}") for axis in "xyz"}
    across = _cross_matrix(length)
    levers = weight * G / 1e3 * across
    along = _find_direction(robot, link)
    twisted = np.outer(along, along)
    turned = np.eye(3) + (twist - 1) * twisted
    bent: dict[str, Cause] = {}
    for k, axis in enumerate("xyz"):
        by_moment = _weigh(turned[k], moments, "1")
        by_force = _weigh(levers[k] / 2, pulls, unit)
        parts = by_moment + by_force
        if parts:
            bent[f"r{axis}"] = _add(parts)
    shifted = across @ levers
    for k, axis in enumerate("xyz"):
        by_moment = _weigh(-across[k] / 2, moments, "mm")
        by_force = _weigh(-shifted[k] / 3, pulls, f"mm {unit}")
        parts = by_moment + by_force
        if parts:
            bent[f"t{axis}"] = _add(parts)
    return bent


def build_screws(
    frame: int, own: Mapping[str, Cause], held: Mapping[str, Cause] = NOTHING, mass: Cause = ONE
) -> tuple[Screw, ...]:
    """Build the screws of a link's end that moves with its own weight, with what is held times its
    mass, or with both."""
    screws = []
    axes = dict.fromkeys((*own, *held))
    for axis in axes:
        parts = []
        if axis in own:
            parts.append(own[axis])
        if axis in held:
            load = mass * held[axis]
            parts.append(load)
        cause = _add(parts)
        screw = Screw(frame, axis, cause)
        screws.append(screw)
    return tuple(screws)


def _find_direction(robot: Robot, link: int) -> Array:
    """Find the direction (3,) of a link along the axes of its far end's frame."""
    line = find_length(robot, link)
    length = np.linalg.norm(line)
    direction: Array = line / length
    return direction


def _weigh_beyond(robot: Robot, frame: int) -> float:
    """Weigh what lies beyond a joint [kg]: 1 kg at each later frame where no mass is declared."""
    joints = robot.joints[frame - 1 :]
    if not declares_masses(robot):
        count = len(joints)
        return float(count)
    masses = [joint.mass or 0.0 for joint in joints]
    return sum(masses)


def _cross_matrix(vector: Array) -> Array:
    """Build the matrix (3, 3) that multiplies from the left as a vector (3,) does."""
    units = np.eye(3)
    columns = np.cross(vector, units)
    return columns.T


def _weigh(shares: Array, causes: dict[str, Cause], unit: str) -> list[Cause]:
    """Weigh causes along x, y and z by their shares (3,); those of none are left out."""
    parts = []
    for share, axis in zip(shares, "xyz", strict=True):
        written = f"{share:.{DIGITS}g}"
        rounded = float(written)
        if axis not in causes or abs(rounded) < 1e-9:
            continue
        cause = causes[axis]
        number = Number(rounded, unit)
        if number != ONE:
            cause = number * cause
        parts.append(cause)
    return parts


def _add(parts: list[Cause]) -> Cause:
    first, *others = parts
    total = first
    for part in others:
        total = total + part
    return total
