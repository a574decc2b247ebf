"""Rotations and rigid transforms as plain arrays: R_a_b takes coordinates in b to coordinates in a;
mm and rad.

The formulas of roll-pitch-yaw angles, quaternions, turns and the nearest rotation stand here
although scipy.spatial.transform.Rotation has them: that module takes longer to import than the
whole command line, robot files are read before anything else, and its angles at gimbal lock and its normalisation
round differently. Quaternions and rotation vectors of measured orientations do use it, imported
late."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from .._typing import Array

Axis = Literal["tx", "ty", "tz", "rx", "ry", "rz"]
AXES: tuple[str, ...] = get_args(Axis)
# the two axes that a rotation about axis 0, 1 or 2 mixes, in right-handed order
MIXED_AXES = ((1, 2), (2, 0), (0, 1))
# [rad] up to which half a turn's sine over the turn is taken from its series
SMALL_TURN = 1e-3


def rotation_matrix(axis: int, angle: ArrayLike) -> Array:
    """Rotate about coordinate axis 0, 1 or 2 by `angle` [rad]: matrices of shape (..., 3, 3)."""
    angle = np.asarray(angle, float)
    cosine = np.cos(angle)
    sine = np.sin(angle)
    i, j = MIXED_AXES[axis]
    shape = (*angle.shape, 3, 3)
    R = np.zeros(shape)
    R[..., axis, axis] = 1
    R[..., i, i] = cosine
    R[..., j, j] = cosine
    R[..., i, j] = -sine
    R[..., j, i] = sine
    return R


def transform(R: ArrayLike | None = None, t: ArrayLike = (0, 0, 0)) -> Array:
    """Compose the (4, 4) homogeneous transform of rotation R (3, 3), the identity by default, and
    translation t (3,) [mm]."""
    T = np.eye(4)
    if R is not None:
        T[:3, :3] = R
    T[:3, 3] = t
    return T


def inverse(T: Array) -> Array:
    """Invert a rigid transform (4, 4)."""
    R = T[:3, :3]
    R_inverse = R.T
    offset = T[:3, 3]
    return transform(R_inverse, -R_inverse @ offset)


def from_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """Compute Rz(yaw) Ry(pitch) Rx(roll), a URDF's fixed-axis angles [rad]; (3, 3)."""
    about_x = rotation_matrix(0, roll)
    about_y = rotation_matrix(1, pitch)
    about_z = rotation_matrix(2, yaw)
    return about_z @ about_y @ about_x


def to_rpy(R: Array) -> tuple[float, float, float]:
    """Extract (roll, pitch, yaw) of a rotation (3, 3): yaw first, the others from what remains
    without it, so that the result is exact at pitch ±90° too."""
    x, y, _ = R[:, 0]
    yaw = 0.0
    if np.hypot(y, x) > 1e-12:
        yaw = float(np.arctan2(y, x))
    backwards = rotation_matrix(2, -yaw)
    rest = backwards @ R
    pitch = np.arctan2(-rest[2, 0], rest[0, 0])
    roll = np.arctan2(-rest[1, 2], rest[1, 1])
    return float(roll), float(pitch), yaw


def align_z(axis: ArrayLike) -> Array:
    """Compute the smallest rotation (3, 3) that takes z to `axis`, half a turn about x for -z, by
    Rodrigues' formula."""
    u = np.asarray(axis, float)
    u = u / np.linalg.norm(u)
    x, y, z = u
    if z < -1 + 1e-12:
        return rotation_matrix(0, np.pi)
    K = np.array([[0, 0, x], [0, 0, y], [-x, -y, 0]])
    squared = K @ K / (1 + z)
    R = np.eye(3) + K + squared
    return np.asarray(R)


def nearest_rotation(A: Array) -> Array:
    """Find the rotation nearest to A (3, 3) in the Frobenius norm (orthogonal Procrustes, det =
    +1)."""
    U, _, Vt = np.linalg.svd(A)
    product = U @ Vt
    determinant = np.linalg.det(product)
    signs = [1, 1, np.sign(determinant)]
    nearest = U @ np.diag(signs) @ Vt
    return np.asarray(nearest)


def tidy_rotations(R: Array) -> Array:
    """Take the rounding errors out of rotations (..., 3, 3), such as products of rotations: one step
    of Newton's method for the nearest rotation, whose error is the square of what is off."""
    squared = np.swapaxes(R, -1, -2) @ R
    return np.asarray(R @ (1.5 * np.eye(3) - 0.5 * squared))


def from_rotation_vector(vector: Array) -> Array:
    """Convert rotation vectors (..., 3) [rad], axis times angle, to rotations (..., 3, 3).

    To the last bit what scipy's Rotation makes of them: it decides between causes that explain the
    data equally well."""
    x, y, z = np.moveaxis(vector, -1, 0)
    angle = np.sqrt(x * x + y * y + z * z)
    square = angle * angle
    is_small = angle <= SMALL_TURN
    series = 0.5 - square / 48 + square * square / 3840
    scale = np.where(is_small, series, np.sin(angle / 2) / np.where(is_small, 1.0, angle))
    w, x, y, z = np.cos(angle / 2), scale * x, scale * y, scale * z
    xx, yy, zz, ww = x * x, y * y, z * z, w * w
    xy, xz, yz, xw, yw, zw = x * y, x * z, y * z, x * w, y * w, z * w
    R = np.empty((*angle.shape, 3, 3))
    R[..., 0, 0] = xx - yy - zz + ww
    R[..., 0, 1] = 2 * (xy - zw)
    R[..., 0, 2] = 2 * (xz + yw)
    R[..., 1, 0] = 2 * (xy + zw)
    R[..., 1, 1] = -xx + yy - zz + ww
    R[..., 1, 2] = 2 * (yz - xw)
    R[..., 2, 0] = 2 * (xz - yw)
    R[..., 2, 1] = 2 * (yz + xw)
    R[..., 2, 2] = -xx - yy + zz + ww
    return R


def from_quaternion(wxyz: Array) -> Array:
    """Convert quaternions (m, 4), given as w x y z and normalised here, to rotations (m, 3, 3)."""
    length = np.linalg.norm(wxyz, axis=1, keepdims=True)
    w, x, y, z = (wxyz / length).T
    xx = x * x
    yy = y * y
    zz = z * z
    xy = x * y
    xz = x * z
    yz = y * z
    xw = x * w
    yw = y * w
    zw = z * w
    R = np.array(
        [
            [1 - 2 * (yy + zz), 2 * (xy - zw), 2 * (xz + yw)],
            [2 * (xy + zw), 1 - 2 * (xx + zz), 2 * (yz - xw)],
            [2 * (xz - yw), 2 * (yz + xw), 1 - 2 * (xx + yy)],
        ]
    )
    return np.moveaxis(R, -1, 0)


def to_quaternion(R: Array) -> Array:
    """Convert rotations (m, 3, 3) to unit quaternions (m, 4): w x y z with w not negative."""
    from scipy.spatial.transform import Rotation

    xyzw = Rotation.from_matrix(R).as_quat(canonical=True)
    return np.asarray(np.roll(xyzw, 1, axis=1))


def rotation_vector(R: Array) -> Array:
    """Convert rotations (m, 3, 3) to rotation vectors (m, 3) [rad]: axis times angle."""
    # slow to import, and only orientation data need it
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(R).as_rotvec())
