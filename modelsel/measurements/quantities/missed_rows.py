"""Rows of a file without a position: shots that were missed. They are no measurements, but the arm
went there: the row after one was approached from its readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._typing import Array, Index, Mask
from ...notices import Note
from ...robot.coupling import Coupling, angles_of
from ..campaign.motion import Waypoints
from ..formats.number_format import is_number
from ..formats.table import Table
from ..formats.table_layout import is_blank_row
from .columns import POSITION_UNITS, READING_UNITS, UNITS, convert_to_numbers, find_blank_cells

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
# share of the rows, at most, whose equal coordinates are none
MAX_EQUAL_SHARE = 0.2
AXES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class Split:
    """A table without its missed rows: `kept`, the `rows` (m,) of the whole that it has, the
    `missed` ones as a table of their own (None where there are none), their `places` (k,)."""

    kept: Table
    rows: Index
    missed: Table | None
    places: Index


def split_missed(table: Table) -> Split:
    """Split a table of points into rows with a position and rows in which every coordinate is
    empty or says that it was not measured ("-", "n/a"); all rows are kept where none, or all, have one."""
    names = _find_coordinates(table)
    is_missed = np.zeros(len(table), bool)
    if names:
        is_missed = np.all([_find_empty(table.columns[name]) for name in names], axis=0)
    if "kind" in table or not is_missed.any() or is_missed.all():
        return split_nothing(table)
    rows, places = np.flatnonzero(~is_missed), np.flatnonzero(is_missed)
    return Split(take_rows(table, rows), rows, take_rows(table, places), places)


def split_nothing(table: Table) -> Split:
    """Return a table with all of its rows kept."""
    return Split(table, np.arange(len(table)), None, np.zeros(0, np.intp))


def _find_coordinates(table: Table) -> list[str]:
    """Find the columns of the position; none where a coordinate is missing."""
    found = []
    for axis in AXES:
        found += [name for unit in POSITION_UNITS if (name := f"{axis}_{unit}") in table][:1]
    return found if len(found) == len(AXES) else []


def take_rows(table: Table, rows: Index) -> Table:
    """Take some rows, each with its own line."""
    columns = {name: cells[rows] for name, cells in table.columns.items()}
    return replace(table, columns=columns, where=table.where.take(rows))


def read_waypoints(
    split: Split, prismatic: Sequence[bool], coupling: Coupling | None
) -> tuple[Waypoints | None, list[Note]]:
    """Read where the arm was in the missed rows, and say that they are left out; rows whose readings
    or order are missing too say nothing of the motion. Without a group a row is of that of the next
    measured row, without a configuration one of its own."""
    table = split.missed
    said = _note_equal_coordinates(split.kept)
    if table is None:
        return None, said
    q, is_known = _read_readings(table, prismatic)
    order = convert_to_numbers(table.columns["order"]) if "order" in table else None
    if order is not None:
        is_known &= np.isfinite(order)
    places = split.places[is_known]
    waypoints = Waypoints(
        angles_of(coupling, q[is_known]),
        places,
        _read_labels(split, "group", is_known, np.searchsorted(split.rows, places)),
        _read_labels(split, "configuration", is_known, None),
        None if order is None else order[is_known],
    )
    missed = _describe_missed(split, table, is_known)
    return waypoints, [missed, *said]


def _note_equal_coordinates(table: Table) -> list[Note]:
    """Note the few rows with one number for x, y and z, as 0 or -999 of a missed shot."""
    names = _find_coordinates(table)
    count = len(table)
    if not names or not count:
        return []
    x, y, z = (convert_to_numbers(table.columns[name]) for name in names)
    is_equal = x == y
    is_equal &= y == z
    rows = np.flatnonzero(is_equal)
    if not 0 < len(rows) <= MAX_EQUAL_SHARE * count:
        return []
    different = np.unique(x[rows])
    shown = different[:MAX_REMARKS]
    values = ", ".join(f"{value:g}" for value in shown)
    have = "has" if len(rows) == 1 else "have"
    listed = table.where.listed(rows)
    sentence = (
        f"{listed.capitalize()} {have} one number for x, y and z ({values}): no "
        "position, if a program writes it for a missed shot. Leave these cells empty, or remove the row."
    )
    note = Note("coordinates-equal", sentence)
    return [note]


def _read_labels(
    split: Split, name: str, rows: Mask, following: Index | None
) -> list[object] | None:
    """Read labels of some missed rows; for an empty one that of the measured row `following` it, or
    one that no row has. None where there is no such column."""
    if split.missed is None or name not in split.missed:
        return None
    cells = split.missed.columns[name][rows]
    labels: list[object] = ["" if cell is None else str(cell).strip() for cell in cells.tolist()]
    measured = split.kept.columns[name]
    for k in np.flatnonzero(find_blank_cells(cells)).tolist():
        labels[k] = (name, k)
        if following is not None:
            labels[k] = str(measured[min(int(following[k]), len(measured) - 1)]).strip()
    return labels


def _read_readings(table: Table, prismatic: Sequence[bool]) -> tuple[Array, Mask]:
    """Read joint readings (k, n), rad or mm, and mask (k,) the rows that have all of them."""
    columns = []
    for j, slides in enumerate(prismatic, 1):
        for unit in READING_UNITS[slides]:
            if f"q{j}_{unit}" in table:
                columns.append(convert_to_numbers(table.columns[f"q{j}_{unit}"]) * UNITS[unit])
                break
        else:
            columns.append(np.full(len(table), np.nan))
    q = np.stack(columns, 1)
    return q, np.asarray(np.isfinite(q).all(1))


def _describe_missed(split: Split, table: Table, is_known: Mask) -> Note:
    rows = np.arange(len(table))
    said = f"Left out, because there is no position: {table.where.listed(rows)}"
    names = [name for name, cells in split.kept.columns.items() if _holds_remarks(cells)]
    remarks = [_find_remark(table, names, row) for row in range(min(len(rows), MAX_REMARKS))]
    if any(remarks):
        said += f" ({'; '.join(filter(None, dict.fromkeys(remarks)))})"
    count = int(is_known.sum())
    whose, which = ("its", "a place") if len(rows) == 1 else ("their", "places")
    if count == len(rows):
        said += f"; {whose} joint readings count as {which} that the arm went to, from which the next row was approached"
    elif count:
        said += f"; the readings of {table.where.listed(rows[is_known])} count as places that the arm went to"
    return Note("missed-rows", f"{said}.")


def _holds_remarks(cells: NDArray[Any]) -> bool:
    """Whether a column is empty in most rows that were measured, as remarks are."""
    is_blank = find_blank_cells(cells)
    share = is_blank.mean()
    return bool(share > 0.5)


def _find_empty(cells: NDArray[Any]) -> Mask:
    """Find the rows (m,) in which nothing was measured by a column."""
    if cells.dtype.kind == "f":
        is_nan = np.isnan(cells)
        return np.asarray(is_nan)
    found = []
    for cell in cells.tolist():
        is_empty = is_not_measured(cell)
        found.append(is_empty)
    return np.array(found, dtype=bool)


def is_not_measured(cell: Any) -> bool:
    """Whether a cell is empty, or says that nothing was measured: "-", "n/a", "fehlt", "#NV"."""
    text = str(cell)
    word = text.strip().lower()
    if is_blank_row([cell]):
        return True
    return word in NOT_MEASURED


def _find_remark(table: Table, names: Sequence[str], row: int) -> str:
    """Find the longest text in some columns of a row; empty where there is none."""
    remarks = list[str]()
    for name in names:
        cells = table.columns[name]
        cell = cells[row]
        if not isinstance(cell, str):
            continue
        if is_not_measured(cell) or is_number(cell):
            continue
        remark = cell.strip()
        remarks.append(remark)
    return max(remarks, key=len, default="")
