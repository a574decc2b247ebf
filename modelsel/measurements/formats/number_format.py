"""Numbers as people's programs write them: decimal commas, digits in groups of three."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any

PLAIN = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
WITH_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
POINT_GROUPS = re.compile(r"[+-]?[1-9]\d{0,2}(\.\d{3})+(,\d*)?")
COMMA_GROUPS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?")
# blanks and apostrophes between groups of three digits, as in Swiss and French files
OTHER_GROUPS = re.compile(r"[+-]?\d{1,3}(?:[ '’\u00a0\u202f]\d{3})+(?:[.,]\d*)?")
FORMS = (PLAIN, WITH_COMMA, POINT_GROUPS, COMMA_GROUPS, OTHER_GROUPS)
ANY_FORM = re.compile("|".join(f"(?:{form.pattern})" for form in FORMS))
GROUP_MARKS = re.compile(r"[ '’\u00a0\u202f]")
# share of a table's numbers that are written another way, from which that is its way
MIN_ODD_SHARE = 0.02
MINUS = "\u2212"


def is_number(cell: Any) -> bool:
    """Whether a cell is a number in any of these forms."""
    if isinstance(cell, (bool, type(None))):
        return False
    if isinstance(cell, (int, float)):
        return True
    text = clean_number(cell)
    return ANY_FORM.fullmatch(text) is not None


def clean_number(cell: Any) -> str:
    """Return a text cell without blanks around it, its minus a plain one; "" for any other cell."""
    if not isinstance(cell, str):
        return ""
    text = cell.strip()
    return text.replace(MINUS, "-")


def find_decimal_mark(cells: Iterable[Any]) -> str | None:
    """Find the decimal mark of cells: "." or ","; None where both fit, as of 1,234 alone.

    Cells that contradict each other have a point: the commas among them are refused later."""
    commas, points, doubtful = 0, 0, 0
    for cell in cells:
        text = clean_number(cell)
        grouped = OTHER_GROUPS.fullmatch(text)
        if grouped:
            text = GROUP_MARKS.sub("", text)
        has_comma = "," in text
        has_point = "." in text
        if has_comma and has_point:
            commas += POINT_GROUPS.fullmatch(text) is not None
            points += COMMA_GROUPS.fullmatch(text) is not None
        elif has_comma and COMMA_GROUPS.fullmatch(text) and not grouped:
            doubtful += 1
        elif has_comma:
            commas += WITH_COMMA.fullmatch(text) is not None
        elif has_point and not POINT_GROUPS.fullmatch(text):
            points += PLAIN.fullmatch(text) is not None
    if commas and not points:
        return ","
    if doubtful and not points:
        return None
    return "."


def convert_number_text(cell: Any, decimal: str) -> Any:
    """Write a cell that is a number with a decimal point and without groups; any other cell stays
    as it is."""
    if not isinstance(cell, str):
        return cell
    text = clean_number(cell)
    if OTHER_GROUPS.fullmatch(text):
        text = GROUP_MARKS.sub("", text)
    has_comma = decimal == ","
    if has_comma and POINT_GROUPS.fullmatch(text):
        text = text.replace(".", "")
    if has_comma and WITH_COMMA.fullmatch(text):
        return text.replace(",", ".")
    if decimal == "." and COMMA_GROUPS.fullmatch(text):
        return text.replace(",", "")
    if PLAIN.fullmatch(text):
        return text
    return cell


def needs_conversion(cells: Sequence[Any]) -> bool:
    """Whether cells are written another way than Python's as a rule: a single odd cell among many
    is a mistake, and stays one, but for 1,067.665, which can be one number only."""
    count = 0
    odd = 0
    for cell in cells:
        if _is_plain(cell):
            count += 1
        elif is_number(cell):
            count += 1
            odd += is_odd_number(cell)
            if _has_groups_and_point(cell):
                return True
    least = MIN_ODD_SHARE * count
    return odd >= max(1, least)


def _is_plain(cell: Any) -> bool:
    """Whether a cell is text that is a number in Python's form, as most are."""
    return isinstance(cell, str) and PLAIN.fullmatch(cell.strip()) is not None


def _has_groups_and_point(cell: Any) -> bool:
    """Whether a cell has commas between groups of three digits, and a decimal point after them."""
    text = clean_number(cell)
    has_point = "." in text
    has_commas = "," in text
    is_grouped = COMMA_GROUPS.fullmatch(text) is not None
    return is_grouped and has_commas and has_point


def describe_odd_numbers(cells: Sequence[Any], decimal: str) -> str:
    """Say how the numbers of cells with this decimal mark differ from Python's."""
    if decimal == "," and any("," in clean_number(cell) for cell in cells):
        return "decimal commas"
    if decimal == "," and any(map(_is_point_group, cells)):
        return "thousands in groups of digits"
    for cell in filter(is_odd_number, cells):
        text = clean_number(cell)
        if not PLAIN.fullmatch(text):
            return "thousands in groups of digits"
    return "long minus signs (U+2212)"


def _is_point_group(cell: Any) -> bool:
    """Whether a cell has points between groups of three digits, by a decimal comma."""
    text = clean_number(cell)
    return POINT_GROUPS.fullmatch(text) is not None


def is_odd_number(cell: Any) -> bool:
    """Whether a cell is text that is a number, but not in Python's form."""
    return isinstance(cell, str) and is_number(cell) and not PLAIN.fullmatch(cell.strip())


def find_mark_by_range(columns: Iterable[Sequence[Any]]) -> str | None:
    """Find the decimal mark of text among the numbers of columns (1,234 among numbers up to 90 has
    a decimal comma): the one by which every column stays near its own range; None where both, or
    neither, do."""
    fitting = [",", "."]
    for column in columns:
        for mark in tuple(fitting):
            if not _stays_near(column, mark):
                fitting.remove(mark)
    if len(fitting) != 1:
        return None
    return fitting[0]


def _stays_near(column: Sequence[Any], mark: str) -> bool:
    """Whether all text of a column is numbers near the others by some decimal mark."""
    numbers = list[float]()
    read = list[float]()
    for cell in column:
        if is_odd_number(cell):
            text = convert_number_text(cell, mark)
            if not PLAIN.fullmatch(text):
                return False
            read.append(float(text))
        elif isinstance(cell, (int, float)):
            numbers.append(float(cell))
    if not numbers or not read:
        return True
    low = min(numbers)
    high = max(numbers)
    room = max(high - low, abs(high) / 2, abs(low) / 2)
    least = low - room
    most = high + room
    smallest = min(read)
    largest = max(read)
    return least <= smallest and largest <= most
