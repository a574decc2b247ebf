"""A link that bends as a beam: the curvature summed up along its length, and what loads its end under masses
that a robot file does not declare."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from exact import flanges_of
from held_loads import WEIGHT, frame_of, place_of

from modelsel._typing import Array
from modelsel.robot.kinematics import Robot

# pieces that a beam is cut into
PIECES = 400
Rng = np.random.Generator
# masses [kg], and where each is, in the frame of the joint that moves it [mm]
Heavy = list[tuple[int, float, Array]]


def bend(length: Array, moment: Array, force: Array, twist: float) -> tuple[Array, Array]:
    """Sum up a beam's curvature along its length: how its end turns and shifts [mm], with a compliance of
    1; a moment along it twists it so many times as much as one across bends it."""
    metres = np.linalg.norm(length) / 1e3
    along = length / np.linalg.norm(length)
    step = metres / PIECES
    turn, shift = np.zeros((2, *moment.shape))
    for k in range(PIECES):
        left = metres - (k + 0.5) * step
        here = moment + left * np.cross(along, force)
        twisted = (here @ along)[:, None] * along
        curvature = (here - twisted + twist * twisted) / metres
        before = turn
        turn = turn + curvature * step
        shift = shift + np.cross((before + turn) / 2, along) * step
    return turn, shift * 1e3


def line_of(arm: Robot, link: int) -> Array:
    """The line from a link's joint to the next, in the far end's axes."""
    before = arm.joints[link].before
    return np.asarray(before[:3, :3].T @ before[:3, 3])


def without_masses(arm: Robot) -> Robot:
    """The same arm as most people describe theirs."""
    joints = tuple(replace(joint, mass=None) for joint in arm.joints)
    return replace(arm, joints=joints)


def draw_masses(arm: Robot, tool: Array, rng: Rng) -> Heavy:
    """Draw a mass of every link somewhere on the line to the next joint, or of the last to the target,
    heavier towards the base."""
    heavy: Heavy = []
    mass = rng.uniform(20, 40)
    for joint in range(1, arm.n + 1):
        to_next = arm.last[:3, :3] @ tool + arm.last[:3, 3]
        if joint < arm.n:
            to_next = arm.joints[joint].before[:3, 3]
        share = rng.uniform(0.1, 0.7)
        heavy.append((joint, float(mass), share * to_next))
        mass *= rng.uniform(0.4, 0.7)
    return heavy


def load_by(arm: Robot, joint: int, q: Array, heavy: Heavy) -> tuple[Array, Array, Array]:
    """Poses where a joint sits, before it turns, and the moment [N m] and force [N] (m, 3) there in those axes
    of what the joint moves."""
    at = frame_of(arm, joint - 1, q) @ arm.joints[joint - 1].before
    moment, force = np.zeros((2, len(q), 3))
    for moved, mass, where in heavy:
        if moved >= joint:
            lever = place_of(frame_of(arm, moved, q), where) - at[:, :3, 3]
            moment += np.cross(lever / 1e3, mass * WEIGHT)
            force += mass * WEIGHT
    axes = at[:, :3, :3]
    return at, np.einsum("mji,mj->mi", axes, moment), np.einsum("mji,mj->mi", axes, force)


def place_target(arm: Robot, q: Array, tool: Array) -> Array:
    """Places of the target of an arm that does not yield."""
    return place_of(flanges_of(arm, q), tool)
