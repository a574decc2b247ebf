"""Walking a chain without allocating: arrays kept by name, fixed transforms without their noughts,
turns and crosses in place.

Every array has its components first and the configurations last, so that an operation is one
stride."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .._typing import Array

Frame = tuple[
    Array, Array
]  # its axes (3, 3, m) or (3, 3, 1), an axis a row, and its origin (3, m) or (3, 1)
# configurations x frames whose cross products are made together: few calls, and they stay in cache
CROSS_PRODUCT_BLOCK = 3000
BASE_FRAME: Frame = (np.eye(3)[:, :, None], np.zeros((3, 1)))
SparseVector = tuple[tuple[int, float], ...]  # (index, value) of what is not nought


def nonzero_entries(vector: Array) -> SparseVector:
    """What a vector has that is not nought: fixed transforms are mostly noughts."""
    return tuple((i, v) for i, v in enumerate(vector.tolist()) if v)


@dataclass(frozen=True)
class FixedTransform:
    """A fixed transform: the `offset` of its origin on its own axes, these axes' `columns` on the
    earlier ones, and where each of the earlier ones goes, (index, ±1), if it goes whole."""

    offset: SparseVector
    columns: tuple[SparseVector, ...]
    moves: tuple[tuple[int, float], ...]

    @staticmethod
    def of(N: Array) -> FixedTransform:
        """Of (4, 4); what rounding leaves of cos 90° is nought."""
        R = np.where(np.abs(N[:3, :3]) < 1e-15, 0.0, N[:3, :3])
        whole = bool(np.isin(R, (-1.0, 0.0, 1.0)).all())
        return FixedTransform(
            nonzero_entries(R.T @ N[:3, 3]),
            tuple(nonzero_entries(column) for column in R.T),
            tuple(nonzero_entries(row)[0] for row in R) if whole else (),
        )


@dataclass(frozen=True, eq=False)
class Workspace:
    """Arrays by name, made once for blocks of one size: walking the chain again then allocates
    nothing."""

    _arrays: dict[str, Array] = field(default_factory=dict)

    _values: dict[str, tuple[object, Any]] = field(default_factory=dict)

    def once(self, name: str, of: Any, make: Callable[[Any], Any]) -> Any:
        """make(of), as long as it is asked of the same object."""
        if name not in self._values or self._values[name][0] is not of:
            self._values[name] = of, make(of)
        return self._values[name][1]

    def array(self, name: str, *shape: int) -> Array:
        """The array of that name and shape; its numbers are whatever was left in it."""
        found = self._arrays.get(name)
        if found is None or found.shape != shape:
            found = self._arrays[name] = np.empty(shape)
        return found


def compute_joint_turns(q: Array, space: Workspace) -> Array:
    """(n, 3, 3, m): cos, sin and −sin of the readings, thrice for the three components, from t =
    tan(q/2): (1 − t²)/(1 + t²) and 2t/(1 + t²); numpy's tan is the fast one."""
    m, n = q.shape
    t, u = space.array("tan", n, m), space.array("square", n, m)
    np.multiply(q.T, 0.5, out=t)
    np.tan(t, out=t)
    np.multiply(t, t, out=u)
    u += 1.0
    np.divide(t, u, out=t)
    np.divide(2.0, u, out=u)
    t += t
    u -= 1.0
    wide = space.array("turns", n, 3, 3, m)
    wide[:, 0], wide[:, 1] = u[:, None], t[:, None]
    np.negative(wide[:, 1], out=wide[:, 2])
    return wide


def add_weighted(
    out: Array, vectors: Array, weights: Sequence[tuple[int, Array | float]], scratch: Array
) -> None:
    """out += Σ weight · vector over (which vector, weight)."""
    for i, weight in weights:
        np.multiply(vectors[i], weight, out=scratch)
        out += scratch


def rotate_by_fixed(
    axes: Array, columns: Sequence[SparseVector], out: Array, scratch: Array
) -> None:
    """Axes (three of (3, m)) times a constant rotation, given by its columns, into out (3, 3,
    m)."""
    for j, ((first, weight), *others) in enumerate(columns):
        np.multiply(axes[first], weight, out=out[j])
        add_weighted(out[j], axes, others, scratch)


