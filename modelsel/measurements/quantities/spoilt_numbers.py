"""Cells that hold a number in a way that is not read, and how to write it."""

from __future__ import annotations

import re

from ..formats.number_format import COMMA_GROUPS, is_number

DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+")
# (37.84) and 37.84-, as accountants and SAP write negative numbers
BRACKETED = re.compile(r"\((.+)\)|(.+)-")
# the exponents of Fortran's double precision
FORTRAN = re.compile(r"([-+]?\d*\.?\d+)[dD]([-+]?\d+)")
DEGREES_MINUTES = re.compile(r"[-+]?\d+\s*°\s*\d+\s*['′’].*")
WITH_UNIT = re.compile(r"([-+]?[\d.,]*\d)\s*(?:°|º|[^\W\d_]+)")


def advise_on_number(cell: str) -> str:
    """Say how to write a number that is not read as it stands; empty where it looks like none."""
    text = cell.strip()
    if DECIMAL_COMMA.fullmatch(text):
        return _advise_on_comma(text)
    negative = BRACKETED.fullmatch(text)
    if negative is not None:
        size = negative[1] or negative[2]
        return f"Write a minus before a negative number: -{size}." if is_number(size) else ""
    double = FORTRAN.fullmatch(text)
    if double is not None:
        return f"Write the exponent with an E: {double[1]}E{double[2]}."
    if DEGREES_MINUTES.fullmatch(text):
        return "Write the angles in decimal degrees."
    unit = WITH_UNIT.fullmatch(text)
    if unit is not None:
        return f"Write the number alone: {unit[1]}. Its unit belongs into the column's name."
    return ""


def _advise_on_comma(text: str) -> str:
    """Say what to do with a comma in a number, which may be one between thousands."""
    remedy = "Correct the cell or remove the row."
    if not COMMA_GROUPS.fullmatch(text):
        return f"{remedy} Numbers need a decimal point, not a comma."
    plain = text.replace(",", ".")
    whole = text.replace(",", "")
    return (
        f'{remedy} "{text}" may be {whole} (a comma between thousands; --decimal point reads it so) '
        f"or {plain} (a decimal comma, where the others have a point)."
    )
