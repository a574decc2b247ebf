"""Distinct places: screws at two frames that move every target alike are one place.

A shift along a joint's axis is the same before that joint has turned and after, so that the next
frame has it, too, along one of its axes; so has a turn about an axis that two frames share. The data
cannot tell which of the two is meant, and no other data of this arm could: one of them is enough."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ..._linalg import TINY
from ..._typing import Array, Mask
from ...mechanisms.motors import joint_axis
from ...robot.kinematics import Robot, pose
from ...robot.rigid import AXES

Place = tuple[int, str]

# configurations at which places are compared, and travel [mm] of slides there
CONFIGURATIONS = 40
TRAVEL = 500.0
# targets on the flange [mm]
TARGETS = ((40.0, -30.0, 120.0), (-80.0, 50.0, 60.0))
# cosine from which two motions are one: an arm's own table may be some tenths of a degree off its
# drawing's right angles
ONE_MOTION = 0.9999


@lru_cache(maxsize=16)
def find_frames(robot: Robot) -> dict[Place, tuple[int, ...]]:
    """Find the frames at which every distinct place (frame, axis) of an arm has its like, its own
    among them.

    Of places that move alike the motion of a joint stands for all, else that of the first frame."""
    places = _list_places(robot)
    alike = _compare(robot)
    motions = {(j, joint_axis(robot, j)) for j in range(1, robot.n + 1)}
    order = sorted(range(len(places)), key=lambda k: (places[k] not in motions, k))
    frames: dict[Place, tuple[int, ...]] = {}
    taken: set[int] = set()
    for k in order:
        if k in taken:
            continue
        same = [other for other in np.flatnonzero(alike[k]).tolist() if other not in taken]
        taken.update(same)
        frames[places[k]] = tuple(sorted({places[other][0] for other in same}))
    return {place: frames[place] for place in places if place in frames}


def find_alike(robot: Robot, place: Place) -> tuple[Place, ...]:
    """Find the other places whose unit screws move every target as one place's does."""
    places = _list_places(robot)
    number = places.index(place)
    same = np.flatnonzero(_compare(robot)[number])
    return tuple(places[other] for other in same.tolist() if other != number)


def _list_places(robot: Robot) -> list[Place]:
    return [(frame, axis) for frame in range(1, robot.n + 2) for axis in AXES]


@lru_cache(maxsize=16)
def _compare(robot: Robot) -> Mask:
    """Compare all places (n, n): whether unit screws there move targets alike, or against each
    other, at configurations all over the joints' turns."""
    rng = np.random.default_rng(0)
    turns = rng.uniform(-np.pi, np.pi, (CONFIGURATIONS, robot.n))
    travels = rng.uniform(0.0, TRAVEL, (CONFIGURATIONS, robot.n))
    q = np.where(robot.prismatic, travels, turns)
    fields = [_compute_field(robot, q, np.array(target)) for target in TARGETS]
    motions = np.concatenate(fields, axis=1)
    size = np.linalg.norm(motions, axis=1, keepdims=True)
    # a turn about the target's own place moves nothing
    unit = motions / np.maximum(size, TINY)
    alike = np.abs(unit @ unit.T) > ONE_MOTION
    # what moves nothing is like itself, too
    np.fill_diagonal(alike, True)
    return np.asarray(alike)


def _compute_field(robot: Robot, q: Array, target: Array) -> Array:
    """Compute (places, numbers) what unit screws move a target by at some configurations."""
    tools = np.tile(target, (len(q), 1))
    field = pose(robot, q, tools).displacement()
    places = field.shape[0] * field.shape[1]
    return np.asarray(field.reshape(places, -1))
