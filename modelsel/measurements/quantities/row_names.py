"""What a file calls its rows: the names of points, in a column of text that differs from row to row."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._typing import Index
from ..formats.table import Table
from .columns import find_blank_cells
from .contract_columns import JOINT_COLUMN, LABEL_COLUMNS
from .point_times import are_clock_times
from .row_labels import LETTER

# share of different names from which a column names the rows
MIN_DISTINCT = 0.9


def find_row_names(table: Table) -> NDArray[Any] | None:
    """Find the column (m,) that names the rows: of text with letters, the one with most different
    cells; None where there is none."""
    best = None
    most = MIN_DISTINCT * len(table)
    for name, cells in table.columns.items():
        is_contract = name in LABEL_COLUMNS or JOINT_COLUMN.fullmatch(name)
        if is_contract or not _holds_names(cells):
            continue
        different = {str(cell) for cell in cells}
        count = len(different)
        if count > most or best is None and count >= most:
            best = cells
            most = count
    return best


def list_row_names(table: Table, rows: Index) -> dict[int, Any] | NDArray[Any] | None:
    """List the names of a table's rows by their numbers `rows` (m,) in the file."""
    names = find_row_names(table)
    if names is None or np.array_equal(rows, np.arange(len(rows))):
        return names
    numbers = rows.tolist()
    labels = names.tolist()
    return dict(zip(numbers, labels, strict=True))


def _holds_names(cells: NDArray[Any]) -> bool:
    """Whether all cells are text with letters, and not all are times of the clock."""
    if cells.dtype.kind != "O" or not len(cells):
        return False
    first = str(cells[0])
    if LETTER.search(first) is None or find_blank_cells(cells).any():
        return False
    texts = [str(cell) for cell in cells]
    has_letters = all(map(LETTER.search, texts))
    return has_letters and not are_clock_times(texts)
