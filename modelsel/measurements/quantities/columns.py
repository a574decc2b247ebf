"""Columns of a table as numbers or labels: strict, and every refusal says place, column and remedy.
`rows` (m,), where it is given, says which rows have a number in the column; the others are to be
empty, and become nan."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._names import find_name_problem, quote_name, unguard_cell
from ..._typing import LARGEST, Array
from ...exceptions import one_line, suggest
from ..formats.spreadsheet_formulas import FORMULA_REMEDY, is_formula
from ..formats.table import Table
from .spoilt_numbers import advise_on_number

# mm or rad: the least standard uncertainty
MIN_UNCERTAINTY = 1e-9
# by which a quaternion's length may differ from one: digits cut off
MAX_LENGTH_ERROR = 0.1
# one of each unit in rad or mm
UNITS = {"rad": 1.0, "deg": np.pi / 180, "mm": 1.0, "m": 1e3, "in": 25.4, "inch": 25.4}
# units of the readings of joints that turn (False) and that slide (True)
READING_UNITS = {False: ("rad", "deg"), True: ("mm", "m")}
# units of positions
POSITION_UNITS = ("mm", "m", "in", "inch")
# columns of readings and positions, which stand for no other
QUANTITY_COLUMN = re.compile(rf"(?:q\d+|[xyz])_(?:{'|'.join(UNITS)})")
# characters of a cell that a message shows
MAX_SHOWN = 30
# rad: a reading beyond two turns is none in radians
MAX_READING_RAD = 4 * np.pi
Mask = NDArray[np.bool_]


def find_blank_cells(column: NDArray[Any]) -> Mask:
    """Mask (m,) the cells that are empty."""
    kind = column.dtype.kind
    if kind in "iub":
        return np.zeros(len(column), bool)
    if kind == "f":
        is_nan = np.isnan(column)
        return np.asarray(is_nan)
    is_blank = [_is_blank(cell) for cell in column]
    return np.array(is_blank, dtype=bool)


def _is_blank(cell: Any) -> bool:
    if cell is None:
        return True
    if isinstance(cell, (float, np.floating)):
        return bool(np.isnan(cell))
    return not str(cell).strip()


def read_numbers(
    table: Table, name: str, low: float = -np.inf, high: float = np.inf, rows: Mask | None = None
) -> Array:
    """Read a column as finite floats between two bounds. Raises DataError for the first cell that
    is not one, with its line; with `rows`, for one that should be empty."""
    column = table.columns[name]
    bounds = (low, high)
    values = np.full(len(column), np.nan)
    if column.dtype.kind != "b":
        values = convert_to_numbers(column)
    is_finite = np.isfinite(values)
    with np.errstate(invalid="ignore"):
        is_above = values >= low
        is_below = values <= high
    is_wrong = ~(is_finite & is_above & is_below)
    if rows is not None:
        is_wrong &= rows
    wrong = np.flatnonzero(is_wrong)
    _refuse_wrong_cells(table, name, wrong, values, bounds)
    if rows is None:
        return values
    is_blank = find_blank_cells(column)
    is_stray = ~is_blank & ~rows
    filled = np.flatnonzero(is_stray)
    _refuse_filled_cells(table, name, filled)
    return np.where(rows, values, np.nan)


def _refuse_wrong_cells(
    table: Table, name: str, wrong: NDArray[np.intp], values: Array, bounds: tuple[float, float]
) -> None:
    if not len(wrong):
        return
    column = table.columns[name]
    row = int(wrong[0])
    first_wrong = column[wrong[:1]]
    is_empty = find_blank_cells(first_wrong)[0]
    cell = str(column[row])
    content = f'"{cell[:MAX_SHOWN]}"'
    if is_empty:
        content = "an empty cell"
    expected = "a finite number"
    remedy = advise_on_number(cell) or "Correct the cell or remove the row."
    low, high = bounds
    if np.isfinite(values[row]):
        expected += f" between {low:g} and {high:g}"
    if len(wrong) > 1:
        content += f" ({len(wrong)} such cells)"
    if is_formula(cell):
        remedy = FORMULA_REMEDY
    raise table.where.refuse(
        f"expected {expected}, found {content}.", row=row, column=name, remedy=remedy
    )


def _refuse_filled_cells(table: Table, name: str, filled: NDArray[np.intp]) -> None:
    if not len(filled):
        return
    row = int(filled[0])
    content = str(table.columns[name][row])[:MAX_SHOWN]
    raise table.where.refuse(
        f'found "{content}", but a row of this kind measures nothing there.',
        row=row,
        column=name,
        remedy="Leave the cell empty, or correct the row's kind.",
    )


def convert_to_numbers(column: NDArray[Any]) -> Array:
    """Convert a column to floats (m,); cells that are not numbers become NaN."""
    kind = column.dtype.kind
    if kind in "fiub":
        return np.asarray(column, float)
    numbers = [_convert_cell(cell) for cell in column]
    return np.array(numbers, float)


def _convert_cell(cell: Any) -> float:
    if isinstance(cell, (bool, np.bool_)):
        return float("nan")
    if isinstance(cell, str) and "_" in cell:
        return float("nan")  # Python would read 1_000 as a number; no measuring program writes that
    try:
        return float(cell)
    except (TypeError, ValueError, OverflowError):
        return float("nan")


def describe_cell(table: Table, name: str, row: int) -> str:
    """Say what a cell holds, and where it is: "n/a" in points.csv, line 3."""
    cells = table.columns[name]
    place = table.where.locate(row, name)
    alone = cells[[row]]
    is_blank = find_blank_cells(alone)
    if is_blank[0]:
        return f"an empty cell in {place}"
    cell = str(cells[row])
    printable = one_line(cell)
    shown = printable[:MAX_SHOWN]
    return f'"{shown}" in {place}'


def read_quantity(table: Table, stem: str, units: Sequence[str], rows: Mask | None = None) -> Array:
    """Read the column named by a stem and one of the units, such as x_mm, in mm or rad. Raises
    DataError for a missing column, for two, or for a name without a unit."""
    names = [f"{stem}_{unit}" for unit in units]
    present = [name for name in names if name in table]
    where = table.where
    if len(present) == 1:
        unit = units[names.index(present[0])]
        return read_numbers(table, present[0], -LARGEST, LARGEST, rows) * UNITS[unit]
    if present:
        raise where.refuse(f"{' and '.join(present)} are both there.", remedy="Keep one of them.")
    wanted = " or ".join(names)
    if stem in table:
        raise where.refuse(
            f'column "{stem}" has no unit in its name.',
            column=stem,
            remedy=f"Rename it to {wanted}, or map it {where.mapping(names[0], stem)}.",
        )
    free = [name for name in table.columns if QUANTITY_COLUMN.fullmatch(name) is None]
    raise where.refuse(
        f"column {wanted} is missing. {suggest(names[0], free)}".rstrip(),
        remedy=f"If it has another name, map it {where.mapping(names[0], 'NAME')}.",
    )


def read_coordinates(table: Table, required: bool = True) -> Array:
    """Read positions (m, 3) [mm]; NaN in rows where none are there and none are `required`. Raises
    DataError as `read_quantity`."""
    plain = set("xyz")
    names = plain | {f"{axis}_{unit}" for axis in plain for unit in POSITION_UNITS}
    if not required and names.isdisjoint(table.columns):
        return np.full((len(table), 3), np.nan)
    rows = None
    if not required:
        present = [table.columns[name] for name in sorted(names & set(table.columns))]
        rows = ~np.all([find_blank_cells(cells) for cells in present], axis=0)
    return np.stack([read_quantity(table, axis, POSITION_UNITS, rows) for axis in "xyz"], 1)


def find_position_unit(table: Table) -> str:
    """Find the unit in which positions were given: mm, m or in; mm where none are."""
    given = [unit for unit in POSITION_UNITS if f"x_{unit}" in table]
    return "in" if given == ["inch"] else (*given, "mm")[0]


def read_column_set(
    table: Table, names: Sequence[str], refuse: str = "", rows: Mask | None = None
) -> Array | None:
    """Read columns that come together or not at all, (m, len(names)). Raises DataError for rows
    that are "not positive" or "not unit" quaternions."""
    present = [name for name in names if name in table]
    if not present:
        return None
    if len(present) < len(names):
        missing = [name for name in names if name not in table]
        raise table.where.refuse(
            f"{', '.join(present)} without {', '.join(missing)}.",
            remedy=f"{' '.join(names)} come together.",
        )
    columns = [read_numbers(table, name, -LARGEST, LARGEST, rows) for name in names]
    values = np.stack(columns, 1)
    if refuse == "not positive":
        _refuse_small_uncertainties(table, names, values)
    if refuse == "not unit":
        _refuse_other_lengths(table, names, values)
    return values


def _refuse_small_uncertainties(table: Table, names: Sequence[str], values: Array) -> None:
    small = np.argwhere(values < MIN_UNCERTAINTY)
    if len(small):
        row, column = small[0]
        raise table.where.refuse(
            f"a standard uncertainty must be above zero, {MIN_UNCERTAINTY:g} at least.",
            row=int(row),
            column=names[column],
            remedy="Correct the cell, or leave the uncertainties out.",
        )


def _refuse_other_lengths(table: Table, names: Sequence[str], values: Array) -> None:
    is_zero = np.abs(values).max(1, initial=0.0) < MIN_UNCERTAINTY
    if is_zero.any():
        raise table.where.refuse(
            "a quaternion of length zero.",
            row=int(np.argmax(is_zero)),
            column=names[0],
            remedy="Correct the row or remove it.",
        )
    length = np.linalg.norm(values, axis=1)
    is_other = np.abs(length - 1) > MAX_LENGTH_ERROR
    if is_other.any():
        row = int(np.argmax(is_other))
        raise table.where.refuse(
            f"a quaternion of length {length[row]:.3g}, where 1 is expected.",
            row=row,
            column=names[0],
            remedy=f"Check whether {' '.join(names)} hold a quaternion, and divide it by its length.",
        )


def refuse_degrees(table: Table, joint: int, q: Array) -> None:
    """Refuse readings in rad that are beyond two turns. Raises DataError."""
    beyond = np.abs(q) > MAX_READING_RAD
    if beyond.any():
        row = int(np.argmax(beyond))
        raise table.where.refuse(
            f"{q[row]:g} rad is beyond two turns: it looks like degrees.",
            row=row,
            column=f"q{joint}_rad",
            remedy=f"If the readings are degrees, name the column q{joint}_deg.",
        )


def read_names(table: Table, name: str) -> list[str]:
    """Read a text column without surrounding blanks, as it was before it was guarded. Raises
    DataError for an empty cell, and for one that cannot be a name."""
    cells = ["" if cell is None else str(cell).strip() for cell in table.columns[name]]
    if "" in cells:
        raise table.where.refuse(
            "an empty cell.",
            row=cells.index(""),
            column=name,
            remedy=f"Give every row its {name}, or leave the column out.",
        )
    return check_names(table, name, cells)


def check_names(table: Table, column: str, cells: list[str]) -> list[str]:
    """Return the cells of a text column ("" for none) as names, each checked once. Raises DataError
    for one that cannot be a name."""
    known: dict[str, str] = {"": ""}
    for row, cell in enumerate(cells):
        if cell in known:
            continue
        problem = find_name_problem(cell)
        if problem is not None:
            raise table.where.refuse(
                f"{quote_name(cell)} is not a name: {problem}.", row=row, column=column
            )
        known[cell] = unguard_cell(cell) if table.where.is_text else cell
    return [known[cell] for cell in cells]
