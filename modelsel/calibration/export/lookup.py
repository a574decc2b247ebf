"""Lookup tables: the part of a correction that hangs on at most two values of the state, on a grid
to interpolate in."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from ..._typing import Array
from ...fitting.problem import Problem
from ...robot.rigid import AXES
from ..constant_part import Part

if TYPE_CHECKING:
    from ..calibration import Calibration

MAX_INTERPOLATION_MM = 5e-4  # a grid is halved until what lies between its points is this near
MAX_POINTS = (8193, 129)  # points along each value, for tables of one and of two


@dataclass(frozen=True, eq=False)
class Table:
    """Correction of one axis of a frame, mm or rad, over a grid of `names`; values has an axis a
    name."""

    frame: int
    axis: str
    names: tuple[str, ...]
    grid: tuple[Array, ...] = field(repr=False)
    values: Array = field(repr=False)


class _State:
    """A state of plain values."""

    def __init__(self, values: Mapping[str, Array]):
        self.values = values

    def value(self, name: str) -> Array:
        return self.values[name]


def build_tables(
    c: Calibration, varying: Sequence[Part], at: Problem
) -> tuple[list[Table], list[Part]]:
    """(a table for every axis and set of at most two names, the parts that hang on more). Each
    covers what was seen of a name, and what the configurations `at` make of it: torques grow beyond
    what was seen where joints combine anew."""
    ranges = {
        name: (min(low, float(at.value(name).min())), max(high, float(at.value(name).max())))
        for name, (low, high) in c.ranges.items()
    }
    own: dict[tuple[int, str, tuple[str, ...]], list[tuple[Part, int]]] = {}
    over = []
    for p in varying:
        names = [tuple(sorted(s.cause.names())) for s in p.term.screws]
        if any(len(n) > 2 or not set(n) <= c.ranges.keys() for n in names):
            over.append(p)
            continue
        for k, (s, n) in enumerate(zip(p.term.screws, names, strict=True)):
            own.setdefault((s.frame, s.axis, n), []).append((p, k))
    lever = c.robot.reach + float(np.linalg.norm(c.tools, axis=1).max())
    return [
        _refine_grid(
            ranges, *place, some, MAX_INTERPOLATION_MM / (lever if place[1][0] == "r" else 1.0)
        )
        for place, some in own.items()
    ], over


def build_constant_tables(entries: Array) -> list[Table]:
    """A table of no value for every constant correction that is not nought; entries (n+1, 6) mm and
    rad."""
    return [
        Table(frame + 1, AXES[axis], (), (), entries[frame, axis])
        for frame, axis in zip(*np.nonzero(entries), strict=True)
    ]


def _refine_grid(
    ranges: Mapping[str, tuple[float, float]],
    frame: int,
    axis: str,
    names: tuple[str, ...],
    some: list[tuple[Part, int]],
    fine: float,
) -> Table:
    def at(*grid: Array) -> Array:
        mesh = np.meshgrid(*grid, indexing="ij")
        state = _State(dict(zip(names, mesh, strict=True)))
        return np.asarray(
            sum(
                p.value * np.broadcast_to(p.term.screws[k].cause.of(state), mesh[0].shape)
                for p, k in some
            )
        )

    most = MAX_POINTS[len(names) - 1]
    count = 17
    while True:
        grid = tuple(
            np.array([-1.0, 0.0, 1.0])
            if n.startswith("approach")
            else np.linspace(*ranges[n], count)
            for n in names
        )
        values = at(*grid)
        middle = tuple((g[1:] + g[:-1]) / 2 for g in grid)
        guess = values
        for k in range(len(names)):
            guess = (
                np.take(guess, range(1, guess.shape[k]), k)
                + np.take(guess, range(guess.shape[k] - 1), k)
            ) / 2
        if count >= most or np.abs(at(*middle) - guess).max() < fine:
            return Table(frame, axis, names, grid, values)
        count = 2 * count - 1


def write_tables(made: Sequence[Table]) -> str:
    """One CSV: table, frame, axis, name and value of at most two values of the state, correction
    (mm or rad)."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["table", "frame", "axis", "name1", "value1", "name2", "value2", "correction"])
    for k, t in enumerate(made, 1):
        for index, values in zip(np.ndindex(t.values.shape), product(*t.grid), strict=True):
            pairs = [x for n, v in zip(t.names, values, strict=True) for x in (n, f"{v:.10g}")]
            writer.writerow(
                [k, t.frame, t.axis, *pairs, *[""] * (4 - len(pairs)), f"{t.values[index]:.8g}"]
            )
    return stream.getvalue()


def evaluate_tables(text: str, at: Problem) -> list[tuple[int, str, Array]]:
    """(frame, axis, correction (m,)) of every table in a file at the rows of a problem, by linear
    interpolation."""
    own: dict[str, list[dict[str, str]]] = {}
    for row in csv.DictReader(io.StringIO(text)):
        own.setdefault(row["table"], []).append(row)
    out = []
    for rows in own.values():
        names = [n for n in (rows[0]["name1"], rows[0]["name2"]) if n]
        columns = [
            np.array([float(r[f"value{k}"]) for r in rows]) for k in range(1, len(names) + 1)
        ]
        grid = [np.unique(column) for column in columns]
        values = np.array([float(r["correction"]) for r in rows]).reshape([len(g) for g in grid])
        found = (
            interpolate(grid, values, [at.value(n) for n in names])
            if names
            else np.full(len(at), float(values))
        )
        out.append((int(rows[0]["frame"]), rows[0]["axis"], found))
    return out


def interpolate(grid: Sequence[Array], values: Array, where: Sequence[Array]) -> Array:
    """Linear interpolation in one or two values; beyond the grid its edge holds."""
    lower, share = [], []
    for g, x in zip(grid, where, strict=True):
        k = np.clip(np.searchsorted(g, x, side="right") - 1, 0, len(g) - 2)
        lower.append(k)
        share.append(np.clip((x - g[k]) / (g[k + 1] - g[k]), 0, 1))
    out = np.zeros(len(where[0]))
    for corner in product((0, 1), repeat=len(grid)):
        weight = np.prod([s if up else 1 - s for up, s in zip(corner, share, strict=True)], axis=0)
        out += weight * values[tuple(k + up for k, up in zip(lower, corner, strict=True))]
    return out
