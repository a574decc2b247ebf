"""The nominal chain: its exact kinematics with error screws in it, and the screw field (displacement per unit screw).

    x = P · (N_1 H_1 T_1)(N_2 H_2 T_2) … (N_n H_n T_n) · Last · Trans(tool) · H_{n+1}

N_k nominal transform before joint k, T_k = Rz(q_k) or Tz(q_k), H = Trans(a,b,c) Rx(α) Ry(β) Rz(γ) the error screws of a
frame, P the placement of frame 0 in the tracker's frame. Frame n+1 has its origin at the target and the flange's axes.
Written once: the nominal model is H = I, and a column of the design matrix is its derivative (Lynch & Park 2017, 5.1).
"""
from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from .rigid import Array


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint and the fixed transform before it; `mass` [kg] and `com` [mm, this joint's frame] of the link it moves."""

    before: Array = field(repr=False)          # N_k, (4, 4)
    prismatic: bool = False
    limits: tuple[float, float] | None = None  # rad or mm
    mass: float | None = None
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Robot:
    """A serial chain; `gravity` is the unit direction in frame 0, None where it is not known."""

    name: str
    source: str
    joints: tuple[Joint, ...]
    last: Array = field(repr=False)            # last joint to flange, (4, 4)
    gravity: tuple[float, float, float] | None = (0.0, 0.0, -1.0)

    @property
    def n(self) -> int:
        """Number of joints; the target's frame is n + 1."""
        return len(self.joints)

    @cached_property
    def reach(self) -> float:
        """Upper bound of the distance [mm] from joint 1 to the flange: the sum of the fixed translations after it."""
        moved = sum(float(np.linalg.norm(j.before[:3, 3])) for j in self.joints[1:])
        slide = sum(max(map(abs, j.limits)) for j in self.joints if j.prismatic and j.limits)
        return moved + slide + float(np.linalg.norm(self.last[:3, 3]))

    def unit(self, joint: int) -> str:
        """Unit of a joint's reading (1-based joint)."""
        return "mm" if self.joints[joint - 1].prismatic else "rad"

    def draw(self, rng: np.random.Generator, m: int) -> Array:
        """m joint readings (m, n), uniform within the limits (±π or 0…500 mm where none are known)."""
        low, high = np.array([j.limits or ((0.0, 500.0) if j.prismatic else (-np.pi, np.pi)) for j in self.joints]).T
        return rng.uniform(low, high, (m, self.n))


@dataclass(frozen=True, eq=False)
class Pose:
    """The chain at m joint readings, components first and configurations last so that every operation streams.

    target: (3, m) mm in frame 0; rotation: (3, 3, m) of the target frame in frame 0; axes: (n+1, 6, 3, m) unit axes of the
    screws; origins: (n+1, 3, m) where the rotational screws act.
    """

    target: Array
    rotation: Array
    axes: Array
    origins: Array

    def displacement(self) -> Array:
        """Screw field (n+1, 6, 3, m): mm of the target per unit screw (tx ty tz: axis; rx ry rz: axis x lever)."""
        out = self.axes.copy()
        lever = self.target - self.origins
        for f in range(len(out)):
            for a in (3, 4, 5):
                out[f, a] = cross(self.axes[f, a], lever[f])
        return out

    def rotational(self) -> Array:
        """(n+1, 6, 3, m): rad of the target frame per unit screw; zero for the translations."""
        out = np.zeros_like(self.axes)
        out[:, 3:] = self.axes[:, 3:]
        return out


def cross(a: Array, b: Array) -> Array:
    """Cross product along axis 0 of (3, m) arrays."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def spin(R: Array, axis: int, angle: Array) -> Array:
    """R (3, 3, m) times the rotation about its own axis 0, 1 or 2 by angle (m,): two columns mix, one stays."""
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    c, s = np.cos(angle), np.sin(angle)
    out = R.copy()
    out[:, i] = c * R[:, i] + s * R[:, j]
    out[:, j] = c * R[:, j] - s * R[:, i]
    return out


def pose(robot: Robot, q: Array, tool: Array, twist: Array | None = None, tool_rotation: Array | None = None) -> Pose:
    """The exact chain. q: (m, n) rad or mm; tool: (3,) or (m, 3) mm in the flange frame; twist: (n+1, 6, m) the entries
    a b c α β γ of every H, or None for the nominal model; tool_rotation: (m, 3, 3) of the target frame on the flange."""
    m, frames = len(q), robot.n + 1
    axes, origins = np.empty((frames, 6, 3, m)), np.empty((frames, 3, m))
    R, o = np.broadcast_to(np.eye(3)[:, :, None], (3, 3, m)), np.zeros((3, m))

    def inject(f: int, R: Array, o: Array) -> tuple[Array, Array]:
        axes[f, :3] = R.transpose(1, 0, 2)
        if twist is None:
            axes[f, 3:], origins[f] = axes[f, :3], o
            return R, o
        o = o + np.einsum("ijm,jm->im", R, twist[f, :3])
        for a in range(3):                     # Rx, then Ry, then Rz, each about the axis the earlier ones left it
            axes[f, 3 + a] = R[:, a]
            R = spin(R, a, twist[f, 3 + a])
        origins[f] = o
        return R, o

    for k, joint in enumerate(robot.joints):
        o = o + np.tensordot(joint.before[:3, 3], R, (0, 1))
        R = np.tensordot(R, joint.before[:3, :3], (1, 0)).transpose(0, 2, 1)
        R, o = inject(k, R, o)
        if joint.prismatic:
            o = o + R[:, 2] * q[:, k]
        else:
            R = spin(R, 2, q[:, k])
    o = o + np.tensordot(robot.last[:3, 3], R, (0, 1))
    R = np.tensordot(R, robot.last[:3, :3], (1, 0)).transpose(0, 2, 1)
    o = o + np.einsum("ijm,mj->im", R, np.broadcast_to(tool, (m, 3)))
    R, o = inject(frames - 1, R, o)
    if tool_rotation is not None:
        R = np.einsum("ijm,mjk->ikm", R, tool_rotation)
    return Pose(o, R, axes, origins)


def forward(robot: Robot, q: Array, tool: Array) -> Array:
    """Nominal target positions (m, 3) in frame 0 [mm]."""
    return pose(robot, np.atleast_2d(np.asarray(q, float)), np.asarray(tool, float)).target.T


def screw_field(robot: Robot, q: Array, tool: Array) -> Array:
    """Nominal screw field (m, n+1, 6, 3): displacement of the target in frame 0, mm per mm and mm per rad."""
    return pose(robot, np.atleast_2d(np.asarray(q, float)), np.asarray(tool, float)).displacement().transpose(3, 0, 1, 2)
