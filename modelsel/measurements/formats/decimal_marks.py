"""Which decimal mark the numbers of a file have, and files that leave it open."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from ...exceptions import DataError
from .number_format import (
    COMMA_GROUPS,
    MIN_ODD_SHARE,
    POINT_GROUPS,
    clean_number,
    find_decimal_mark,
    is_number,
    is_odd_number,
)

WHOLE = re.compile(r"[+-]?[1-9]\d*")


def choose_decimal_mark(file: str, cells: Sequence[Any]) -> str:
    """Choose the decimal mark of the cells of a table. Raises DataError where both are possible."""
    decimal = find_decimal_mark(cells)
    if decimal is None:
        example = next(filter(is_odd_number, cells))
        raise refuse_doubtful_mark(file, example)
    return decimal


def refuse_doubtful_mark(file: str, example: Any) -> DataError:
    """Return the error of a file whose commas, or points, may be decimal marks or part groups of
    digits."""
    text = str(example).strip()
    mark = "comma" if "," in text else "point"
    plain = text.replace(",", ".")
    grouped = plain.replace(".", "")
    return DataError(
        f'"{text}" may be {plain} (a decimal {mark}) or {grouped} '
        f"(a {mark} between thousands), and all numbers of the file leave it open.",
        file=file,
        remedy='Say which in the study file: [measurements] decimal = "," or decimal = "." '
        "(on the command line: --decimal comma or --decimal point).",
    )


def find_doubtful_point(rows: Sequence[Sequence[Any]]) -> str | None:
    """Find a cell such as 1.019 that may be 1019: no number of the rows has another point or a
    comma, and its column has whole numbers too, which a program that writes three decimals writes
    with them. None where there is none."""
    wholes = dict[int, int]()
    grouped = dict[int, list[str]]()
    for row in rows:
        texts = map(clean_number, row)
        for k, text in enumerate(texts):
            has_mark = "." in text or "," in text
            if WHOLE.fullmatch(text):
                wholes[k] = wholes.get(k, 0) + 1
            elif POINT_GROUPS.fullmatch(text) and "," not in text:
                found = grouped.setdefault(k, [])
                found.append(text)
            elif has_mark and is_number(text):
                return None
    for k, found in grouped.items():
        count = wholes.get(k, 0)
        needed = MIN_ODD_SHARE * len(found)
        if count >= max(1, needed):
            return found[0]
    return None


def has_groups(cells: Sequence[Any], doubtful: str | None, decimal: str | None) -> bool:
    """Whether digits stand in groups by the decimal mark that the user says, be it in one cell;
    `doubtful`: a cell whose point may be either."""
    if decimal == ",":
        return doubtful is not None
    if decimal is None:
        return False
    return any(is_odd_number(cell) and COMMA_GROUPS.fullmatch(cell.strip()) for cell in cells)
