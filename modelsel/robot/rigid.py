"""Rotations and rigid transforms as plain arrays: R_a_b takes coordinates in b to coordinates in a;
mm and rad."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .._typing import Array

AXES = ("tx", "ty", "tz", "rx", "ry", "rz")


def rotation_matrix(axis: int, angle: ArrayLike) -> Array:
    """Rotation about coordinate axis 0, 1 or 2 by `angle` [rad], shape (..., 3, 3)."""
    angle = np.asarray(angle, float)
    c, s = np.cos(angle), np.sin(angle)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    R = np.zeros((*angle.shape, 3, 3))
    R[..., axis, axis] = 1
    R[..., i, i] = R[..., j, j] = c
    R[..., i, j], R[..., j, i] = -s, s
    return R


def transform(R: ArrayLike | None = None, t: ArrayLike = (0, 0, 0)) -> Array:
    """The (4, 4) homogeneous transform of rotation R (3, 3), the identity without, and translation
    t (3,) [mm]."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.eye(3) if R is None else R, t
    return T


def inverse(T: Array) -> Array:
    """The inverse of a rigid transform (4, 4)."""
    return transform(T[:3, :3].T, -T[:3, :3].T @ T[:3, 3])


def from_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """Rz(yaw) Ry(pitch) Rx(roll), a URDF's fixed-axis angles [rad]; (3, 3)."""
    return rotation_matrix(2, yaw) @ rotation_matrix(1, pitch) @ rotation_matrix(0, roll)


def to_rpy(R: Array) -> tuple[float, float, float]:
    """(roll, pitch, yaw) of a rotation (3, 3), yaw first and the others from what it leaves: exact
    at pitch ±90° too."""
    yaw = float(np.arctan2(R[1, 0], R[0, 0])) if np.hypot(R[1, 0], R[0, 0]) > 1e-12 else 0.0
    rest = rotation_matrix(2, -yaw) @ R
    return (
        float(np.arctan2(-rest[1, 2], rest[1, 1])),
        float(np.arctan2(-rest[2, 0], rest[0, 0])),
        yaw,
    )


def align_z(axis: ArrayLike) -> Array:
    """The smallest rotation that takes z to `axis` (half a turn about x for -z); (3, 3). Rodrigues'
    formula."""
    u = np.asarray(axis, float)
    u = u / np.linalg.norm(u)
    if u[2] < -1 + 1e-12:
        return rotation_matrix(0, np.pi)
    x, y, z = u
    K = np.array([[0, 0, x], [0, 0, y], [-x, -y, 0]])
    return np.asarray(np.eye(3) + K + K @ K / (1 + z))


def nearest_rotation(A: Array) -> Array:
    """The rotation nearest to A (3, 3) in the Frobenius norm (orthogonal Procrustes, det = +1)."""
    U, _, Vt = np.linalg.svd(A)
    return np.asarray(U @ np.diag([1, 1, np.sign(np.linalg.det(U @ Vt))]) @ Vt)


def from_quaternion(wxyz: Array) -> Array:
    """Rotations (m, 3, 3) of quaternions (m, 4) given as w x y z, normalised here."""
    w, x, y, z = (wxyz / np.linalg.norm(wxyz, axis=1, keepdims=True)).T
    R = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    return np.moveaxis(R, -1, 0)


def to_quaternion(R: Array) -> Array:
    """Unit quaternions (m, 4), w x y z with w not negative, of rotations (m, 3, 3)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(np.roll(Rotation.from_matrix(R).as_quat(canonical=True), 1, axis=1))


def rotation_vector(R: Array) -> Array:
    """Rotation vectors (m, 3) [rad] of rotations (m, 3, 3): axis times angle."""
    from scipy.spatial.transform import (
        Rotation,  # slow to import, and only orientation data need it
    )

    return np.asarray(Rotation.from_matrix(R).as_rotvec())
