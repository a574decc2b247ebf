"""Empty cells of two files that are joined: a row without a name or a time has no partner, and a point
without a position is a shot that was missed."""

from __future__ import annotations

import numpy as np

from ..._typing import Index, Mask
from ..formats.column_names import MEASURED, parse_column_name
from ..formats.table import Table
from ..quantities.columns import find_blank_cells, read_numbers
from ..quantities.missed_rows import AXES, take_rows
from ..quantities.point_times import TIME_WORDS, Times, find_times

# share of the cells, at most, that are empty in a column that joins two files
MAX_BLANK_SHARE = 0.1


def check_coordinates(points: Table) -> None:
    """Check that the points' coordinates are numbers, where any of a row is given. Raises DataError with
    the line of the file."""
    names = []
    for name in points.columns:
        parsed = parse_column_name(name)
        other_words = parsed.words - MEASURED
        if parsed.quantity in AXES and not other_words:
            names.append(name)
    if not names:
        return
    is_blank = [find_blank_cells(points.columns[name]) for name in names]
    is_missed = np.all(is_blank, axis=0)
    measured = _take(points, ~is_missed)
    for name in names:
        read_numbers(measured, name)


def find_filled_times(table: Table) -> tuple[Times | None, Index]:
    """Find a table's times, and the rows that have one: all, or, where a few cells of a column of times
    are empty, the others. None, and all rows, where there is no such column."""
    every = np.arange(len(table))
    times = find_times(table)
    if times is not None:
        return times, every
    for name, cells in table.columns.items():
        is_blank = find_blank_cells(cells)
        is_time = parse_column_name(name).words & TIME_WORDS
        if is_time and 0 < is_blank.mean() <= MAX_BLANK_SHARE:
            is_filled = ~is_blank
            filled = _take(table, is_filled)
            times = find_times(filled)
            if times is not None:
                return times, np.flatnonzero(is_filled)
    return None, every


def _take(table: Table, rows: Mask) -> Table:
    places = np.flatnonzero(rows)
    return take_rows(table, places)
