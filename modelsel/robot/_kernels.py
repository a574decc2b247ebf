"""Allocation-free kinematics kernels: named buffers, sparse constant transforms, in-place rotations
and cross products.

Every array has its components first and the configurations last, so that an operation is one
stride."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .._typing import Array
from .rigid import MIXED_AXES

# a frame's axes (3, 3, m) or (3, 3, 1), an axis a row, and its origin (3, m) or (3, 1)
Frame = tuple[Array, Array]
# configurations x frames whose cross products are made together: few calls, and they stay in cache
CROSS_PRODUCT_BLOCK = 3000
BASE_FRAME: Frame = (np.eye(3)[:, :, None], np.zeros((3, 1)))
# (index, value) of the non-zero entries of a vector
SparseVector = tuple[tuple[int, float], ...]
# for each axis the index it moves to and its sign; here every axis stays where it is
AXES_IN_PLACE = ((0, 1.0), (1, 1.0), (2, 1.0))
# what rounding leaves of cos 90°, and less, is zero
ROUNDED_TO_ZERO = 1e-15


def nonzero_entries(vector: Array) -> SparseVector:
    """List the non-zero entries of a vector; fixed transforms have few."""
    return tuple((i, value) for i, value in enumerate(vector.tolist()) if value)


@dataclass(frozen=True)
class FixedTransform:
    """A fixed transform: the `offset` of its origin along its own axes, the `columns` of its
    rotation in the earlier axes, and, where the rotation only permutes axes, the (index, ±1) that
    each earlier axis `moves` to."""

    offset: SparseVector
    columns: tuple[SparseVector, ...]
    moves: tuple[tuple[int, float], ...]

    @staticmethod
    def of(N: Array) -> FixedTransform:
        """Prepare a homogeneous transform (4, 4)."""
        R = np.where(np.abs(N[:3, :3]) < ROUNDED_TO_ZERO, 0.0, N[:3, :3])
        offset = nonzero_entries(R.T @ N[:3, 3])
        columns = tuple(nonzero_entries(column) for column in R.T)
        permutes_axes = bool(np.isin(R, (-1.0, 0.0, 1.0)).all())
        moves = tuple(nonzero_entries(row)[0] for row in R) if permutes_axes else ()
        return FixedTransform(offset, columns, moves)


@dataclass(frozen=True, eq=False)
class Workspace:
    """Arrays by name, made once for blocks of one size: walking the chain again then allocates
    nothing."""

    _arrays: dict[str, Array] = field(default_factory=dict)
    _values: dict[str, tuple[object, Any]] = field(default_factory=dict)

    def once(self, name: str, of: Any, make: Callable[[Any], Any]) -> Any:
        """Return make(of), computed once as long as the same object is asked for."""
        if name not in self._values or self._values[name][0] is not of:
            self._values[name] = of, make(of)
        return self._values[name][1]

    def array(self, name: str, *shape: int) -> Array:
        """Return the array of that name and shape; it holds whatever was last written to it."""
        buffer = self._arrays.get(name)
        if buffer is None or buffer.shape != shape:
            buffer = np.empty(shape)
            self._arrays[name] = buffer
        return buffer


def compute_sine_and_cosine(angle: Array, sine: Array, cosine: Array) -> None:
    """Write the sine and the cosine of an angle [rad] into arrays of its shape.

    From t = tan(angle/2): cos = 2/(1 + t²) − 1 and sin = 2t/(1 + t²); numpy's tan is the fast one."""
    np.multiply(angle, 0.5, out=sine)
    np.tan(sine, out=sine)
    np.multiply(sine, sine, out=cosine)
    cosine += 1.0
    np.divide(sine, cosine, out=sine)
    np.divide(2.0, cosine, out=cosine)
    sine += sine
    cosine -= 1.0


def compute_joint_turns(q: Array, space: Workspace) -> Array:
    """Compute (n, 3, 3, m): cos, sin and −sin of the readings q (m, n), each three times for the
    three components."""
    m, n = q.shape
    sine = space.array("sine", n, m)
    cosine = space.array("cosine", n, m)
    compute_sine_and_cosine(q.T, sine, cosine)
    turns = space.array("turns", n, 3, 3, m)
    turns[:, 0] = cosine[:, None]
    turns[:, 1] = sine[:, None]
    np.negative(turns[:, 1], out=turns[:, 2])
    return turns


def add_weighted(
    out: Array, vectors: Array, weights: Sequence[tuple[int, Array | float]], scratch: Array
) -> None:
    """Add Σ weight · vector, over (index of the vector, weight), to `out` in place."""
    for index, weight in weights:
        np.multiply(vectors[index], weight, out=scratch)
        out += scratch


def rotate_by_fixed(
    axes: Array, columns: Sequence[SparseVector], out: Array, scratch: Array
) -> None:
    """Multiply axes, three of (3, m), by a constant rotation given by its columns, into out (3, 3,
    m)."""
    for j, ((first, weight), *others) in enumerate(columns):
        np.multiply(axes[first], weight, out=out[j])
        add_weighted(out[j], axes, others, scratch)


