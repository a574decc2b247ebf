"""Denavit-Hartenberg parameters of any chain, standard and modified, exactly; and the robot file
that holds them.

A fixed transform between two joints is Rz(φ) Tz(d) · Tx(a) Rx(α) · Rz(ψ) Tz(e): along the first
axis to the common normal, along the normal, along the second axis (Denavit & Hartenberg 1955). What
turns about an axis or slides along it goes into its own joint's row."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._typing import Array
from ..exceptions import one_line
from .kinematics import Robot
from .rigid import inverse, rotation_matrix, transform

PARALLEL = (
    1e-9  # rad: two axes closer than this have no common normal worth naming; 1e-6 mm at a metre
)
NEARLY = 0.02  # rad: below this, offsets along the axes are many times the link


@dataclass(frozen=True)
class DhRows:
    """`base` (4, 4) from frame 0 to the first row; one row a joint: θ [rad], d, a [mm], α [rad];
    `shift` (n, 4, 4): from a joint's frame in the chain to its frame here; `nearly` (k, k+1) joints
    whose axes are almost, not quite, parallel."""

    base: Array
    rows: tuple[tuple[float, float, float, float], ...]
    shift: tuple[Array, ...]
    nearly: tuple[tuple[int, int], ...]


def _normal(N: Array) -> tuple[float, float, float, float, float, float]:
    """(φ, d, a, α, ψ, e) of a transform."""
    u, p = N[:3, 2], N[:3, 3]
    sine = float(np.hypot(u[0], u[1]))
    if sine < PARALLEL:
        phi, d, e = (
            (float(np.arctan2(p[1], p[0])) if np.hypot(p[0], p[1]) > PARALLEL else 0.0),
            float(p[2]),
            0.0,
        )
        alpha = 0.0 if u[2] > 0 else np.pi
    else:
        phi = float(np.arctan2(u[0], -u[1]))
        alpha = float(np.arctan2(sine, u[2]))
        across = np.array([-np.sin(phi), np.cos(phi), 0.0])
        e = float(-(p @ across) / sine)
        d = float(p[2] - e * u[2])
    a = float(p[0] * np.cos(phi) + p[1] * np.sin(phi))
    rest = (rotation_matrix(2, phi) @ rotation_matrix(0, alpha)).T @ N[:3, :3]
    return phi, d, a, float(alpha), float(np.arctan2(rest[1, 0], rest[0, 0])), e


def compute_dh_rows(robot: Robot, modified: bool) -> DhRows:
    """DH rows of a chain; `robot.last` stays as it is, after the last row."""
    rows, shift, nearly = list[tuple[float, float, float, float]](), list[Array](), []
    turned = slid = 0.0  # what the transform before left for this joint's own axis
    before = (0.0, 0.0)  # the a and α that lead here
    for k in range(robot.n):
        phi = d = a = alpha = psi = e = 0.0
        if k + 1 < robot.n:
            phi, d, a, alpha, psi, e = _normal(robot.joints[k + 1].before)
            if PARALLEL < np.sin(alpha) < NEARLY:
                nearly.append((k + 1, k + 2))
        rows.append((turned + phi, slid + d, *(before if modified else (a, alpha))))
        shift.append(transform(rotation_matrix(2, phi), (0.0, 0.0, d if modified else -slid)))
        before, turned, slid = (a, alpha), psi, e
    return DhRows(robot.joints[0].before, tuple(rows), tuple(shift), tuple(nearly))


def format_dh_file(robot: Robot, modified: bool, notes: Sequence[str] = ()) -> str:
    """A robot file (TOML) of DH rows; numbers in full, masses and limits move along."""
    found = compute_dh_rows(robot, modified)
    lines = [
        *(f"# {one_line(note)}" for note in notes),
        f"name = {_text(robot.name)}",
        f"source = {_text(robot.source)}",
    ]
    if robot.gravity is not None:
        lines.append(f"gravity = {list(robot.gravity)}")
    if robot.usual != Robot.usual:
        lines += [f"usual_mm = {robot.usual[0]!r}", f"usual_mrad = {robot.usual[1] * 1e3!r}"]
    lines += [
        f'convention = "{"modified" if modified else "standard"}"',
        f"base_mm = {found.base[:3].tolist()}",
    ]
    for joint, row, shift in zip(robot.joints, found.rows, found.shift, strict=True):
        theta, d, a, alpha = (
            float(v) for v in (np.degrees(row[0]), row[1], row[2], np.degrees(row[3]))
        )
        lines += [
            "",
            "[[joint]]",
            f"dh = {{ theta_deg = {theta!r}, d_mm = {d!r}, a_mm = {a!r}, alpha_deg = {alpha!r} }}",
        ]
        if joint.prismatic:
            lines.append('kind = "prismatic"')
        if joint.limits is not None:
            scale, unit = (1.0, "mm") if joint.prismatic else (180 / np.pi, "deg")
            lines.append(f"limits_{unit} = {[float(v * scale) for v in joint.limits]}")
        if joint.mass is not None:
            com = inverse(shift) @ [*joint.com, 1.0]
            lines += [f"mass_kg = {joint.mass!r}", f"com_mm = {com[:3].tolist()}"]
    return "\n".join([*lines, "", "[last]", f"transform_mm = {robot.last[:3].tolist()}"]) + "\n"


def _text(words: str) -> str:
    """A TOML string."""
    return json.dumps(words, ensure_ascii=False)
