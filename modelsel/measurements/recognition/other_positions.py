"""Positions beside the measured one, by their values: of a second reflector, or as the controller
computes them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..._typing import Array, Index
from ..formats.column_names import AXES
from ..formats.table import Table
from ..quantities.columns import POSITION_UNITS, convert_to_numbers

# rows from which columns may be said to follow the position
MIN_ROWS = 8
# rows that are compared, spread over all
MAX_ROWS = 2000
# mean square left of columns that follow it, by a frame and a scale, to theirs about their mean
MAX_LEFT = 0.05
# second spread of a position to its first, at least: along a line, anything that grows follows it
MIN_SPREAD = 0.05


def find_other_positions(table: Table, names: Sequence[str]) -> list[str]:
    """Find three columns next to each other, among these, that are the measured position in another
    frame or unit, or one beside it on the flange. The table has the contract's names."""
    count = len(table)
    spread = np.linspace(0, count - 1, min(count, MAX_ROWS))
    rows = spread.astype(int)
    measured = _read_measured(table, rows)
    if measured is None:
        return []
    is_measured = np.isfinite(measured).all(1)
    measured = measured[is_measured]
    rows = rows[is_measured]
    columns: dict[str, Array] = {}
    for name in names:
        cells = table.columns[name][rows]
        values = convert_to_numbers(cells)
        is_number = np.isfinite(values)
        if is_number.all():
            columns[name] = values
    numeric = list(columns)
    found = list[str]()
    last = len(numeric) - len(AXES)
    for k in range(last + 1):
        three = numeric[k : k + 3]
        is_free = set(three).isdisjoint(found)
        position = np.stack([columns[name] for name in three], 1)
        if is_free and _follows(position, measured):
            found += three
    return found


def _read_measured(table: Table, rows: Index) -> Array | None:
    """Read the measured position (m, 3) of some rows, in whatever unit; None where a coordinate has
    no column."""
    columns = []
    for axis in AXES:
        wanted = [f"{axis}_{unit}" for unit in POSITION_UNITS]
        given = [name for name in wanted if name in table]
        if not given:
            return None
        cells = table.columns[given[0]][rows]
        values = convert_to_numbers(cells)
        columns.append(values)
    return np.stack(columns, 1)


def _follows(position: Array, measured: Array) -> bool:
    """Whether a position (m, 3) is the measured one, rotated, shifted and scaled, up to a small
    part (Umeyama 1991)."""
    if len(position) < MIN_ROWS:
        return False
    middle = measured.mean(0)
    a = measured - middle
    other_middle = position.mean(0)
    b = position - other_middle
    if not (_fills_a_plane(a) and _fills_a_plane(b)):
        return False
    u, sizes, v = np.linalg.svd(a.T @ b)
    rotation = u @ v
    handedness = np.linalg.det(rotation)
    sizes[-1] *= np.sign(handedness)
    explained = sizes.sum() ** 2
    explained /= np.square(a).sum()
    total = np.square(b).sum()
    left = total - explained
    return bool(left <= MAX_LEFT * total)


def _fills_a_plane(centred: Array) -> bool:
    """Whether points (m, 3) about their mean are not all the same, nor along a line."""
    sizes = np.linalg.svd(centred, compute_uv=False)
    first, second, _ = sizes
    least = MIN_SPREAD * first
    is_spread = first > 0
    return bool(is_spread and second >= least)
