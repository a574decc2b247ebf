"""Load tables from spreadsheets: .xlsx, .xlsm, .xlsb, .xls and .ods, by python-calamine.

One library without further dependencies reads all of them, also old .xls files, which openpyxl and
odfpy do not; it is imported when the first spreadsheet is read."""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..._foreign_files import describe_foreign
from ...exceptions import DataError, suggest
from .decimal_marks import choose_decimal_mark
from .number_format import (
    convert_number_text,
    describe_odd_numbers,
    find_mark_by_range,
    is_number,
    is_odd_number,
)
from .row_places import Where
from .spreadsheet_formulas import FORMULA_REMEDY, find_valueless_cells, is_formula
from .table_layout import find_layout, is_blank_row
from .text_table import MAX_LISTED, Grid, check_file, describe_lines, refuse_headerless

SPREADSHEET_SUFFIXES = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods")
# what a sheet must hold to be a table of measurements
MIN_ROWS = 2
MIN_NUMBERS = 3
# rows in which the header is looked for
HEADER_ROWS = 200


def load_spreadsheet(path: Path, sheet: str | None = None, decimal: str | None = None) -> Grid:
    """Load the table of a spreadsheet: of the named sheet, else of the only one that holds a table
    of numbers. Raises DataError."""
    sheets = read_sheets(path)
    name = _choose_sheet(path, sheets, sheet)
    rows = sheets[name]
    layout = find_layout(rows[:HEADER_ROWS])
    if layout is None:
        raise refuse_headerless(f'{path.name}, sheet "{name}"')
    body = list(enumerate(rows[layout.skipped :], layout.skipped + 1))
    kept = [(number, row) for number, row in body if not is_blank_row(row)]
    at = np.array([number for number, _ in kept], np.intp)
    where = Where(path.name, at=at, header=layout.header + 1, sheet=name)
    cells = [cell for _, row in kept for cell in row]
    said = [f'the sheet "{name}"']
    odd = [(number, cell) for number, row in kept for cell in row if is_odd_number(cell)]
    by_column = [[row[k] for _, row in kept] for k in range(len(layout.names))]
    mark = decimal or "."
    if odd and decimal is None:
        mark = find_mark_by_range(by_column) or choose_decimal_mark(path.name, cells)
    said += _describe_texts(odd, mark)
    if layout.header:
        said.append(f"the header on row {layout.header + 1}")
    if layout.units:
        said.append("a row of units below the header")
    last = int(at[-1]) if len(at) else 0
    blank = [number for number, row in body if is_blank_row(row) and number < last]
    said += describe_lines(blank, "empty", "empty", "row")
    columns = []
    for cells in by_column:
        column = [convert_number_text(cell, mark) for cell in cells] if odd else cells
        columns.append(np.array([*column, None], dtype=object)[:-1])
    return Grid(layout.names, columns, where, layout.units, said)


def _describe_texts(odd: Sequence[tuple[int, Any]], decimal: str) -> list[str]:
    """Say which numbers are kept as text, by their rows."""
    if not odd:
        return []
    rows = []
    for number, _ in odd:
        if number not in rows:
            rows.append(number)
    style = describe_odd_numbers([cell for _, cell in odd], decimal)
    shown = ", ".join(map(str, rows[:MAX_LISTED]))
    if len(rows) > MAX_LISTED:
        shown += " …"
    what = f"{len(odd)} numbers"
    if len(odd) == 1:
        what = "a number"
    place = "rows"
    if len(rows) == 1:
        place = "row"
    return [f"{what} kept as text with {style} ({place} {shown})"]


def read_sheets(path: Path) -> dict[str, list[list[Any]]]:
    """Read all sheets, a list of cells per row from row 1 and column A on. Raises DataError."""
    from python_calamine import CalamineError, CalamineWorkbook

    check_file(path)
    foreign = describe_foreign(path)
    if foreign is not None:
        what, remedy = foreign
        raise DataError(what, file=path.name, remedy=remedy)
    try:
        with CalamineWorkbook.from_path(path) as book:
            read = {
                name: book.get_sheet_by_name(name).to_python(skip_empty_area=False)
                for name in book.sheet_names
            }
    except (CalamineError, OSError, ValueError) as error:
        raise DataError(
            f"the spreadsheet cannot be read: {str(error).strip()}.",
            file=path.name,
            remedy="Open it and save it anew, without a password, or as CSV in UTF-8.",
        ) from None
    sheets = {}
    for name, rows in read.items():
        cells = [[_read_cell(cell) for cell in row] for row in rows]
        sheets[name] = _fill_valueless(path, name, cells)
    return sheets


def _fill_valueless(path: Path, sheet: str, rows: list[list[Any]]) -> list[list[Any]]:
    """Write the formulas and errors that have no value in the cells that show nothing."""
    has_blank = any("" in row for row in rows)
    if not has_blank:
        return rows
    texts = find_valueless_cells(path, sheet)
    for number, row in enumerate(rows):
        for k, cell in enumerate(row):
            if cell == "":
                row[k] = texts.get((number, k), "")
    return rows


def _read_cell(cell: Any) -> Any:
    """Return a cell as text or a number: whole ones without a decimal point, as names have them."""
    if isinstance(cell, float) and cell.is_integer():
        return int(cell)
    if isinstance(cell, (dt.datetime, dt.date, dt.time)):
        return cell.isoformat()
    if isinstance(cell, dt.timedelta):
        return cell.total_seconds()
    return cell


def _choose_sheet(path: Path, sheets: dict[str, list[list[Any]]], wanted: str | None) -> str:
    if wanted is not None:
        if wanted not in sheets:
            raise DataError(
                f'there is no sheet "{wanted}". {suggest(wanted, sheets)}', file=path.name
            )
        return wanted
    tables = _list_tables(sheets)
    if len(tables) > 1:
        listed = ", ".join(f'"{name}"' for name in tables)
        raise DataError(
            f"{len(tables)} sheets hold a table of numbers: {listed}.",
            file=path.name,
            remedy=f'Say which in the study file: [measurements] sheet = "{tables[0]}" '
            "(on the command line: --sheet).",
        )
    if not tables:
        cells = (cell for rows in sheets.values() for row in rows for cell in row)
        remedy = "A header row and a row per measured point are expected."
        if any(map(is_formula, cells)):
            remedy = f"{remedy} {FORMULA_REMEDY}"
        raise DataError("no sheet holds a table of numbers.", file=path.name, remedy=remedy)
    return tables[0]


def _list_tables(sheets: dict[str, list[list[Any]]]) -> list[str]:
    return [name for name, rows in sheets.items() if _is_table(rows)]


def _is_table(rows: Sequence[Sequence[Any]]) -> bool:
    measured = [row for row in rows if sum(map(is_number, row)) >= MIN_NUMBERS]
    return len(measured) >= MIN_ROWS
