"""Denavit-Hartenberg parameters of any chain, standard, modified and with Hayati's rows, exactly;
and the robot file that holds them.

A fixed transform between two joints is Rz(φ) Tz(d) · Tx(a) Rx(α) · Rz(ψ) Tz(e): along the first
axis to the common normal, along the normal, along the second axis (Denavit & Hartenberg 1955). What
turns about an axis or slides along it goes into its own joint's row.

Where the axes are nearly parallel the normal lies far away. There Hayati's row has a second angle β
in place of d: Rz(φ) Tx(a) Rx(α) Ry(β) · Rz(ψ) Tz(e), from the first axis straight to where the
second pierces the plane across it (Hayati 1983)."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from .._typing import Array
from ..exceptions import one_line
from .kinematics import Joint, Robot
from .rigid import inverse, rotation_matrix, transform

# rad: two axes closer than this have no common normal worth naming; 1e-6 mm at a metre
PARALLEL_ANGLE = 1e-9
# rad: below this, offsets along the axes are many times the link's length
NEARLY_PARALLEL_ANGLE = 0.02
# rad: of the two directions that a normal has, the one that turns a joint's zero by less is taken;
# between two that turn it nearly alike, either
MAX_TURN = np.pi / 2 + 0.1
DhForm = Literal["standard", "modified", "hayati"]


@dataclass(frozen=True)
class DhRow:
    """A row of a table: angles [rad], lengths [mm]; `beta` in Hayati's rows alone."""

    theta: float
    d: float
    a: float
    alpha: float
    beta: float | None = None

    def to_table(self) -> dict[str, float]:
        """Return the row as a robot file has it: degrees and mm."""
        table = {"theta_deg": float(np.degrees(self.theta)), "d_mm": float(self.d)}
        table["a_mm"] = float(self.a)
        table["alpha_deg"] = float(np.degrees(self.alpha))
        if self.beta is not None:
            table["beta_deg"] = float(np.degrees(self.beta))
        return table


@dataclass(frozen=True)
class DhRows:
    """`base` (4, 4) from frame 0 to the first row; one row a joint; `shift` (n, 4, 4): from a
    joint's frame in the chain to its frame here; `nearly` (k, k+1) joints whose axes are almost,
    not quite, parallel."""

    base: Array
    rows: tuple[DhRow, ...]
    shift: tuple[Array, ...]
    nearly: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class _Link:
    """A transform between two axes: angles φ, α, β, ψ [rad], lengths d, a, e [mm]."""

    phi: float = 0.0
    d: float = 0.0
    a: float = 0.0
    alpha: float = 0.0
    psi: float = 0.0
    e: float = 0.0
    beta: float | None = None


def _find_common_normal(N: Array) -> _Link:
    """Decompose a transform (4, 4) along the first axis, the common normal and the second axis."""
    axis = N[:3, 2]
    origin = N[:3, 3]
    x, y, z = origin
    sine = float(np.hypot(axis[0], axis[1]))
    if sine < PARALLEL_ANGLE:
        on_axis = np.hypot(x, y) <= PARALLEL_ANGLE
        phi = 0.0 if on_axis else float(np.arctan2(y, x))
        alpha = 0.0 if axis[2] > 0 else np.pi
        d = float(z)
        e = 0.0
    else:
        phi = float(np.arctan2(axis[0], -axis[1]))
        alpha = float(np.arctan2(sine, axis[2]))
        across = np.array([-np.sin(phi), np.cos(phi), 0.0])
        e = float(-(origin @ across) / sine)
        d = float(z - e * axis[2])
    if abs(phi) > MAX_TURN:
        phi -= np.copysign(np.pi, phi)
        alpha = -alpha
    cosine = np.cos(phi)
    a = float(x * cosine + y * np.sin(phi))
    psi = _find_last_turn(N, phi, alpha, 0.0)
    return _Link(phi, d, a, float(alpha), psi, e)


def _find_last_turn(N: Array, phi: float, alpha: float, beta: float) -> float:
    """Find the turn about the second axis that is left of a transform."""
    turned = rotation_matrix(2, phi) @ rotation_matrix(0, alpha) @ rotation_matrix(1, beta)
    rest = turned.T @ N[:3, :3]
    return float(np.arctan2(rest[1, 0], rest[0, 0]))


def _find_piercing(N: Array) -> _Link:
    """Decompose a transform (4, 4) between nearly parallel axes: along the straight line to where
    the second pierces the first's xy plane, by two angles, along the second axis."""
    axis = N[:3, 2]
    origin = N[:3, 3]
    e = float(origin[2] / axis[2])
    x, y, _ = origin - e * axis
    is_apart = np.hypot(x, y) > PARALLEL_ANGLE
    phi = float(np.arctan2(y, x)) if is_apart else 0.0
    if abs(phi) > MAX_TURN:
        phi -= np.copysign(np.pi, phi)
    a = float(x * np.cos(phi) + y * np.sin(phi))
    direction = rotation_matrix(2, -phi) @ axis
    beta = float(np.arcsin(direction[0]))
    alpha = float(np.arctan2(-direction[1], direction[2]))
    psi = _find_last_turn(N, phi, alpha, beta)
    return _Link(phi, 0.0, a, alpha, psi, e, beta)


