"""Rows at the end of a table that sum up the others: their mean, standard deviation, least, most."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..exceptions import one_line
from .number_format import is_number
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
# a longer block at the end is no summary
MAX_SUMMARY_ROWS = 12


def drop_summary_rows(grid: Grid) -> Grid:
    """Leave out the rows at the end that sum up the others, and say so."""
    labels = _find_summaries(grid.columns)
    if not labels:
        return grid
    every = np.arange(len(grid.columns[0]))
    first = len(every) - len(labels)
    where = grid.where
    listed = where.spans(every[first:])
    is_one = len(labels) == 1
    verb = "sums" if is_one else "sum"
    left = "is" if is_one else "are"
    quoted = ", ".join(f'"{one_line(label)}"' for label in labels)
    sentence = f"{listed} {verb} up the others and {left} left out ({quoted})"
    said = [*grid.said, sentence]
    columns = [cells[:first] for cells in grid.columns]
    kept = where.take(every[:first])
    return replace(grid, columns=columns, where=kept, said=said)


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
        has_numbers = any(is_number(cells[k]) for k in others)
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
