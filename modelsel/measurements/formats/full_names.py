"""Full names of points, as measuring programs write them: "Job1::SMR1::p1"."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .table import Table

SEPARATOR = "::"
# what stands before the point's own name, from the left
PARTS = ("Collection", "Group")


def split_full_names(table: Table) -> Table:
    """Add a column for each part before the points' own names that differs between rows, where a
    column holds full names in every row and the table has no such column."""
    columns = dict(table.columns)
    for cells in table.columns.values():
        names = _split_cells(cells)
        if names is None:
            continue
        *before, _ = zip(*names, strict=True)
        count = len(before)
        called = PARTS[-count:]
        for name, parts in zip(called, before, strict=True):
            different = set(parts)
            is_new = name not in columns
            if is_new and len(different) > 1:
                new_cells = np.array(parts, dtype=object)
                columns[name] = new_cells
    return replace(table, columns=columns)


def _split_cells(cells: NDArray[Any]) -> list[list[str]] | None:
    """Split full names of two or three parts, as many in every row; None where they are none."""
    if cells.dtype.kind != "O" or not len(cells):
        return None
    texts = [str(cell).strip() for cell in cells]
    names = [text.split(SEPARATOR) for text in texts]
    counts = {len(parts) for parts in names}
    count = max(counts)
    is_full = 1 < count <= len(PARTS) + 1
    return names if is_full and len(counts) == 1 else None
