"""Columns of a table as numbers or labels: strict, and every refusal says place, column and remedy.
`rows` (m,), where it is given, says which rows have a number in the column; the others are to be
empty, and become nan."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._names import find_name_problem, quote_name, unguard_cell
from .._typing import LARGEST, Array
from ..exceptions import suggest
from .table import Table

DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+")
MIN_UNCERTAINTY = 1e-9  # mm or rad: the least standard uncertainty
UNITS = {"rad": 1.0, "deg": np.pi / 180, "mm": 1.0, "m": 1e3}
READING_UNITS = {False: ("rad", "deg"), True: ("mm", "m")}  # of joints that turn, and that slide
Mask = NDArray[np.bool_]


def find_blank_cells(column: NDArray[Any]) -> Mask:
    """(m,) cells that are empty."""
    if column.dtype.kind in "iub":
        return np.zeros(len(column), bool)
    if column.dtype.kind == "f":
        return np.asarray(np.isnan(column))
    return np.array(
        [
            cell is None
            or not str(cell).strip()
            or isinstance(cell, (float, np.floating))
            and bool(np.isnan(cell))
            for cell in column
        ],
        dtype=bool,
    )


def read_numbers(
    table: Table, name: str, low: float = -np.inf, high: float = np.inf, rows: Mask | None = None
) -> Array:
    """A column as finite floats between two bounds; refuses the first cell that is not one, with
    its line."""
    column, everywhere = table.columns[name], np.ones(len(table), bool) if rows is None else rows
    out = convert_to_numbers(column) if column.dtype.kind != "b" else np.full(len(column), np.nan)
    with np.errstate(invalid="ignore"):
        bad = np.flatnonzero(~(np.isfinite(out) & (out >= low) & (out <= high)) & everywhere)
    if len(bad):
        cell = column[bad[0]]
        shown = "an empty cell" if find_blank_cells(column[bad[:1]])[0] else f'"{str(cell)[:30]}"'
        more = f" ({len(bad)} such cells)" if len(bad) > 1 else ""
        bounds = f" between {low:g} and {high:g}" if np.isfinite(out[bad[0]]) else ""
        comma = (
            " Numbers need a decimal point, not a comma."
            if DECIMAL_COMMA.fullmatch(str(cell).strip())
            else ""
        )
        raise table.where.refuse(
            f"expected a finite number{bounds}, found {shown}{more}.",
            row=int(bad[0]),
            column=name,
            remedy=f"Correct the cell or remove the row.{comma}",
        )
    if rows is None:
        return out
    filled = np.flatnonzero(~find_blank_cells(column) & ~rows)
    if len(filled):
        raise table.where.refuse(
            f'found "{str(column[filled[0]])[:30]}", but a row of this kind measures nothing there.',
            row=int(filled[0]),
            column=name,
            remedy="Leave the cell empty, or correct the row's kind.",
        )
    return np.where(rows, out, np.nan)


def convert_to_numbers(column: NDArray[Any]) -> Array:
    """(m,) floats, nan where a cell is none."""
    return (
        np.asarray(column, float)
        if column.dtype.kind in "fiub"
        else np.array([_number(cell) for cell in column], float)
    )


def _number(cell: Any) -> float:
    if isinstance(cell, (bool, np.bool_)) or isinstance(cell, str) and "_" in cell:
        return float("nan")  # Python would read 1_000 as a number; no measuring program writes that
    try:
        return float(cell)
    except (TypeError, ValueError, OverflowError):
        return float("nan")


def read_quantity(table: Table, stem: str, units: Sequence[str], rows: Mask | None = None) -> Array:
    """The column `stem_unit` in mm or rad; refuses a missing one, two units, or none in the
    name."""
    present = [unit for unit in units if f"{stem}_{unit}" in table]
    wanted, where = " or ".join(f"{stem}_{unit}" for unit in units), table.where
    if len(present) == 1:
        return (
            read_numbers(table, f"{stem}_{present[0]}", -LARGEST, LARGEST, rows) * UNITS[present[0]]
        )
    if present:
        raise where.refuse(
            f"{' and '.join(f'{stem}_{u}' for u in present)} are both there.",
            remedy="Keep one of them.",
        )
    if stem in table:
        raise where.refuse(
            f'column "{stem}" has no unit in its name.',
            column=stem,
            remedy=f"Rename it to {wanted}, or map it {where.mapping(f'{stem}_{units[0]}', stem)}.",
        )
    raise where.refuse(
        f"column {wanted} is missing. {suggest(f'{stem}_{units[0]}', list(table.columns))}",
        remedy=f"If it has another name, map it {where.mapping(f'{stem}_{units[0]}', 'NAME')}.",
    )


def read_column_set(
    table: Table, names: Sequence[str], refuse: str = "", rows: Mask | None = None
) -> Array | None:
    """Columns that come together or not at all, (m, len(names)); refuses rows that are "not
    positive" or "zero"."""
    there, where = [name for name in names if name in table], table.where
    if not there:
        return None
    if len(there) < len(names):
        raise where.refuse(
            f"{', '.join(there)} without {', '.join(n for n in names if n not in there)}.",
            remedy=f"{' '.join(names)} come together.",
        )
    out = np.stack([read_numbers(table, name, -LARGEST, LARGEST, rows) for name in names], 1)
    if refuse == "not positive" and (out < MIN_UNCERTAINTY).any():
        row, column = np.argwhere(out < MIN_UNCERTAINTY)[0]
        raise where.refuse(
            f"a standard uncertainty must be above zero, {MIN_UNCERTAINTY:g} at least.",
            row=int(row),
            column=names[column],
            remedy="Correct the cell, or leave the uncertainties out.",
        )
    if refuse == "zero" and (short := np.abs(out).max(1, initial=0.0) < MIN_UNCERTAINTY).any():
        raise where.refuse(
            "a quaternion of length zero.",
            row=int(np.argmax(short)),
            column=names[0],
            remedy="Correct the row or remove it.",
        )
    return out


def read_names(table: Table, name: str) -> list[str]:
    """A text column without blanks about it, as it was before it was `guarded`; refuses an empty
    cell, and what is no name."""
    out = ["" if cell is None else str(cell).strip() for cell in table.columns[name]]
    if "" in out:
        raise table.where.refuse(
            "an empty cell.",
            row=out.index(""),
            column=name,
            remedy=f"Give every row its {name}, or leave the column out.",
        )
    return check_names(table, name, out)


def check_names(table: Table, column: str, cells: list[str]) -> list[str]:
    """Cells of a text column ("" for none) as names, each looked at once. Raises DataError for one
    that cannot be a name."""
    known: dict[str, str] = {"": ""}
    for row, cell in enumerate(cells):
        if cell not in known:
            if (why := find_name_problem(cell)) is not None:
                raise table.where.refuse(
                    f"{quote_name(cell)} is not a name: {why}.", row=row, column=column
                )
            known[cell] = unguard_cell(cell) if table.where.is_text else cell
    return [known[cell] for cell in cells]
