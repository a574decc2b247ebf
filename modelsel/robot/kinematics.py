"""The nominal chain: its exact kinematics with error screws in it, and the screw field
(displacement per unit screw).

    x = P · (N_1 H_1 T_1)(N_2 H_2 T_2) … (N_n H_n T_n) · Last · Trans(tool) · H_{n+1}

N_k nominal transform before joint k, T_k = Rz(q_k) or Tz(q_k), H = Trans(a,b,c) Rx(α) Ry(β) Rz(γ)
the error screws of a frame, P the placement of frame 0 in the tracker's frame. Frame n+1 has its
origin at the target and the flange's axes. Written once: the nominal model is H = I, and a column
of the design matrix is its derivative (Lynch & Park 2017, 5.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from .._typing import Array
from ._kernels import (
    AXES_IN_PLACE,
    BASE_FRAME,
    FixedTransform,
    Frame,
    Workspace,
    add_weighted,
    apply_error_transform,
    compute_joint_turns,
    fill_screw_field,
    nonzero_entries,
    rotate_about_axis,
    rotate_by_fixed,
)


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint and the fixed transform before it; `mass` [kg] and `com` [mm, this joint's frame] of
    the link it moves."""

    before: Array = field(repr=False)  # N_k, (4, 4)
    prismatic: bool = False
    limits: tuple[float, float] | None = None  # rad or mm
    mass: float | None = None
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Robot:
    """A serial chain; `gravity` is the unit direction in frame 0, None where it is not known;
    `usual` the standard deviation of such an arm's lengths [mm] and angles [rad] about its
    drawing."""

    name: str
    source: str
    joints: tuple[Joint, ...]
    last: Array = field(repr=False)  # last joint to flange, (4, 4)
    gravity: tuple[float, float, float] | None = (0.0, 0.0, -1.0)
    usual: tuple[float, float] = (1.0, 1e-3)

    @property
    def n(self) -> int:
        """Number of joints; the target's frame is n + 1."""
        return len(self.joints)

    @property
    def prismatic(self) -> tuple[bool, ...]:
        """Which joints slide, as `read_measurements` wants to know."""
        return tuple(j.prismatic for j in self.joints)

    @cached_property
    def reach(self) -> float:
        """Upper bound of the distance [mm] from joint 1 to the flange: the sum of the fixed
        translations after it."""
        moved = sum(float(np.linalg.norm(j.before[:3, 3])) for j in self.joints[1:])
        slide = sum(max(map(abs, j.limits)) for j in self.joints if j.prismatic and j.limits)
        return moved + slide + float(np.linalg.norm(self.last[:3, 3]))

    @cached_property
    def fixed(self) -> tuple[FixedTransform, ...]:
        """N_1 … N_n and the last one, ready to be walked."""
        return tuple(FixedTransform.of(N) for N in (*(j.before for j in self.joints), self.last))

    def unit(self, joint: int) -> str:
        """Unit of a joint's reading (1-based joint)."""
        return "mm" if self.joints[joint - 1].prismatic else "rad"

    def draw(self, rng: np.random.Generator, m: int) -> Array:
        """m joint readings (m, n), uniform within the limits (±π or 0…500 mm where none are
        known)."""
        low, high = np.array(
            [j.limits or ((0.0, 500.0) if j.prismatic else (-np.pi, np.pi)) for j in self.joints]
        ).T
        return rng.uniform(low, high, (m, self.n))


@dataclass(frozen=True, eq=False)
class Pose:
    """The chain at m joint readings, components first and configurations last so that every
    operation streams.

    target: (3, m) mm in frame 0; rotation: (3, 3, m) of the target frame in frame 0; axes: (n+1, 6,
    3, m) unit axes of the screws; origins: (n+1, 3, m) where the rotational screws act."""

    target: Array
    rotation: Array
    axes: Array
    origins: Array

    def displacement(self) -> Array:
        """Screw field (n+1, 6, 3, m): mm of the target per unit screw (tx ty tz: axis; rx ry rz:
        axis x lever)."""
        out = self.axes.copy()
        fill_screw_field(out, self.origins, self.target, True, Workspace())
        return out


