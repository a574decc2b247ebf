"""Sizes of effects beyond the base and each other, at the measured rows: how far each moves the
target, how far it turns it where orientations were measured, and which of them matter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..._linalg import TINY, orthonormal_basis, project_out
from ..._typing import Array, Index, Mask
from ...mechanisms.terms import Term
from .workspace import Fitted

# of the squares of unit columns, that keeps their Gram matrix invertible
RIDGE = 1e-11


@dataclass(frozen=True, eq=False)
class Sizes:
    """The rms [mm] of every effect beyond the base and those that matter (k,), which matter (k,),
    and the rms of the others together; `rms_rad`, `small_rms_rad`: the rms of their turning [rad]
    beyond the base alone, zero where no orientation was measured."""

    rms: Array
    matters: Mask
    small_rms: float
    rms_rad: Array
    small_rms_rad: float


def measure_sizes(
    fitted: Sequence[Fitted], base: Sequence[Term], threshold: float, mm_per_rad: float = 0.0
) -> Sizes:
    """Measure the effects' sizes at the measured rows, beyond the base's terms; a rad of orientation
    counts as `mm_per_rad`, which is 0 where none was measured.

    Effects are set aside, the smallest first, as long as what one does alone to position and to
    orientation, beyond the base and those that are left, is below the threshold: of two that can
    stand for each other, one stays."""
    workspace = fitted[0].workspace
    count = len(fitted)
    moved = [one.columns for one in fitted]
    moving = _multiply_beyond(fitted, moved, workspace.displace(base))
    owner = np.repeat(np.arange(count), [len(one.terms) for one in fitted])
    none = np.zeros(len(owner), bool)
    grams, turning = [moving], np.zeros_like(moving)
    if mm_per_rad > 0:
        turned = [one.target_turns for one in fitted]
        turning = _multiply_beyond(fitted, turned, workspace.turn_target(base))
        grams.append(mm_per_rad**2 * turning)
    matters = _set_aside(grams, owner, threshold)
    kept = matters[owner]
    rms = [_measure_beyond(moving, owner == k, kept & (owner != k)) for k in range(count)]
    rms_rad = [_measure_beyond(turning, owner == k, none) for k in range(count)]
    small_rms = _measure_beyond(moving, ~kept, kept)
    small_rms_rad = _measure_beyond(turning, ~kept, none)
    return Sizes(np.array(rms), matters, small_rms, np.array(rms_rad), small_rms_rad)


def _multiply_beyond(fitted: Sequence[Fitted], changes: Sequence[Array], base: Array) -> Array:
    """Return the products (c, c) of all terms' changes (k, 3, m) at the measured rows beyond the
    base's (p, 3, m), each times its estimate, so that an effect is the sum of its columns."""
    rows = fitted[0].workspace.measured
    basis = orthonormal_basis(_flatten(base, rows))
    columns = []
    for one, change in zip(fitted, changes, strict=True):
        scaled = _flatten(change, rows) * one.estimate
        columns.append(project_out(scaled, basis))
    beyond = np.concatenate(columns, axis=1) / np.sqrt(rows)
    return np.asarray(beyond.T @ beyond)


def _flatten(displacement: Array, rows: int) -> Array:
    """Return displacements (p, 3, m) of the first rows as columns (3 rows, p)."""
    measured = displacement[:, :, :rows]
    count = len(measured)
    coordinates = 3 * rows
    stacked = measured.reshape(count, coordinates)
    columns = stacked.T
    return np.asarray(columns)


def _set_aside(grams: Sequence[Array], owner: Index, threshold: float) -> Mask:
    """Set effects aside by the products (c, c) of displacements, and of turnings in mm; return which
    stay (k,)."""
    matters = np.ones(int(owner.max()) + 1, bool)
    while matters.any():
        kept = matters[owner]
        each = [_measure_each(gram[np.ix_(kept, kept)], owner[kept]) for gram in grams]
        alone = {k: max(sizes[k] for sizes in each) for k in each[0]}
        smallest = min(alone, key=lambda k: alone[k])
        if alone[smallest] >= threshold:
            break
        matters[smallest] = False
    return matters


def _measure_each(gram: Array, owner: Index) -> dict[int, float]:
    """Measure the rms of every effect beyond all others, from one inverse (Schur's complement)."""
    scale, inner = _normalise(gram)
    inverse = np.linalg.inv(inner)
    alone = {}
    for k in np.unique(owner).tolist():
        own = owner == k
        square = scale[own] @ np.linalg.solve(inverse[np.ix_(own, own)], scale[own])
        alone[k] = float(np.sqrt(max(square, 0.0)))
    return alone


def _measure_beyond(gram: Array, own: Mask, others: Mask) -> float:
    """Measure the rms of the sum of some columns beyond the span of others."""
    square = gram[np.ix_(own, own)].sum()
    if others.any():
        scale, inner = _normalise(gram[np.ix_(others, others)])
        shared = gram[np.ix_(others, own)].sum(1) / scale
        square -= shared @ np.linalg.solve(inner, shared)
    return float(np.sqrt(max(square, 0.0)))


def _normalise(gram: Array) -> tuple[Array, Array]:
    """Return the lengths of columns, and the products of columns of unit length, made invertible."""
    scale = np.sqrt(np.maximum(np.diag(gram), TINY))
    return scale, gram / np.outer(scale, scale) + RIDGE * np.eye(len(gram))
