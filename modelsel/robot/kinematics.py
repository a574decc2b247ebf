"""Kinematics of the nominal chain with error screws in it, and the screw field (displacement per
unit screw).

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

from .._arguments import check_type, check_whole_number
from .._typing import Array, Mask
from ..exceptions import count_words
from ._kernels import (
    AXES_IN_PLACE,
    BASE_FRAME,
    FixedTransform,
    Frame,
    Workspace,
    add_weighted,
    apply_error_transform,
    compute_joint_turns,
    compute_sine_and_cosine,
    fill_screw_field,
    nonzero_entries,
    rotate_about_axis,
    rotate_by_fixed,
)
from .coupling import Coupling
from .rigid import MIXED_AXES

LIMIT_TOLERANCE = 1e-6  # rad or mm: a reading at the limit, as it comes back from degrees
# digits to which the flange's axis is known: files write turns of 90 degrees as 1.5708
AXIS_DIGITS = 5


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint and the fixed transform before it; `mass` [kg] and `com` [mm, this joint's frame] of
    the link it moves."""

    # N_k, (4, 4)
    before: Array = field(repr=False)
    prismatic: bool = False
    # rad or mm
    limits: tuple[float, float] | None = None
    mass: float | None = None
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def range(self) -> tuple[float, float]:
        """Limits of its reading, or ±π rad or 0…500 mm where none are known."""
        if self.limits is not None:
            return self.limits
        if self.prismatic:
            return 0.0, 500.0
        return -np.pi, np.pi

    def find_beyond(self, readings: Array) -> Mask:
        """Find the readings (m,) beyond its limits; none where these are not known."""
        if self.limits is None:
            return np.zeros(len(readings), bool)
        low, high = self.limits
        is_below = readings < low - LIMIT_TOLERANCE
        is_above = readings > high + LIMIT_TOLERANCE
        return np.asarray(is_below | is_above)


@dataclass(frozen=True)
class UrdfSource:
    """The URDF that a robot was read from: its text, and the links that its chain starts and ends
    at."""

    text: str = field(repr=False)
    base: str
    tip: str


@dataclass(frozen=True, eq=False)
class Robot:
    """A serial chain; `gravity` is the unit direction in frame 0, None where it is not known;
    `usual` the standard deviation of such an arm's lengths [mm] and angles [rad] about its
    drawing; `urdf` the file that it was read from, None where that is another; `coupling` how its
    motors move the joints, None where each moves its own; `payload_at_mm` where payloads hang in the
    flange's frame, None for at the target."""

    name: str
    source: str
    joints: tuple[Joint, ...]
    # last joint to flange, (4, 4)
    last: Array = field(repr=False)
    gravity: tuple[float, float, float] | None = (0.0, 0.0, -1.0)
    usual: tuple[float, float] = (1.0, 1e-3)
    urdf: UrdfSource | None = field(default=None, repr=False)
    coupling: Coupling | None = field(default=None, repr=False)
    payload_at_mm: tuple[float, float, float] | None = None

    def __repr__(self) -> str:
        name = self.name
        reach = self.reach
        joints = count_words(self.n, "joint")
        slides = sum(self.prismatic)
        sliding = ""
        if slides:
            sliding = f", {slides} of which slide"
        return f"Robot {name!r}: {joints}{sliding}, links of {reach:,.0f} mm in all"

    @property
    def n(self) -> int:
        """Number of joints; the target's frame is n + 1."""
        return len(self.joints)

    @property
    def prismatic(self) -> tuple[bool, ...]:
        """Whether each joint slides, as `read_measurements` wants to know."""
        return tuple(joint.prismatic for joint in self.joints)

    @cached_property
    def reach(self) -> float:
        """Upper bound of the distance [mm] from joint 1 to the flange.

        The sum of the fixed translations after joint 1 and of the travels of its slides."""
        links = []
        for joint in self.joints[1:]:
            offset = joint.before[:3, 3]
            length = np.linalg.norm(offset)
            links.append(float(length))
        slides = []
        for joint in self.joints:
            limits = joint.limits
            if joint.prismatic and limits:
                low, high = limits
                travel = max(abs(low), abs(high))
                slides.append(travel)
        offset = self.last[:3, 3]
        last = np.linalg.norm(offset)
        fixed = sum(links)
        travels = sum(slides)
        return fixed + travels + float(last)

    @cached_property
    def fixed(self) -> tuple[FixedTransform, ...]:
        """N_1 … N_n and the last transform, prepared for walking the chain."""
        transforms = [joint.before for joint in self.joints]
        transforms.append(self.last)
        prepared = []
        for N in transforms:
            fixed = FixedTransform.of(N)
            prepared.append(fixed)
        return tuple(prepared)

    def unit(self, joint: int) -> str:
        """Return the unit of a joint's reading (1-based joint)."""
        index = joint - 1
        if self.joints[index].prismatic:
            return "mm"
        return "rad"

    def draw(self, rng: np.random.Generator, m: int) -> Array:
        """Draw m joint readings (m, n), uniform within the joints' ranges."""
        check_type("rng", rng, np.random.Generator, "a generator, as np.random.default_rng(0)")
        m = check_whole_number("m", m, 0)
        ranges = [joint.range for joint in self.joints]
        low, high = np.array(ranges).T
        return rng.uniform(low, high, size=(m, self.n))


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
        """Compute the screw field (n+1, 6, 3, m): mm of the target per unit screw (tx ty tz: axis;
        rx ry rz: axis x lever)."""
        field = self.axes.copy()
        workspace = Workspace()
        fill_screw_field(field, self.origins, self.target, True, workspace)
        return field


