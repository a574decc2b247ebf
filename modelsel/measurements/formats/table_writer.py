"""Write tables as the tables are written that they were made from: as text with its separator,
decimal mark and encoding, as a workbook, or as Parquet."""

from __future__ import annotations

import csv
import io
import math
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import escape, quoteattr

from ..._names import guard_cell
from .number_format import PLAIN
from .spreadsheet import SPREADSHEET_SUFFIXES
from .table import PARQUET_SUFFIXES, DataFile, Table
from .text_format import BLANKS
from .text_table import find_text_style

if TYPE_CHECKING:
    import pandas as pd

WORKBOOK_SUFFIX = ".xlsx"
DIGITS = "%.10g"
FALLBACK_ENCODING = "utf-8-sig"  # of a text that the encoding of the other file cannot hold
# when a file of a workbook was made, which is told in no cell: the earliest moment that zip knows
LONG_AGO = (1980, 1, 1, 0, 0, 0)
SPREADSHEET_ML = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
RELATIONSHIPS = "http://schemas.openxmlformats.org/package/2006/relationships"
OFFICE = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
CONTENT = "application/vnd.openxmlformats-officedocument.spreadsheetml"
DECLARATION = '<?xml version="1.0" encoding="UTF-8" standalone="yes"?>\n'


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
    """Return the number that a cell is, as a float; None for an empty one, others as they are."""
    if isinstance(cell, bool):
        return cell
    if isinstance(cell, (int, float)):
        return None if _is_missing(cell) else float(cell)
    text = str(cell or "").strip()
    if not text:
        return None
    return float(text) if PLAIN.fullmatch(text) else cell


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
    """Write a workbook of one sheet, in the least that Office Open XML asks for; text is in its
    cells, and none of it is a formula."""
    lines = [_write_sheet_row(number, row) for number, row in enumerate(rows, 1)]
    part = "worksheets/sheet1.xml"
    files = {
        "[Content_Types].xml": (
            '<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
            '<Default Extension="rels" '
            'ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
            f'<Override PartName="/xl/workbook.xml" ContentType="{CONTENT}.sheet.main+xml"/>'
            f'<Override PartName="/xl/{part}" ContentType="{CONTENT}.worksheet+xml"/></Types>'
        ),
        "_rels/.rels": _write_relation("officeDocument", "xl/workbook.xml"),
        "xl/workbook.xml": (
            f'<workbook xmlns="{SPREADSHEET_ML}" xmlns:r="{OFFICE}"><sheets>'
            f'<sheet name={quoteattr(sheet)} sheetId="1" r:id="rId1"/></sheets></workbook>'
        ),
        "xl/_rels/workbook.xml.rels": _write_relation("worksheet", part),
        f"xl/{part}": (
            f'<worksheet xmlns="{SPREADSHEET_ML}"><sheetData>{"".join(lines)}</sheetData></worksheet>'
        ),
    }
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as book:
        for name, text in files.items():
            entry = zipfile.ZipInfo(name, LONG_AGO)
            entry.compress_type = zipfile.ZIP_DEFLATED
            book.writestr(entry, DECLARATION + text)
    return out.getvalue()


def _write_relation(kind: str, target: str) -> str:
    return (
        f'<Relationships xmlns="{RELATIONSHIPS}">'
        f'<Relationship Id="rId1" Type="{OFFICE}/{kind}" Target="{target}"/></Relationships>'
    )


def _write_sheet_row(number: int, row: Sequence[Any]) -> str:
    cells = []
    for k, cell in enumerate(row):
        place = f"{_name_column(k)}{number}"
        value = _read_number(cell)
        if isinstance(value, float):
            cells.append(f'<c r="{place}"><v>{DIGITS % value}</v></c>')
        elif value is not None:
            text = escape("".join(filter(_is_xml, str(value))))
            cells.append(
                f'<c r="{place}" t="inlineStr"><is><t xml:space="preserve">{text}</t></is></c>'
            )
    return f'<row r="{number}">{"".join(cells)}</row>'


def _name_column(k: int) -> str:
    """Name a column of a sheet, counted from 0: A, B … Z, AA …"""
    name = ""
    k += 1
    while k:
        k, letter = divmod(k - 1, 26)
        name = chr(ord("A") + letter) + name
    return name


def _is_xml(letter: str) -> bool:
    """Whether a character may stand in XML."""
    return letter in "\t\n\r" or " " <= letter <= "\ud7ff" or "\ue000" <= letter != "\ufffe"
