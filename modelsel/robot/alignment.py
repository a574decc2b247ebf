"""One arm described twice: where the frames of another description stand in those of the first.

Two descriptions of an arm have the same axes, as lines in space; along and about each axis, and in
its base, a frame is free (a DH table, a URDF and a controller choose differently)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._typing import Array
from ..exceptions import count_words, write_rounded
from .differences import describe_chain_difference
from .kinematics import Robot
from .rigid import inverse, nearest_rotation, rotation_matrix, transform

# transforms that differ by less [mm, entries of a rotation] are the same
SAME_TRANSFORM = 1e-9
# axes that differ by more are those of another arm
MAX_ANGLE = 2e-3  # rad: files have 1.57 for a right angle
MAX_DISTANCE_MM = 0.5
# one base, or half a turn about its z between them: tried as they are before others are sought
USUAL_BASES = (np.eye(4), transform(np.diag([-1.0, -1.0, 1.0])))


@dataclass(frozen=True, eq=False)
class Alignment:
    """`base` (4, 4): frame 0 of a chain in frame 0 of the other description; `frames` (n, 4, 4):
    the other's joint frames in the chain's, each free along and about its axis."""

    base: Array
    frames: tuple[Array, ...]

    def express(self, before: Sequence[Array]) -> list[Array]:
        """Express the transforms before the joints in the other description's frames."""
        out = []
        previous = inverse(self.base)
        for N, frame in zip(before, self.frames, strict=True):
            between = inverse(previous) @ N @ frame
            out.append(between)
            previous = frame
        return out


def have_same_chain(chain: Robot, other: Robot) -> bool:
    """Whether two chains have the same joints and the same transforms before them."""
    return describe_chain_difference(chain, other, SAME_TRANSFORM) is None


def align_chains(chain: Robot, other: Robot) -> Alignment:
    """Align a chain with another description of the same arm, both at zero readings. Raises
    ValueError that says how they differ."""
    if chain.prismatic != other.prismatic:
        raise ValueError(
            f"it has {_describe_joints(other)} where the calibrated robot has "
            f"{_describe_joints(chain)}"
        )
    if have_same_chain(chain, other):
        still = np.eye(4)
        return Alignment(still, (still,) * chain.n)
    own = _place_frames(chain)
    theirs = _place_frames(other)
    for base in USUAL_BASES:
        try:
            return _align_at(base, own, theirs, chain.prismatic)
        except ValueError:
            continue
    base = _find_base(own, theirs, chain.prismatic)
    return _align_at(base, own, theirs, chain.prismatic)


def _align_at(
    base: Array, own: Sequence[Array], theirs: Sequence[Array], prismatic: Sequence[bool]
) -> Alignment:
    """Align frames where the base is known. Raises ValueError where an axis is another one."""
    frames = []
    differences = []
    for k, slides in enumerate(prismatic):
        placed = base @ own[k]
        between = inverse(placed) @ theirs[k]
        difference = _compare_axes(k + 1, between, slides)
        differences.append(difference)
        frame = _keep_free_part(between, slides)
        frames.append(frame)
    share, sentence = max(differences)
    if share > 1:
        raise ValueError(sentence)
    return Alignment(base, tuple(frames))


def _describe_joints(robot: Robot) -> str:
    kinds = ["slides" if slides else "turns" for slides in robot.prismatic]
    return f"{count_words(robot.n, 'joint')} ({', '.join(kinds)})"


def _place_frames(robot: Robot) -> list[Array]:
    """Place every joint's frame (4, 4) in frame 0, at zero readings."""
    at = np.eye(4)
    frames = []
    for joint in robot.joints:
        at = at @ joint.before
        frames.append(at)
    return frames


def _find_base(own: Sequence[Array], theirs: Sequence[Array], prismatic: Sequence[bool]) -> Array:
    """Find the rigid transform (4, 4) that takes one set of axes to the other: its rotation by the
    directions of the axes and of what lies between them (Procrustes), its offset by least
    squares."""
    turning = [not slides for slides in prismatic]
    own_directions = _list_directions(own, turning)
    their_directions = _list_directions(theirs, turning)
    R = nearest_rotation(their_directions.T @ own_directions)
    rows = []
    wanted = []
    for first, second, turns in zip(own, theirs, turning, strict=True):
        if not turns:
            continue
        across = _across(second[:3, 2])
        rows.append(across)
        wanted.append(across @ (second[:3, 3] - R @ first[:3, 3]))
    if not rows:
        return transform(R)
    offset = np.linalg.lstsq(np.concatenate(rows), np.concatenate(wanted), rcond=1e-9)[0]
    return transform(R, offset)


def _across(axis: Array) -> Array:
    """Project (3, 3) on the plane across an axis."""
    return np.asarray(np.eye(3) - np.outer(axis, axis))


def _list_directions(frames: Sequence[Array], turning: Sequence[bool]) -> Array:
    """List the axes (k, 3) and the shortest vectors between those that turn, as shares of the
    longest."""
    axes = [frame[:3, 2] for frame in frames]
    between = [np.zeros(3)]
    revolute = [frame for frame, turns in zip(frames, turning, strict=True) if turns]
    for k, first in enumerate(revolute):
        for second in revolute[k + 1 :]:
            shortest = _find_shortest(first, second)
            between.append(shortest)
    longest = max(float(np.linalg.norm(vector)) for vector in between)
    scaled = np.array(between) / max(longest, 1.0)
    return np.concatenate([axes, scaled])


def _find_shortest(first: Array, second: Array) -> Array:
    """Find the shortest vector (3,) from one axis to another."""
    offset = second[:3, 3] - first[:3, 3]
    across = np.cross(first[:3, 2], second[:3, 2])
    sine = float(np.linalg.norm(across))
    if sine < MAX_ANGLE:
        return np.asarray(_across(first[:3, 2]) @ offset)
    normal = across / sine
    return np.asarray(normal * (normal @ offset))


def _compare_axes(number: int, between: Array, slides: bool) -> tuple[float, str]:
    """Compare a joint's axis in two descriptions: the difference as a share of the largest that
    one arm may have, and in words."""
    angle = float(np.arctan2(np.hypot(*between[:2, 2]), between[2, 2]))
    distance = 0.0 if slides else float(np.hypot(*between[:2, 3]))
    nominal = "the calibrated robot's nominal one"
    turned = f"the axis of joint {number} points {write_rounded(np.degrees(angle))} deg away from {nominal}"
    shifted = f"the axis of joint {number} lies {write_rounded(distance)} mm away from {nominal}"
    return max((angle / MAX_ANGLE, turned), (distance / MAX_DISTANCE_MM, shifted))


def _keep_free_part(between: Array, slides: bool) -> Array:
    """Keep what of a transform commutes with the joint: a turn about its axis, and a shift along
    it, or for a slide any shift."""
    angle = float(np.arctan2(between[1, 0], between[0, 0]))
    offset = between[:3, 3].copy()
    if not slides:
        offset[:2] = 0.0
    return transform(rotation_matrix(2, angle), offset)