def rotate_about_axis(
    axes: Array, axis: int, turn: Array, to: Sequence[tuple[int, float]], out: Array, scratch: Array
) -> None:
    """Turn axes (3, 3, m) about one of them, and send each `to` a place in out (3, 3, m) with a
    sign; `turn` (3, 3, m) holds cos, sin and −sin of the angle.

    Both axes that the turn mixes are written by one product: [::step][:2] views rows i and j, in
    this order, as one array, whichever comes first in memory."""
    i, j = MIXED_AXES[axis]
    source = axes.reshape(3, -1)
    result = out.reshape(3, -1)
    cos_sin = turn.reshape(3, -1)
    (first, first_sign), (second, second_sign) = to[i], to[j]
    still, still_sign = to[axis]
    mixed = result[first :: second - first][:2]
    np.multiply(source[i :: j - i][:2], cos_sin[0], out=mixed)
    mixed += np.multiply(source[j :: i - j][:2], cos_sin[1:], out=scratch.reshape(2, -1))
    if first_sign < 0:
        np.negative(result[first], out=result[first])
    if second_sign < 0:
        np.negative(result[second], out=result[second])
    np.multiply(source[axis], still_sign, out=result[still])


def apply_error_transform(axes: Array, origin: Array, entries: Array, space: Workspace) -> Frame:
    """Apply a frame's error transform H to it: Trans, then Rx, Ry, Rz, each about the axis that the
    earlier ones left it.

    axes (6, 3, m): the frame's axes; the last three are overwritten by those its rotations turn
    about. entries (6, m): a b c α β γ."""
    m = entries.shape[1]
    scratch = space.array("scratch", 2, 3, m)
    turn = space.array("turn", 3, 3, m)
    add_weighted(origin, axes, tuple(enumerate(entries[:3])), scratch[0])
    R = axes[:3]
    for a in range(3):
        axes[3 + a] = R[a]
        angle = entries[3 + a]
        constant = angle[0] == angle[-1] and bool((angle == angle[0]).all())
        if constant and not angle[:1].any():
            continue
        _fill_turn(turn, angle[:1] if constant else angle)  # one cosine does for all rows
        turned = space.array(f"twisted{a}", 3, 3, m)
        rotate_about_axis(R, a, turn, AXES_IN_PLACE, turned, scratch)
        R = turned
    return R, origin


def _fill_turn(turn: Array, angle: Array) -> None:
    """Write cos, sin and −sin of an angle, (m,) or (1,), into turn (3, 3, m)."""
    sine = np.empty_like(angle)
    cosine = np.empty_like(angle)
    compute_sine_and_cosine(angle, sine, cosine)
    turn[0] = cosine
    turn[1] = sine
    minus = turn[2]
    np.negative(turn[1], out=minus)


def fill_screw_field(
    field_: Array, origins: Array, target: Array, twisted: bool, space: Workspace
) -> None:
    """Turn axes (n+1, 6, c, m) into the screw field, in place: tx ty tz the axis, rx ry rz axis x
    lever; with c = 6 the target frame's rotation below.

    `twisted`: the rotational axes differ from the translational ones and stand in rows 3 to 5."""
    frames, _, components, m = field_.shape
    step = min(max(1, CROSS_PRODUCT_BLOCK // max(m, 1)), frames)
    levers = space.array("lever", step, 4, m)
    products = space.array("product", step, 3, 3, m)
    last_components = space.array("first", step, 3, m)
    for start in range(0, frames, step):
        block = field_[start : start + step]
        lever = levers[: len(block)]
        np.subtract(target, origins[start : start + step], out=lever[:, :3])
        lever[:, 3] = lever[:, 0]  # x y z x: two components of a product are one stride
        axes = block[:, 3:, :3] if twisted else block[:, :3, :3]
        if components == 6:
            block[:, :3, 3:] = 0.0
            block[:, 3:, 3:] = axes
        product = products[: len(block)]
        aside = last_components[: len(block)] if twisted else None
        _cross_into(block[:, 3:, :3], axes, lever, product, aside)


def _cross_into(
    out: Array, axes: Array, lever: Array, subtracted: Array, aside: Array | None
) -> None:
    """Write axes x lever to out (k, 3, 3, m); lever (k, 4, m) is x y z x, `subtracted` a buffer.

    `aside` (k, 3, m): a buffer for the last component where `out` is where the axes stand."""
    lever_y = lever[:, None, 1]
    lever_zx = lever[:, None, 2:]
    np.multiply(axes[:, :, 2], lever_y, out=subtracted[:, :, 0])
    np.multiply(axes[:, :, :2], lever_zx, out=subtracted[:, :, 1:])
    z = out[:, :, 2] if aside is None else aside
    np.multiply(axes[:, :, 0], lever_y, out=z)
    np.multiply(axes[:, :, 1:], lever_zx, out=out[:, :, :2])
    if aside is not None:
        out[:, :, 2] = aside
    out -= subtracted
