"""Faults of the data, found among the gross outliers: rows whose position belongs to another row."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..data.measurements import Index
from ..fitting.fit import Fit
from ..matrix.scene import Scene
from ..words.rigid import Array
from .robust import Mask, scale_of

MATCH = 8.0        # robust standard deviations within which a position fits another row
DRAWS = 1999
CERTAIN = 0.05
MOST_ROWS = 1000   # outlying rows: among more, every position finds a reading that it fits


@dataclass(frozen=True, eq=False)
class Fault:
    """A data fault: its name, the rows of the file it concerns (0-based), a sentence, and how often chance does as well."""

    name: str
    rows: Index
    sentence: str
    p: float


def misplaced(scene: Scene, outlying: Mask, fitted: Fit, rng: np.random.Generator) -> tuple[Fault, ...]:
    """Outlying rows whose positions fit each other's joint readings or targets: swapped reflectors where they share a
    configuration, a wrong order of rows elsewhere. Chance: the same distances in random directions."""
    gauges = scene.data.gauges
    points = np.ones(len(outlying), bool) if gauges is None else gauges.of("point")
    at = np.flatnonzero(outlying & points)
    if not 2 <= len(at) <= MOST_ROWS:
        return ()
    residual = fitted.residuals(scene)[:, :3]
    near = MATCH * scale_of(np.linalg.norm(residual[~outlying & points], axis=1))
    measured = scene.data.position[at]
    predicted = measured - residual[at]
    fits = _fits(measured, predicted, near)
    if fits.sum() < 2:
        return ()
    direction = rng.standard_normal((DRAWS, len(at), 3))
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    away = predicted + direction * np.linalg.norm(residual[at], axis=1)[:, None]
    chance = np.array([_fits(one, predicted, near).sum() for one in away])
    p = float((1 + (chance >= fits.sum()).sum()) / (DRAWS + 1))
    if p > CERTAIN:
        return ()
    rows, data = at[fits], scene.data
    partner = _partner(measured, predicted)[fits]
    together = data.configuration[rows] == data.configuration[at[partner]]
    out = []
    for name, mask, words in (
            ("swapped-reflectors", together, "the reflectors of these rows are swapped: each position fits the other target"),
            ("row-order", ~together, "these rows stand in the wrong order: each position fits another row's joint readings")):
        if mask.sum() >= 2:
            index = data.row[rows[mask]]
            out.append(Fault(name, index, f"A fault of the data: {words} ({data.where.listed(index)}).", p))
    return tuple(out)


def _partner(measured: Array, predicted: Array) -> Index:
    """(k,) for every outlying row, the other outlying row whose prediction is nearest to its measured position."""
    distance = np.linalg.norm(measured[:, None] - predicted[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    return np.asarray(distance.argmin(1), dtype=np.intp)


def _fits(measured: Array, predicted: Array, near: float) -> Mask:
    partner = _partner(measured, predicted)
    return np.asarray(np.linalg.norm(measured - predicted[partner], axis=1) < near)
