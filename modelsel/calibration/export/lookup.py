"""Lookup tables: the part of a correction that hangs on at most two values of the state, on a grid
to interpolate in."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._typing import Array
from ...fitting.problem import Problem
from ...measurements.campaign.state_names import StateKind, state_kind
from ...robot.rigid import AXES
from ..constant_part import Part

if TYPE_CHECKING:
    from ..calibration import Calibration

MAX_INTERPOLATION_MM = 5e-4  # a grid is halved until what lies between its points is this near
MAX_POINTS = (8193, 129)  # points along each value, for tables of one and of two
GRID_FORMAT = ".10g"  # of a point in the file


@dataclass(frozen=True, eq=False)
class Table:
    """Correction of one axis of a frame, mm or rad, over a grid of `names`, of two points or more
    each; values has an axis a name. A name whose range has no width is left out."""

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
    """Build a table for every axis and set of at most two names; return the parts that hang on
    more.

    Each covers what was seen of a name, held-out rows with it, and what the configurations `at` make
    of it: torques grow beyond what was seen where joints combine anew."""
    ranges = {}
    for name, (low, high) in (dict(c.ranges) | dict(c.held_out_ranges)).items():
        value = at.value(name)
        least = float(value.min())
        largest = float(value.max())
        ranges[name] = (min(low, least), max(high, largest))
    own: dict[tuple[int, str, tuple[str, ...]], list[tuple[Part, int]]] = {}
    over = []
    for part in varying:
        screws = part.term.screws
        sets = [screw.cause.names() for screw in screws]
        too_many = any(len(names) > 2 for names in sets)
        unseen = any(not names <= c.ranges.keys() for names in sets)
        if too_many or unseen:
            over.append(part)
            continue
        for k, screw in enumerate(screws):
            along = tuple(sorted(sets[k]))
            place = (screw.frame, screw.axis, along)
            parts = own.setdefault(place, [])
            parts.append((part, k))
    distances = np.linalg.norm(c.tools, axis=1)
    lever = c.robot.reach + float(distances.max())
    tables = []
    for (frame, axis, along), parts in own.items():
        radius = lever if axis[0] == "r" else 1.0
        fine = MAX_INTERPOLATION_MM / radius
        table = _refine_grid(ranges, frame, axis, along, parts, fine)
        tables.append(table)
    return tables, over


def build_constant_tables(entries: Array) -> list[Table]:
    """Build a table of no name for every constant correction that is not zero; entries (n+1, 6) mm
    and rad."""
    tables = []
    frames, axes = np.nonzero(entries)
    places = zip(frames.tolist(), axes.tolist(), strict=True)
    for frame, axis in places:
        table = Table(frame + 1, AXES[axis], (), (), entries[frame, axis])
        tables.append(table)
    return tables


def _refine_grid(
    ranges: Mapping[str, tuple[float, float]],
    frame: int,
    axis: str,
    names: tuple[str, ...],
    screws: list[tuple[Part, int]],
    fine: float,
) -> Table:
    def at(*grid: Array) -> Array:
        mesh = np.meshgrid(*grid, indexing="ij")
        shape = mesh[0].shape
        state = _State(dict(zip(names, mesh, strict=True)))
        correction: Any = 0
        for part, k in screws:
            screw = part.term.screws[k]
            cause = screw.cause.of(state)
            correction = correction + part.value * np.broadcast_to(cause, shape)
        return np.asarray(correction)

    most = MAX_POINTS[len(names) - 1]
    count = 17
    while True:
        grid = []
        for name in names:
            points = np.array([-1.0, 0.0, 1.0])
            if state_kind(name) is not StateKind.APPROACH:
                points = _space_points(*ranges[name], count)
            grid.append(points)
        values = at(*grid)
        middle = [(points[1:] + points[:-1]) / 2 if len(points) > 1 else points for points in grid]
        guess = values
        for k in range(len(names)):
            length = guess.shape[k]
            if length == 1:
                continue
            upper = np.take(guess, range(1, length), k)
            lower = np.take(guess, range(length - 1), k)
            guess = (upper + lower) / 2
        if count >= most:
            break
        error = np.abs(at(*middle) - guess)
        if error.max() < fine:
            break
        count = 2 * count - 1
    varied = [k for k, points in enumerate(grid) if len(points) > 1]
    kept_names = [names[k] for k in varied]
    kept_grid = [grid[k] for k in varied]
    kept_values = values.squeeze()
    return Table(frame, axis, tuple(kept_names), tuple(kept_grid), kept_values)


def _space_points(low: float, high: float, count: int) -> Array:
    """Space points evenly, as the file has them: those that its digits make equal are one."""
    spaced = np.linspace(low, high, count)
    written = []
    for point in spaced.tolist():
        digits = format(point, GRID_FORMAT)
        written.append(float(digits))
    return np.unique(written)


def write_tables(made: Sequence[Table]) -> str:
    """Write tables as one CSV: table, frame, axis, name and value of at most two values of the
    state, correction (mm or rad)."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["table", "frame", "axis", "name1", "value1", "name2", "value2", "correction"])
    for k, table in enumerate(made, 1):
        points = zip(np.ndindex(table.values.shape), product(*table.grid), strict=True)
        for index, values in points:
            state = []
            for name, value in zip(table.names, values, strict=True):
                state += [name, format(value, GRID_FORMAT)]
            empty = [""] * (4 - len(state))
            correction = f"{table.values[index]:.8g}"
            row = [k, table.frame, table.axis, *state, *empty, correction]
            writer.writerow(row)
    return stream.getvalue()


def evaluate_tables(text: str, at: Problem) -> list[tuple[int, str, Array]]:
    """Evaluate every table of a file at the rows of a problem, by linear interpolation: frame,
    axis, correction (m,)."""
    own: dict[str, list[dict[str, str]]] = {}
    stream = io.StringIO(text)
    reader = csv.DictReader(stream)
    for row in reader:
        table = row["table"]
        rows = own.setdefault(table, [])
        rows.append(row)
    out = []
    for rows in own.values():
        first = rows[0]
        grid = []
        state = []
        for k in (1, 2):
            name = first[f"name{k}"]
            if not name:
                continue
            column = [float(row[f"value{k}"]) for row in rows]
            points = np.unique(column)
            grid.append(points)
            state.append(at.value(name))
        corrections = [float(row["correction"]) for row in rows]
        shape = [len(points) for points in grid]
        values = np.array(corrections).reshape(shape)
        constant = values.flat[0]
        found = np.full(len(at), constant)
        if grid:
            found = interpolate(grid, values, state)
        frame = int(first["frame"])
        axis = first["axis"]
        out.append((frame, axis, found))
    return out


def interpolate(grid: Sequence[Array], values: Array, where: Sequence[Array]) -> Array:
    """Interpolate linearly in one or two values; beyond the grid its edge holds."""
    lower = []
    share = []
    for points, x in zip(grid, where, strict=True):
        place = np.searchsorted(points, x, side="right") - 1
        k = np.clip(place, 0, len(points) - 2)
        width = points[k + 1] - points[k]
        part = (x - points[k]) / width
        lower.append(k)
        share.append(np.clip(part, 0, 1))
    out = np.zeros(len(where[0]))
    for corner in product((0, 1), repeat=len(grid)):
        weights = []
        places = []
        for up, s, k in zip(corner, share, lower, strict=True):
            weights.append(s if up else 1 - s)
            places.append(k + up)
        weight = np.prod(weights, axis=0)
        out += weight * values[tuple(places)]
    return out
