"""Where the masses of an arm may sit that its file does not declare, as a link bears them.

A mass anywhere on the line from one joint to the next weighs on what carries both as two masses do, one at
each of these joints: with the same force and the same moment in every posture. So masses at the joints'
origins stand for those of links, however these are spread along them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from .._typing import Array
from ..robot.gravity import REMEMBERED, STILL, draw_places, find_tilting_bodies, turns_in_gravity
from ..robot.kinematics import Robot

# share of the longest line between two joints from which a link is one of the arm's main ones
MAIN = 1 / 3


def list_bodies(robot: Robot, link: int) -> tuple[int, ...]:
    """List the frames of all masses that a link's end may bear: its own end, where the pull there
    changes its direction, every later joint that is not on the line between two others, and the target
    (n+1)."""
    end = link + 1
    own = [end] if turns_in_gravity(robot, end) else []
    later = [frame for frame in _measure_lines(robot) if frame > end]
    return (*own, *later)


def list_main_bodies(robot: Robot, link: int) -> tuple[int, ...]:
    """List those of them that weigh most: its own end, and the far ends of the arm's main links beyond
    its line, or, where that is the last of them, the last joint; none of what only the wrist's links lie
    beyond."""
    end = link + 1
    main = list_main_ends(robot)
    if end > max(main, default=0):
        return ()
    line_end = find_line_end(robot, link)
    far = [joint for joint in main if joint > line_end]
    heavy = [end, *(far or [robot.n])]
    each = list_bodies(robot, link)
    return tuple(joint for joint in each if joint in heavy)


def list_tilting(robot: Robot, joint: int, bodies: Sequence[int]) -> tuple[int, ...]:
    """List those of the bodies whose weight tilts a joint's axis, more in some postures than in others."""
    tilting = find_tilting_bodies(robot, joint)
    return tuple(body for body in bodies if body in tilting)


def find_line_end(robot: Robot, link: int) -> int:
    """Find the joint at which the straight line that a link is on ends: an elbow's link may hold the forearm's
    first joint on its way to the wrist."""
    beyond = [frame for frame in _measure_lines(robot) if frame > link]
    return beyond[0]


def list_main_ends(robot: Robot) -> list[int]:
    """List the joints at the far ends of the arm's main links, from the base."""
    lines = _measure_lines(robot)
    of_joints = {frame: line for frame, line in lines.items() if frame <= robot.n}
    longest = max(of_joints.values(), default=0.0)
    return [frame for frame, line in of_joints.items() if line >= MAIN * longest]


@lru_cache(maxsize=REMEMBERED)
def _measure_lines(robot: Robot) -> dict[int, float]:
    """Measure how far [mm] every frame (2 to n+1) is from the one before, without those that are on
    the line between two others in every posture."""
    drawn = draw_places(robot)
    places = dict(enumerate(drawn, 1))
    before = places[1]
    lines = {}
    for frame in range(2, robot.n + 2):
        line = _measure(before, places[frame])
        if frame <= robot.n:
            beyond = places[frame + 1]
            around = line + _measure(places[frame], beyond)
            straight = _measure(before, beyond)
            if (around - straight).max() < STILL * around.max():
                continue
        lines[frame] = float(line.mean())
        before = places[frame]
    return lines


def _measure(one: Array, other: Array) -> Array:
    """Measure the distance (m,) between two places (3, m)."""
    distance: Array = np.linalg.norm(other - one, axis=0)
    return distance
