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
GROUP_MARKS = re.compile(r"[ '’\u00a0\u202f]")
MINUS = "\u2212"


def is_number(cell: Any) -> bool:
    """Whether a cell is a number in any of these forms."""
    if isinstance(cell, (bool, type(None))):
        return False
    if isinstance(cell, (int, float)):
        return True
    text = str(cell).strip().replace(MINUS, "-")
    forms = (PLAIN, WITH_COMMA, POINT_GROUPS, COMMA_GROUPS, OTHER_GROUPS)
    return any(form.fullmatch(text) for form in forms)


def find_decimal_mark(cells: Iterable[Any]) -> str | None:
    """Find the decimal mark of cells: "." or ","; None where both fit, as of 1,234 alone.

    Cells that contradict each other have a point: the commas among them are refused later."""
    commas, points, doubtful = 0, 0, 0
    for cell in cells:
        text = str(cell).strip().replace(MINUS, "-") if isinstance(cell, str) else ""
        grouped = OTHER_GROUPS.fullmatch(text)
        text = GROUP_MARKS.sub("", text) if grouped else text
        has_comma, has_point = "," in text, "." in text
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
    text = cell.strip().replace(MINUS, "-")
    if OTHER_GROUPS.fullmatch(text):
        text = GROUP_MARKS.sub("", text)
    if decimal == "," and POINT_GROUPS.fullmatch(text):
        text = text.replace(".", "")
    if decimal == "," and WITH_COMMA.fullmatch(text):
        return text.replace(",", ".")
    if decimal == "." and COMMA_GROUPS.fullmatch(text):
        return text.replace(",", "")
    return text if PLAIN.fullmatch(text) else cell


def needs_conversion(cells: Sequence[Any]) -> bool:
    """Whether any of the cells is text that is a number, but not in Python's form."""
    texts = [cell.strip() for cell in cells if isinstance(cell, str)]
    return any(is_number(text) and not PLAIN.fullmatch(text) for text in texts)