def cross_product(a: Array, b: Array) -> Array:
    """Compute the cross product of (3, m) arrays along axis 0."""
    ax, ay, az = a
    bx, by, bz = b
    x = ay * bz - az * by
    y = az * bx - ax * bz
    z = ax * by - ay * bx
    return np.stack([x, y, z])


def rotate_frame(R: Array, axis: int, angle: Array) -> Array:
    """Multiply R (3, 3, m) by the rotation about its own axis 0, 1 or 2 by angle (m,): two columns
    mix, one stays."""
    i, j = MIXED_AXES[axis]
    cosine = np.empty_like(angle)
    sine = np.empty_like(angle)
    compute_sine_and_cosine(angle, sine, cosine)
    first = R[:, i]
    second = R[:, j]
    out = R.copy()
    out[:, i] = cosine * first + sine * second
    out[:, j] = cosine * second - sine * first
    return out


@dataclass(frozen=True, eq=False)
class _Walk:
    """One walk along the chain: where it writes, and the buffers it uses."""

    robot: Robot
    tool: Array
    axes: Array
    origins: Array
    twist: Array | None
    space: Workspace
    # (2, 3, m) and (3, 3, m)
    scratch: Array
    rotated: Array

    def offset(self, frame: int) -> Sequence[tuple[int, Array | float]]:
        """Return the origin of a frame relative to the one before, along its own axes.

        The last one's includes the tool."""
        robot = self.robot
        fixed = robot.fixed[frame].offset
        if frame < robot.n:
            return fixed
        tool = self.tool
        per_row = tool.ndim > 1
        if per_row:
            columns = enumerate(tool.T)
            return (*fixed, *columns)
        entries = nonzero_entries(tool)
        return (*fixed, *entries)

    def settle(self, frame: int, previous_origin: Array) -> Frame:
        """Write the origin of a frame whose axes stand, and apply its error transform."""
        axes = self.axes[frame]
        origin = self.origins[frame]
        offset = self.offset(frame) or ((0, 0.0),)
        (first, weight), *others = offset
        np.multiply(axes[first], weight, out=origin)
        origin += previous_origin
        add_weighted(origin, axes, others, self.scratch[0])
        if self.twist is None:
            return axes[:3], origin
        return apply_error_transform(axes, origin, self.twist[frame], self.space)

    def turn(self, R: Array, turn: Array, frame: int) -> None:
        """Write the axes of a frame: R after its revolute joint and the next fixed rotation."""
        fixed = self.robot.fixed[frame]
        if not fixed.moves:
            rotate_about_axis(R, 2, turn, AXES_IN_PLACE, self.rotated, self.scratch)
            rotate_by_fixed(self.rotated, fixed.columns, self.axes[frame], self.scratch[0])
            return
        target = self.axes[frame, :3]
        is_contiguous = target.flags.c_contiguous
        turned = target if is_contiguous else self.rotated
        rotate_about_axis(R, 2, turn, fixed.moves, turned, self.scratch)
        if not is_contiguous:
            target[:] = turned


