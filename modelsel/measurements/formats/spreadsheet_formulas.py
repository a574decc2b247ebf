"""Cells of an Excel file that have no value to read: formulas that no program has computed yet, as
openpyxl writes them, and errors such as #REF!. The library that reads spreadsheets shows both as
empty."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree as ET
from zipfile import BadZipFile, ZipFile

FORMULA_SUFFIXES = (".xlsx", ".xlsm")
WORKBOOK = "xl/workbook.xml"
RELATIONS = "xl/_rels/workbook.xml.rels"
IDENTITY = "{http://schemas.openxmlformats.org/officeDocument/2006/relationships}id"
# what a sheet has where a cell holds a formula, or an error
SIGNS = (b"<f", b't="e"')
CELL = re.compile(r"([A-Z]+)(\d+)")
# of a formula that is written at another cell
SHARED_FORMULA = "…"
FORMULA_REMEDY = "Formulas without their values are not numbers: open the file in Excel or LibreOffice, and save it."


def is_formula(cell: object) -> bool:
    """Whether a cell shows a formula, not its value."""
    text = str(cell)
    return text.startswith("=")


def find_valueless_cells(path: Path, sheet: str) -> dict[tuple[int, int], str]:
    """Find the cells of a sheet without a value: (row, column), both from 0 -> its formula or
    error; none where the file is of another kind or damaged."""
    if path.suffix.lower() not in FORMULA_SUFFIXES:
        return {}
    try:
        with ZipFile(path) as book:
            part = _find_part(book, sheet)
            content = book.read(part)
        if not any(sign in content for sign in SIGNS):
            return {}
        return _list_valueless(ET.fromstring(content))
    except (BadZipFile, KeyError, ET.ParseError, OSError, RuntimeError):
        return {}


def _find_part(book: ZipFile, sheet: str) -> str:
    """Find the part of the file that holds a sheet. Raises KeyError where there is none."""
    workbook_text = book.read(WORKBOOK)
    workbook = ET.fromstring(workbook_text)
    relations_text = book.read(RELATIONS)
    relations = ET.fromstring(relations_text)
    targets = {}
    for relation in relations:
        name = relation.get("Id")
        targets[name] = relation.get("Target", "")
    for element in workbook.iterfind(".//{*}sheet"):
        if element.get("name") != sheet:
            continue
        target = targets[element.get(IDENTITY)]
        if target.startswith("/"):
            return target.removeprefix("/")
        return f"xl/{target}"
    raise KeyError(sheet)


def _list_valueless(sheet: ET.Element) -> dict[tuple[int, int], str]:
    cells = {}
    for cell in sheet.iterfind(".//{*}c"):
        name = cell.get("r", "")
        place = CELL.fullmatch(name)
        text = _show_valueless(cell)
        if place is None or text is None:
            continue
        row = int(place[2]) - 1
        column = _number_column(place[1])
        cells[row, column] = text
    return cells


def _show_valueless(cell: ET.Element) -> str | None:
    """Show the error or the formula of a cell without a value; None of any other cell, one whose
    formula gives an empty text too."""
    value = cell.findtext("{*}v")
    kind = cell.get("t")
    if kind == "e":
        return value
    formula = cell.findtext("{*}f")
    if value or kind == "str" or formula is None:
        return None
    return f"={formula or SHARED_FORMULA}"


def _number_column(letters: str) -> int:
    """Number a column from 0: A is 0, AA is 26."""
    number = 0
    for letter in letters:
        number = 26 * number + ord(letter) - ord("A") + 1
    return number - 1
