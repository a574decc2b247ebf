"""Rows of a file without a position: shots that were missed, left out where a study is begun."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .._typing import Mask
from .columns import convert_to_numbers
from .table import Table
from .table_layout import is_blank_row

# what stands in place of a number that was not measured, as people and spreadsheets write it
NOT_MEASURED = frozenset[str]().union(
    (
        "-",
        "\u2013",
        "\u2014",
        "--",
        "---",
        "/",
        "n/a",
        "na",
        "nan",
        "n. a.",
        "n.a.",
        "none",
        "null",
    ),
    ("fehlt", "missing", "lost", "#nv", "#n/a", "#na"),
)
# rows whose remarks are said
MAX_REMARKS = 3


def leave_out_missed(table: Table, coordinates: Sequence[str]) -> tuple[Table, tuple[str, ...]]:
    """Leave out the rows in which all of the named coordinates are empty, or say that they were
    not measured ("-", "n/a"), but for a table without any; returns the table, and what is said of it."""
    is_missed = np.ones(len(table), bool)
    for name in coordinates:
        is_missed &= _find_empty(table, name)
    if not coordinates or not is_missed.any() or is_missed.all():
        return table, ()
    rows = np.flatnonzero(is_missed)
    said = f"Left out, because there is no position: {table.where.listed(rows)}"
    remarks = [remark for row in rows[:MAX_REMARKS] if (remark := _find_remark(table, int(row)))]
    if remarks:
        said += f" ({'; '.join(dict.fromkeys(remarks))})"
    return _keep(table, ~is_missed), (f"{said}.",)


def _find_empty(table: Table, name: str) -> Mask:
    """Find the rows (m,) in which nothing was measured by a column."""
    cells = table.columns[name]
    if cells.dtype.kind == "f":
        return np.isnan(cells)
    return np.array([is_not_measured(cell) for cell in cells.tolist()], dtype=bool)


def is_not_measured(cell: Any) -> bool:
    """Whether a cell is empty, or says that nothing was measured: "-", "n/a", "fehlt", "#NV"."""
    return is_blank_row([cell]) or str(cell).strip().lower() in NOT_MEASURED


def _find_remark(table: Table, row: int) -> str:
    """Find the longest text in a row."""
    cells = [column[row] for column in table.columns.values() if column.dtype.kind == "O"]
    texts = np.array([cell for cell in cells if isinstance(cell, str)], dtype=object)
    texts = np.array([text for text in texts if not is_not_measured(text)], dtype=object)
    words = texts[np.isnan(convert_to_numbers(texts))] if len(texts) else texts
    return max((word.strip() for word in words), key=len, default="")


def _keep(table: Table, kept: Mask) -> Table:
    """Keep some rows, each with its own line."""
    at = np.array([table.where.number(int(row)) for row in np.flatnonzero(kept)], dtype=np.intp)
    columns = {name: cells[kept] for name, cells in table.columns.items()}
    return replace(table, columns=columns, where=replace(table.where, at=at))