def walk(
    robot: Robot,
    q: Array,
    tool: Array,
    into: tuple[Array, Array],
    twist: Array | None = None,
    start: Frame = BASE_FRAME,
    space: Workspace | None = None,
) -> Frame:
    """Walk the exact chain from frame `start` to the target and return the target's frame.

    The frames are written into (axes (n+1, 6, 3, m), of the nominal model the first three only,
    origins (n+1, 3, m)); the other arguments are as in `pose`."""
    m = len(q)
    space = space or Workspace()
    turns = compute_joint_turns(q, space)
    scratch = space.array("scratch", 2, 3, m)
    rotated = space.array("spun", 3, 3, m)
    axes, origins = into
    chain = _Walk(robot, tool, axes, origins, twist, space, scratch, rotated)
    start_axes, origin = start
    rotate_by_fixed(start_axes, robot.fixed[0].columns, axes[0], scratch[0])
    R, origin = chain.settle(0, origin)
    for k, joint in enumerate(robot.joints):
        frame = k + 1
        if joint.prismatic:
            travel = R[2] * q[:, k]
            origin = origin + travel
            rotate_by_fixed(R, robot.fixed[frame].columns, axes[frame], scratch[0])
        else:
            chain.turn(R, turns[k], frame)
        R, origin = chain.settle(frame, origin)
    return R, origin


def pose(
    robot: Robot,
    q: Array,
    tool: Array,
    twist: Array | None = None,
    tool_rotation: Array | None = None,
) -> Pose:
    """Compute the exact chain.

    q: (m, n) rad or mm; tool: (3,) or (m, 3) mm in the flange frame; twist: (n+1, 6, m) the entries
    a b c α β γ of every H, or None for the nominal model; tool_rotation: (m, 3, 3) of the target
    frame on the flange."""
    frames = robot.n + 1
    m = len(q)
    axes = np.empty((frames, 6, 3, m))
    origins = np.empty((frames, 3, m))
    R, target = walk(robot, q, tool, into=(axes, origins), twist=twist)
    if twist is None:
        axes[:, 3:] = axes[:, :3]
    columns = R.swapaxes(0, 1)
    rotation = np.ascontiguousarray(columns)
    if tool_rotation is not None:
        rotation = np.einsum("ijm,mjk->ikm", rotation, tool_rotation)
    return Pose(target.copy(), rotation, axes, origins)


def forward(robot: Robot, q: Array, tool: Array) -> Array:
    """Compute nominal target positions (m, 3) in frame 0 [mm]."""
    readings = np.atleast_2d(np.asarray(q, float))
    offset = np.asarray(tool, float)
    return pose(robot, readings, offset).target.T


def find_flange_axis(robot: Robot) -> Array:
    """Find the axis (3,) of the last joint in the flange's frame, of length 1 and with its largest entry
    positive."""
    axis = np.round(robot.last[2, :3], AXIS_DIGITS)
    ahead = np.sign(axis[np.abs(axis).argmax()])
    return np.asarray(ahead * axis / np.linalg.norm(axis))