def rotate_about_axis(
    axes: Array, axis: int, turn: Array, to: Sequence[tuple[int, float]], out: Array, scratch: Array
) -> None:
    """Axes (3, 3, m) after a turn about one of them by an angle whose (cos; sin, −sin) stand in
    `turn` (3, 3, m), each sent `to` a place in out (3, 3, m) with a sign."""
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    flat, there, angle = axes.reshape(3, -1), out.reshape(3, -1), turn.reshape(3, -1)
    (first, sign), (second, other), (still, kept) = to[i], to[j], to[axis]
    pair = there[first :: second - first][:2]
    np.multiply(flat[i :: j - i][:2], angle[0], out=pair)
    pair += np.multiply(flat[j :: i - j][:2], angle[1:], out=scratch.reshape(2, -1))
    for row, turned in ((first, sign), (second, other)):
        if turned < 0:
            np.negative(there[row], out=there[row])
    np.multiply(flat[axis], kept, out=there[still])


AXES_IN_PLACE = ((0, 1.0), (1, 1.0), (2, 1.0))  # every axis stays where it is


def apply_error_transform(here: Array, origin: Array, entries: Array, space: Workspace) -> Frame:
    """The frame after its H: Trans, then Rx, Ry, Rz, each about the axis that the earlier ones left
    it; entries (6, m)."""
    m = entries.shape[1]
    two, turn = space.array("scratch", 2, 3, m), space.array("turn", 3, 3, m)
    add_weighted(origin, here, tuple(enumerate(entries[:3])), two[0])
    R = here[:3]
    for a in range(3):
        here[3 + a] = R[a]
        angle = entries[3 + a]
        alike = bool((angle == angle[:1]).all())  # most entries are: one cosine does for all rows
        if not alike or angle[:1].any():
            one = angle[:1] if alike else angle
            turn[0], turn[1] = np.cos(one), np.sin(one)
            np.negative(turn[1], out=turn[2])
            out = space.array(f"twisted{a}", 3, 3, m)
            rotate_about_axis(R, a, turn, AXES_IN_PLACE, out, two)
            R = out
    return R, origin


def fill_screw_field(
    field_: Array, origins: Array, target: Array, twisted: bool, space: Workspace
) -> None:
    """Axes (n+1, 6, c, m) become the screw field, in place: tx ty tz the axis, rx ry rz axis x
    lever; with c = 6 the target frame's rotation below."""
    frames, _, c, m = field_.shape
    step = min(max(1, CROSS_PRODUCT_BLOCK // max(m, 1)), frames)
    levers, products = (
        space.array("lever", step, 4, m),
        space.array("product", step, 3, 3, m),
    )  # x y z x: two components of
    firsts = space.array("first", step, 3, m)  # a product are one stride
    for start in range(0, frames, step):
        some = field_[start : start + step]
        n = len(some)
        lever, product, first = levers[:n], products[:n], firsts[:n]
        axes, out = some[:, 3:, :3] if twisted else some[:, :3, :3], some[:, 3:, :3]
        np.subtract(target, origins[start : start + n], out=lever[:, :3])
        lever[:, 3] = lever[:, 0]
        if c == 6:
            some[:, :3, 3:], some[:, 3:, 3:] = 0.0, axes
        y, zx = lever[:, None, 1], lever[:, None, 2:]
        np.multiply(axes[:, :, 2], y, out=product[:, :, 0])
        np.multiply(axes[:, :, :2], zx, out=product[:, :, 1:])
        if twisted:  # the axes stand where their products go
            np.multiply(axes[:, :, 0], y, out=first)
            np.multiply(axes[:, :, 1:], zx, out=out[:, :, :2])
            out[:, :, 2] = first
        else:
            np.multiply(axes[:, :, 0], y, out=out[:, :, 2])
            np.multiply(axes[:, :, 1:], zx, out=out[:, :, :2])
        out -= product