def cross_product(a: Array, b: Array) -> Array:
    """Cross product along axis 0 of (3, m) arrays."""
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def rotate_frame(R: Array, axis: int, angle: Array) -> Array:
    """R (3, 3, m) times the rotation about its own axis 0, 1 or 2 by angle (m,): two columns mix,
    one stays."""
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    c, s = np.cos(angle), np.sin(angle)
    out = R.copy()
    out[:, i] = c * R[:, i] + s * R[:, j]
    out[:, j] = c * R[:, j] - s * R[:, i]
    return out


def walk(
    robot: Robot,
    q: Array,
    tool: Array,
    into: tuple[Array, Array],
    twist: Array | None = None,
    start: Frame = BASE_FRAME,
    space: Workspace | None = None,
) -> Frame:
    """The exact chain from frame `start` to the target, written into (axes (n+1, 6, 3, m), of the
    nominal model the first three only, origins (n+1, 3, m)); arguments as in `pose`. Returns the
    target's frame."""
    m, space, (axes, origins) = len(q), space or Workspace(), into
    turns, fixed = compute_joint_turns(q, space), robot.fixed
    two, spun = space.array("scratch", 2, 3, m), space.array("spun", 3, 3, m)
    scratch = two[0]

    def settle(f: int, o: Array, offset: Sequence[tuple[int, Array | float]] = ()) -> Frame:
        here, origin = axes[f], origins[f]
        (first, weight), *others = (*fixed[f].offset, *offset) or ((0, 0.0),)
        np.multiply(here[first], weight, out=origin)
        origin += o
        add_weighted(origin, here, others, scratch)
        return (
            (here[:3], origin)
            if twist is None
            else apply_error_transform(here, origin, twist[f], space)
        )

    rotate_by_fixed(start[0], fixed[0].columns, axes[0], scratch)
    R, o = settle(0, start[1])
    for k, joint in enumerate(robot.joints):
        following = fixed[k + 1]
        if joint.prismatic:
            o = o + R[2] * q[:, k]
            rotate_by_fixed(R, following.columns, axes[k + 1], scratch)
        elif following.moves:
            there = axes[k + 1, :3]
            rotate_about_axis(
                R, 2, turns[k], following.moves, there if there.flags.c_contiguous else spun, two
            )
            if not there.flags.c_contiguous:
                there[:] = spun
        else:
            rotate_about_axis(R, 2, turns[k], AXES_IN_PLACE, spun, two)
            rotate_by_fixed(spun, following.columns, axes[k + 1], scratch)
        R, o = settle(
            k + 1,
            o,
            ()
            if k + 1 < robot.n
            else tuple(enumerate(tool.T))
            if tool.ndim > 1
            else nonzero_entries(tool),
        )
    return R, o


def pose(
    robot: Robot,
    q: Array,
    tool: Array,
    twist: Array | None = None,
    tool_rotation: Array | None = None,
) -> Pose:
    """The exact chain. q: (m, n) rad or mm; tool: (3,) or (m, 3) mm in the flange frame; twist:
    (n+1, 6, m) the entries a b c α β γ of every H, or None for the nominal model; tool_rotation:
    (m, 3, 3) of the target frame on the flange."""
    axes, origins = np.empty((robot.n + 1, 6, 3, len(q))), np.empty((robot.n + 1, 3, len(q)))
    R, o = walk(robot, q, tool, (axes, origins), twist)
    if twist is None:
        axes[:, 3:] = axes[:, :3]
    rotation = np.ascontiguousarray(R.swapaxes(0, 1))
    if tool_rotation is not None:
        rotation = np.einsum("ijm,mjk->ikm", rotation, tool_rotation)
    return Pose(o.copy(), rotation, axes, origins)


def forward(robot: Robot, q: Array, tool: Array) -> Array:
    """Nominal target positions (m, 3) in frame 0 [mm]."""
    return pose(robot, np.atleast_2d(np.asarray(q, float)), np.asarray(tool, float)).target.T


def screw_field(robot: Robot, q: Array, tool: Array) -> Array:
    """Nominal screw field (m, n+1, 6, 3): displacement of the target in frame 0, mm per mm and mm
    per rad."""
    return (
        pose(robot, np.atleast_2d(np.asarray(q, float)), np.asarray(tool, float))
        .displacement()
        .transpose(3, 0, 1, 2)
    )