def compute_dh_rows(robot: Robot, form: DhForm) -> DhRows:
    """Compute the DH rows of a chain; `robot.last` stays as it is, after the last row. The form
    "hayati" is standard, with Hayati's rows between nearly parallel axes."""
    modified = form == "modified"
    rows = list[DhRow]()
    shifts = list[Array]()
    nearly = list[tuple[int, int]]()
    # the transform that leads to this joint
    before = _Link()
    for k in range(robot.n):
        number = k + 1
        after = _Link()
        start = before.e
        if number < robot.n:
            following = robot.joints[number].before
            after = _find_common_normal(following)
            sine = abs(np.sin(after.alpha))
            if PARALLEL_ANGLE < sine < NEARLY_PARALLEL_ANGLE:
                nearly.append((number, number + 1))
            if form == "hayati" and sine < NEARLY_PARALLEL_ANGLE:
                # this row starts where the one before ended, and what is left along the axis goes on
                after = _find_piercing(transform(t=(0, 0, start)) @ following)
                start = 0.0
        link = before if modified else after
        row = DhRow(before.psi + after.phi, start + after.d, link.a, link.alpha, link.beta)
        rows.append(row)
        along = after.d if modified else -before.e
        turn = rotation_matrix(2, after.phi)
        shift = transform(turn, (0.0, 0.0, along))
        shifts.append(shift)
        before = after
    return DhRows(
        base=robot.joints[0].before, rows=tuple(rows), shift=tuple(shifts), nearly=tuple(nearly)
    )


def dh_table(robot: Robot, form: DhForm) -> dict[str, Any]:
    """Return a robot as the table of a robot file in DH rows, which `robot_from_table` reads;
    masses and limits move along."""
    dh = compute_dh_rows(robot, form)
    table: dict[str, Any] = {"name": robot.name, "source": robot.source}
    if robot.gravity is not None:
        table["gravity"] = list(robot.gravity)
    if robot.payload_at_mm is not None:
        table["payload_at_mm"] = list(robot.payload_at_mm)
    if robot.usual != Robot.usual:
        length, angle = robot.usual
        table["usual_mm"] = length
        table["usual_mrad"] = angle * 1e3
    if robot.coupling is not None:
        table["coupling"] = robot.coupling.matrix.tolist()
        if robot.coupling.passive:
            table["passive"] = list(robot.coupling.passive)
    table["convention"] = "modified" if form == "modified" else "standard"
    base = dh.base[:3]
    table["base_mm"] = base.tolist()
    joints = []
    for joint, row, shift in zip(robot.joints, dh.rows, dh.shift, strict=True):
        of_joint = _joint_table(joint, row, shift)
        joints.append(of_joint)
    table["joint"] = joints
    last = robot.last[:3]
    table["last"] = {"transform_mm": last.tolist()}
    return table


def _round_limit(value: float) -> float:
    """Round a limit to twelve digits: 120 degrees, not 119.99999999999999."""
    digits = f"{value:.12g}"
    return float(digits)


def _joint_table(joint: Joint, row: DhRow, shift: Array) -> dict[str, Any]:
    table: dict[str, Any] = {"dh": row.to_table()}
    if joint.prismatic:
        table["kind"] = "prismatic"
    if joint.limits is not None:
        key, scale = "limits_deg", 180 / np.pi
        if joint.prismatic:
            key, scale = "limits_mm", 1.0
        low, high = joint.limits
        table[key] = [_round_limit(low * scale), _round_limit(high * scale)]
    if joint.mass is not None:
        com = inverse(shift) @ [*joint.com, 1.0]
        table["mass_kg"] = joint.mass
        table["com_mm"] = com[:3].tolist()
    return table


def format_robot_table(table: Mapping[str, Any], notes: Sequence[str] = ()) -> str:
    """Write the table of a robot file as TOML; notes are comments above it."""
    joints = table["joint"]
    last = table.get("last")
    head = {key: value for key, value in table.items() if key not in ("joint", "last")}
    lines = []
    for note in notes:
        text = one_line(note)
        lines.append(f"# {text}")
    lines += _format_keys(head)
    for joint in joints:
        lines += ["", "[[joint]]"]
        lines += _format_keys(joint)
    if last is not None:
        lines += ["", "[last]"]
        lines += _format_keys(last)
    return "\n".join(lines) + "\n"


def _format_keys(table: Mapping[str, Any]) -> list[str]:
    lines = []
    for key, value in table.items():
        text = _format_value(value)
        lines.append(f"{key} = {text}")
    return lines


def _format_value(value: Any) -> str:
    """Write a TOML value: text, a number in full, a list, or an inline table."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, Mapping):
        return f"{{ {', '.join(_format_keys(value))} }}"
    return repr(value)
