"""Gear ratios that a workbook lists beside its measurements: a joint and a number in each row, below
a word for gears."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .column_names import parse_column_name
from .number_format import convert_number_text, is_number
from .spreadsheet import SPREADSHEET_SUFFIXES, read_sheets

GEAR_WORD = re.compile(r"getriebe|übersetzung|uebersetzung|gear|ratio|reduction", re.IGNORECASE)
# rows above the first joint in which a word for gears may stand
ROWS_ABOVE = 3
# turns of a motor per turn of its joint
MIN_RATIO = 10.0
MAX_RATIO = 500.0


@dataclass(frozen=True)
class GearRatios:
    """Turns of the motor per turn of every joint, the sheet that lists them and its rows, the first
    and the last."""

    values: tuple[float, ...]
    sheet: str
    rows: tuple[int, int]

    @property
    def sentence(self) -> str:
        """Say where they are from and what they are used for."""
        listed = ", ".join(f"{value:g}" for value in self.values)
        first, last = self.rows
        return (
            f'Gear ratios from the sheet "{self.sheet}", rows {first} to {last}: {listed}; uneven gears are '
            "looked for at these waves a turn, too."
        )


def find_gear_ratios(path: Path, joints: int) -> GearRatios | None:
    """Find the gear ratios of all joints of an arm in a workbook; None where there are none, or
    several lists. Raises DataError for a workbook that cannot be read."""
    if path.suffix.lower() not in SPREADSHEET_SUFFIXES:
        return None
    found = []
    for sheet, rows in read_sheets(path).items():
        for start in range(len(rows)):
            values = _read_ratios(rows[start : start + joints])
            above = rows[max(0, start - ROWS_ABOVE) : start]
            if len(values) == joints and _names_gears(above):
                place = (start + 1, start + joints)
                ratios = GearRatios(values, sheet, place)
                found.append(ratios)
    return found[0] if len(found) == 1 else None


def _read_ratios(rows: Sequence[Sequence[Any]]) -> tuple[float, ...]:
    """Read rows of joints 1, 2, … and a number each, as far as they are."""
    values = list[float]()
    for expected, row in enumerate(rows, 1):
        filled = [cell for cell in row if str(cell).strip()]
        if len(filled) != 2:
            break
        name, cell = filled
        parsed = parse_column_name(str(name))
        is_named = parsed.quantity == "joint" and parsed.number == expected
        # below a word for gears the number of a joint says enough
        is_joint = is_named or str(name).strip() == str(expected)
        if not is_joint or not is_number(cell):
            break
        text = convert_number_text(cell, ",")
        value = float(text)
        if not MIN_RATIO <= value <= MAX_RATIO:
            break
        values.append(value)
    return tuple(values)


def _names_gears(rows: Sequence[Sequence[Any]]) -> bool:
    """Whether a cell of some rows has a word for gears."""
    for row in rows:
        for cell in row:
            text = str(cell)
            if GEAR_WORD.search(text):
                return True
    return False
