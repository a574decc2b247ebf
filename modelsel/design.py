"""Design matrix of any model: screw field x causes, in whitened blocks, at the nominal or at a fitted point.

Arrays keep configurations last: columns (p, c, m), residuals (c, m); reshaped to (p, c·m) a block is a Fortran-ordered
matrix without a copy.
"""
from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .rigid import AXES, Array, rotation_vector
from .robot import Pose
from .scene import Scene
from .screws import Mechanism, Term, terms_of

PLACE = {axis: a for a, axis in enumerate(AXES)}


@dataclass(frozen=True)
class Model:
    """A candidate model: mechanisms, in order; terms they share are fitted once."""

    mechanisms: tuple[Mechanism, ...]

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        """The fitted numbers."""
        return terms_of(self.mechanisms)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the mechanisms."""
        return tuple(m.name for m in self.mechanisms)

    def __add__(self, more: Sequence[Mechanism]) -> Model:
        return Model((*self.mechanisms, *(m for m in more if m not in self.mechanisms)))


def twist_of(scene: Scene, terms: Sequence[Term], theta: Array, rows: slice) -> Array:
    """Entries (n+1, 6, rows) of every frame's H at parameters theta (p,)."""
    out = np.zeros((scene.robot.n + 1, 6, rows.stop - rows.start))
    for value, term in zip(theta, terms, strict=True):
        if value:
            for s in term.screws:
                out[s.frame - 1, PLACE[s.axis]] += value * _rows(scene.cause(s.cause), rows)
    return out


def _rows(cause: Array | float, rows: slice) -> Array | float:
    return cause if isinstance(cause, float) else cause[rows]


def _whiten(scene: Scene, values: Array, rows: slice) -> Array:
    """Whitened copy of (..., c, rows)."""
    if isinstance(scene.whiten, float):
        return values * scene.whiten
    return np.asarray(np.einsum("mij,...jm->...im", scene.whiten[rows], values))


def field_of(scene: Scene, at: Pose, rows: slice) -> Array:
    """Screw field (n+1, 6, c, rows) of a pose in the tracker's frame: mm (and rad of the target frame) per unit screw."""
    R = scene.placement[0][scene.data.group[rows]]
    single = len(scene.placement[0]) == 1
    def rotate(values: Array) -> Array:
        if single:
            return np.asarray(np.tensordot(R[0], values, (1, 2)).transpose(1, 2, 0, 3))
        return np.asarray(np.einsum("mij,fajm->faim", R, values))
    moved = rotate(at.displacement())
    return moved if scene.components == 3 else np.concatenate([moved, rotate(at.rotational())], axis=2)


def residual_of(scene: Scene, at: Pose, rows: slice) -> Array:
    """Measured minus predicted (c, rows): mm, and with orientations the rotation vector [rad], in the tracker's frame."""
    data = scene.data
    R, t = scene.placement[0][data.group[rows]], scene.placement[1][data.group[rows]]
    out: Array = data.position[rows].T - np.einsum("mij,jm->im", R, at.target) - t.T
    if data.rotation is None:
        return out
    predicted = np.einsum("mij,jkm->mik", R, at.rotation)
    turned = rotation_vector(np.einsum("mij,mkj->mik", data.rotation[rows], predicted))
    return np.concatenate([out, turned.T])


def columns_of(scene: Scene, field: Array, terms: Sequence[Term], rows: slice) -> Array:
    """Columns (p, c, rows) of terms from a screw field."""
    out = np.empty((len(terms), *field.shape[2:]))
    for k, term in enumerate(terms):
        first, *others = term.screws
        np.multiply(field[first.frame - 1, PLACE[first.axis]], _rows(scene.cause(first.cause), rows), out=out[k])
        for s in others:
            out[k] += field[s.frame - 1, PLACE[s.axis]] * _rows(scene.cause(s.cause), rows)
    return out


def residuals(scene: Scene, terms: Sequence[Term] = (), theta: Array | None = None) -> Array:
    """Exact residuals (m, c) [mm, rad], not whitened, at parameters theta; the nominal model without."""
    out = np.empty((len(scene), scene.components))
    for rows in scene.blocks():
        twist = None if theta is None else twist_of(scene, terms, theta, rows)
        out[rows] = residual_of(scene, scene.pose(rows, twist), rows).T
    return out


def whitened(scene: Scene, residual: Array) -> Array:
    """Residuals (m, c) in units of their standard uncertainty, (m, c)."""
    return np.asarray(_whiten(scene, residual.T, slice(0, len(residual))).T)


def blocks(scene: Scene, terms: Sequence[Term], at: tuple[Sequence[Term], Array] | None = None
           ) -> Iterator[tuple[slice, Array, Array]]:
    """(rows, whitened columns (p, c, rows), whitened residual (c, rows)), linearised at the fitted point `at`
    (terms, theta), or at the nominal model."""
    for rows in scene.blocks():
        twist = None if at is None else twist_of(scene, *at, rows)
        pose = scene.pose(rows, twist)
        columns = columns_of(scene, field_of(scene, pose, rows), terms, rows)
        yield rows, _whiten(scene, columns, rows), _whiten(scene, residual_of(scene, pose, rows), rows)


def design(scene: Scene, terms: Sequence[Term], at: tuple[Sequence[Term], Array] | None = None) -> tuple[Array, Array]:
    """Whole design (m, c, p) and residual (m, c), whitened; for data that fit in memory."""
    parts = [(columns, residual) for _, columns, residual in blocks(scene, terms, at)]
    return (np.concatenate([c for c, _ in parts], axis=2).transpose(2, 1, 0),
            np.concatenate([r for _, r in parts], axis=1).T)
