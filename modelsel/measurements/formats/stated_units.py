"""The unit of lengths that a comment of a file says, as Spatial Analyzer writes it: "// Units:
Inches, Degrees". It is that of position columns that name none."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from .column_names import LENGTHS, OTHER_QUANTITIES, find_unit, parse_column_name
from .row_places import Where

COORDINATES = ("x", "y", "z")
UNITS_SAID = re.compile(r"\W*(?:length |linear )?units?\s*[:=]\s*(.+)", re.IGNORECASE)
WORD = re.compile(r"[^\W\d_]+")
# lengths by the words that are not units of a column's name
LONG_NAMES = {"foot": "ft", "feet": "ft", "centimeters": "cm", "centimetres": "cm"}


def name_unit(unit: str) -> str:
    """Name a unit in a sentence: "in" would be read as the word."""
    return "inches" if unit == "in" else unit


def find_stated_unit(comments: Mapping[int, str]) -> tuple[str, int] | None:
    """Find (the unit of lengths, the line) that comments, by their lines, say; None where none
    does, or two that differ do."""
    found = {}
    for line, text in comments.items():
        match = UNITS_SAID.match(text)
        if match is None:
            continue
        said = match[1]
        words = [word.lower() for word in WORD.findall(said)]
        units = {find_unit(word) or LONG_NAMES.get(word, word) for word in words}
        lengths = units & set(LENGTHS)
        if len(lengths) > 1:
            lengths -= {"in"}  # "Units: in mm"
        for unit in lengths:
            found[unit] = line
    pairs = list(found.items())
    is_clear = len(pairs) == 1
    return pairs[0] if is_clear else None


def list_position_units(
    names: Iterable[str], units: Mapping[str, str], unit: str, line: int, where: Where
) -> dict[str, str]:
    """List the units of columns with that of positions which name none, of a file whose comment on
    `line` says it. Raises DataError for a position that names another."""
    stated = dict(units)
    for name in names:
        parsed = parse_column_name(name, units.get(name))
        is_position = parsed.quantity in COORDINATES and not parsed.words & OTHER_QUANTITIES
        if not is_position:
            continue
        if parsed.unit is None:
            stated[name] = unit
        elif parsed.unit not in ("", unit):
            raise where.refuse(
                f"its unit is {name_unit(parsed.unit)}, but the comment on line {line} says that lengths are "
                f"in {name_unit(unit)}.",
                column=name,
                remedy="Correct whichever is wrong: the column's name, or the comment.",
            )
    return stated
