"""Rows at the end of a table, or between the others, that sum these up: their mean, standard
deviation, least, most."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...exceptions import one_line
from .group_summaries import MAX_SUMMARY_ROWS, find_group_summaries
from .number_format import is_number
from .spreadsheet_formulas import is_formula
from .table_layout import is_blank_row
from .text_table import Grid

# what stands before such a row, without blanks and points
SUMMARY_WORDS = frozenset[str]().union(
    (
        "mean",
        "average",
        "avg",
        "mittelwert",
        "mittel",
        "mw",
        "moyenne",
        "media",
        "média",
        "promedio",
    ),
    ("std", "stddev", "stdev", "stdabw", "stabw", "standarddeviation", "standardabweichung", "sd"),
    ("sigma", "3sigma", "variance", "varianz", "écarttype", "ecarttype", "desvest", "rms"),
    ("min", "minimum", "max", "maximum", "range", "spannweite", "spanne", "median"),
    ("sum", "summe", "total", "somme", "suma", "count", "anzahl"),
)
NO_LETTER = re.compile(r"[\W_]+")


def drop_summary_rows(grid: Grid) -> Grid:
    """Leave out the rows that sum up the others, and say so."""
    found = find_group_summaries(grid.columns)
    if found:
        grid = _drop_rows(grid, found)
    labels = _find_summaries(grid.columns)
    if not labels:
        return grid
    count = len(grid.columns[0])
    first = count - len(labels)
    last = dict(enumerate(labels, first))
    return _drop_rows(grid, last)


def _drop_rows(grid: Grid, labels: Mapping[int, str]) -> Grid:
    """Leave out the rows with these labels, which sum up the others, or those above them."""
    count = len(grid.columns[0])
    every = np.arange(count)
    rows = np.array(list(labels), np.intp)
    listed = grid.where.spans(rows)
    is_last = rows[0] + len(rows) == count
    summed = "the others" if is_last else "the rows above them"
    is_one = len(rows) == 1
    verb = "sums" if is_one else "sum"
    left = "is" if is_one else "are"
    different = dict.fromkeys(labels.values())
    quoted = [f'"{one_line(label)}"' for label in different]
    shown = ", ".join(quoted[:MAX_SUMMARY_ROWS])
    more = ""
    if len(quoted) > MAX_SUMMARY_ROWS:
        more = " …"
    sentence = f"{listed} {verb} up {summed} and {left} left out ({shown}{more})"
    said = [*grid.said, sentence]
    kept = np.setdiff1d(every, rows)
    columns = [cells[kept] for cells in grid.columns]
    where = grid.where.take(kept)
    return replace(grid, columns=columns, where=where, said=said)


def _find_summaries(columns: Sequence[NDArray[Any]]) -> list[str]:
    """Find the words before the rows at the end that sum up the others, from the first such row on.

    None where a word stands in a row above as well: there it is somebody's, or a point's, name."""
    count = len(columns[0]) if columns else 0
    labels = list[str]()
    at = 0
    for row in range(count - 1, -1, -1):
        cells = [column[row] for column in columns]
        filled = [k for k, cell in enumerate(cells) if not is_blank_row([cell])]
        if not filled:
            break
        place, *others = filled
        label = str(cells[place])
        # formulas of a workbook that was never calculated have no values
        has_numbers = any(is_number(cells[k]) or is_formula(cells[k]) for k in others)
        if not has_numbers or _shorten(label) not in SUMMARY_WORDS:
            break
        if len(labels) == MAX_SUMMARY_ROWS:
            return []
        at = place
        labels.insert(0, label.strip())
    words = {_shorten(label) for label in labels}
    first = count - len(labels)
    if not labels or not first or len(words) < len(labels):
        return []
    cells_above = columns[at][:first]
    above = map(_shorten, cells_above.tolist())
    return [] if any(word in words for word in above) else labels


def _shorten(cell: Any) -> str:
    """Write a label without blanks, points and capitals."""
    text = str(cell)
    return NO_LETTER.sub("", text).casefold()
