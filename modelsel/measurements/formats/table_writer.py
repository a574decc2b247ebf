"""Write tables as the tables are written that they were made from: as text with its separator,
decimal mark and encoding, as a workbook, or as Parquet."""

from __future__ import annotations

import csv
import datetime as dt
import io
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..._files import PARQUET_SUFFIXES
from ..._names import guard_cell
from .number_format import PLAIN
from .spreadsheet import SPREADSHEET_SUFFIXES
from .table import DataFile, Table
from .text_format import BLANKS
from .text_table import find_text_style

if TYPE_CHECKING:
    import pandas as pd

WORKBOOK_SUFFIX = ".xlsx"
DIGITS = "%.10g"
FALLBACK_ENCODING = "utf-8-sig"  # of a text that the encoding of the other file cannot hold
# when a workbook was made, which is told in no cell: the same for all, the earliest moment that zip knows
LONG_AGO = dt.datetime(1980, 1, 1, tzinfo=dt.UTC)
LABEL_OF_DIGITS = re.compile("[-+]?0[0-9]")  # "007" is a name: no number is written so
AS_TEXT = {"strings_to_formulas": False, "strings_to_urls": False, "in_memory": True}


@dataclass(frozen=True)
class TableStyle:
    """How a table is written: the `separator` of its cells, its `decimal` mark and `encoding` where
    it is text, the name of its `sheet` where it is a workbook, and what a row of `units` below the
    header says of its columns; no such row where it is empty."""

    separator: str = ","
    decimal: str = "."
    encoding: str = "utf-8"
    sheet: str = "Sheet1"
    units: Mapping[str, str] | None = None


def find_table_style(file: DataFile, table: Table) -> TableStyle:
    """Find how the file of a table is written. Raises DataError."""
    units = None
    if table.length_unit is None:
        units = table.units or None
    suffix = file.path.suffix.lower()
    if suffix in SPREADSHEET_SUFFIXES:
        return TableStyle(sheet=table.where.sheet, units=units)
    if suffix in PARQUET_SUFFIXES:
        return TableStyle()
    form, decimal = find_text_style(file.path, file.decimal, file.headerless)
    return TableStyle(form.separator, decimal, form.encoding, units=units)


def encode_table(frame: pd.DataFrame, suffix: str, style: TableStyle) -> bytes:
    """Write a table as the ending of its file says: as a workbook, as Parquet, else as text."""
    if suffix.lower() in PARQUET_SUFFIXES:
        numbered = {name: _settle_cells(frame[name]) for name in frame.columns}
        content: bytes = frame.assign(**numbered).to_parquet(index=False)
        return content
    rows = [list(frame.columns)]
    if style.units is not None:
        rows.append([style.units.get(name, "") for name in frame.columns])
    columns = [frame.iloc[:, k].tolist() for k in range(frame.shape[1])]
    rows += map(list, zip(*columns, strict=True))
    if suffix.lower() == WORKBOOK_SUFFIX:
        return _write_workbook(rows, style.sheet)
    return _write_text(rows, style)


def _settle_cells(column: pd.Series[Any]) -> Any:
    """Return a column as numbers where all of its cells are, else as text."""
    if column.dtype.kind in "fiub":
        return column
    cells = [_read_number(cell) for cell in column]
    if all(isinstance(cell, (float, type(None))) for cell in cells):
        return [math.nan if cell is None else cell for cell in cells]
    return ["" if _is_missing(cell) else str(cell) for cell in column]


def _is_missing(cell: Any) -> bool:
    return cell is None or isinstance(cell, float) and math.isnan(cell)


def _read_number(cell: Any) -> Any:
    """Return the number that a cell is, as a float; None for an empty one, others as they are, such as
    a label of digits."""
    if isinstance(cell, bool):
        return cell
    if isinstance(cell, (int, float)):
        return None if _is_missing(cell) else float(cell)
    text = str(cell or "").strip()
    if not text:
        return None
    is_number = PLAIN.fullmatch(text) and not LABEL_OF_DIGITS.match(text)
    return float(text) if is_number else cell


# -- text
# --------------------------------------------------------------------------------------------


def _write_text(rows: Sequence[Sequence[Any]], style: TableStyle) -> bytes:
    cells = [[_write_cell(cell, style.decimal) for cell in row] for row in rows]
    separator = style.separator
    if separator == BLANKS and not all(len(cell.split()) == 1 for row in cells for cell in row):
        separator = "\t"  # a cell that is empty or has blanks
    out = io.StringIO()
    csv.writer(out, delimiter=separator, lineterminator="\n").writerows(cells)
    text = out.getvalue()
    try:
        return text.encode(style.encoding)
    except UnicodeEncodeError:
        return text.encode(FALLBACK_ENCODING)


def _write_cell(cell: Any, decimal: str) -> str:
    """Write a cell, a number with the decimal mark."""
    if _is_missing(cell):
        return ""
    if isinstance(cell, float):
        text = DIGITS % cell
    else:
        text = str(cell)
        if not PLAIN.fullmatch(text):
            return guard_cell(text)
    return text.replace(".", decimal)


# -- workbook
# --------------------------------------------------------------------------------------------


def _write_workbook(rows: Sequence[Sequence[Any]], sheet: str) -> bytes:
    """Write a workbook of one sheet, the same bytes whenever it is written; text stays text, and
    none of it is a formula or a link."""
    import xlsxwriter

    out = io.BytesIO()
    with xlsxwriter.Workbook(out, AS_TEXT) as book:
        book.set_properties({"created": LONG_AGO})
        page = book.add_worksheet(sheet)
        for number, row in enumerate(rows):
            for k, cell in enumerate(row):
                _write_sheet_cell(page, number, k, cell)
    return out.getvalue()


def _write_sheet_cell(page: Any, number: int, k: int, cell: Any) -> None:
    value = _read_number(cell)
    if isinstance(value, float):
        page.write_number(number, k, float(DIGITS % value))
    elif value is not None:
        page.write_string(number, k, str(value))
