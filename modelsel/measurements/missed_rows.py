"""Rows of a file without a position: shots that were missed, left out where a study is begun."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .._typing import Mask
from .number_format import is_number
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
    text = str(cell)
    word = text.strip().lower()
    if is_blank_row([cell]):
        return True
    return word in NOT_MEASURED


def _find_remark(table: Table, row: int) -> str:
    """Find the longest text in a row."""
    remarks = list[str]()
    for column in table.columns.values():
        cell = column[row]
        is_word = isinstance(cell, str) and not is_not_measured(cell)
        if is_word and not is_number(cell):
            remark = cell.strip()
            remarks.append(remark)
    return max(remarks, key=len, default="")


def _keep(table: Table, kept: Mask) -> Table:
    """Keep some rows, each with its own line."""
    place = table.where
    rows = np.flatnonzero(kept).tolist()
    lines = [place.number(row) for row in rows]
    at = np.array(lines, dtype=np.intp)
    columns = {}
    for name, cells in table.columns.items():
        columns[name] = cells[kept]
    where = replace(place, at=at)
    return replace(table, columns=columns, where=where)
