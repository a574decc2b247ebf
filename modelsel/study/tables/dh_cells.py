"""Cells of a table of DH parameters: numbers, multiples of pi, the joint's own variable; and the
units that they are in."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..._typing import Array
from ...exceptions import choice_list
from ...measurements.formats.row_places import Where

# the joint's own variable, by the column that holds it: theta1, q_2, θ3, θ, A1 (KUKA), J1, Achse 1; d4*
NUMBER = r"_?\{?\d+\}?\*?"
VARIABLES = {
    "theta": re.compile(
        r"[+-]?(?:(?:theta|q)_?\{?\d*\}?\*?|(?<![a-z])(?:joint|achse|axis|phi|th|[ajt])"
        + NUMBER
        + ")"
    ),
    "d": re.compile(r"[+-]?q_?\{?\d*\}?\*?|^[+-]?d" + NUMBER + "$"),
}
SUBSCRIPTS = str.maketrans("₀₁₂₃₄₅₆₇₈₉", "0123456789")
TERM = re.compile(r"([+-]?)(\d*\.?\d+(?:e[+-]?\d+)?|\d+\.)?\*?(pi)?(?:/(\d+\.?\d*))?")
ANGLE_UNITS = ("degrees", "radians")
LENGTH_UNITS = ("mm", "m")
# mm or m: arms are between a tenth and three metres
LONGEST_IN_M = 5.0
# rad: angles of a drawing are multiples of half a right angle, to this
NEAR_MULTIPLE = 0.02


def parse_cell(cell: Any, where: Where, row: int, column: str, key: str = "") -> tuple[float, bool]:
    """Parse a cell: (its number, whether it is written with pi). Empty cells, dashes and, where the
    `key` of the column is theta or d, the joint's own variable are 0. Raises DataError."""
    if cell is None or isinstance(cell, (int, float, np.number)):
        number = 0.0 if cell is None else float(cell)
        return (0.0 if np.isnan(number) else number), False
    text = _spell_plainly(cell)
    if key in VARIABLES:
        text = VARIABLES[key].sub("", text)
    if text in ("", "-", "+"):
        return 0.0, False
    total, place = 0.0, 0
    for match in TERM.finditer(text):
        sign, digits, pi, divisor = match.groups()
        if match.start() != place or not (digits or pi) or (place and not sign):
            break
        divided_by = float(divisor or 1)
        if not divided_by:
            break
        size = float(digits or 1) * (np.pi if pi else 1) / divided_by
        total += -size if sign == "-" else size
        place = match.end()
    if place != len(text) or not np.isfinite(total):
        raise where.refuse(
            f'"{str(cell)[:30]}" is not a number.',
            row=row,
            column=column,
            remedy="Write a number, a multiple of pi such as -pi/2, or the joint's own variable.",
        )
    return total, "pi" in text


def _spell_plainly(cell: Any) -> str:
    """Spell a cell in small letters without blanks and degree signs, θ and π as words, minus signs
    as hyphens."""
    text = str(cell).lower().replace("−", "-").replace("–", "-").translate(SUBSCRIPTS)
    text = text.replace("θ", "theta").replace("ϑ", "theta").replace("π", "pi").replace("φ", "phi")
    return re.sub(r"[\s°º]", "", text)


def find_variable(
    cell: Any, where: Where, row: int, column: str, key: str
) -> tuple[str, int] | None:
    """Find the joint's own variable in a cell of theta or d: (as it is written, 1, or -1 where it
    stands there with a minus: the joint counts the other way). Raises DataError for two of them."""
    if key not in VARIABLES or not isinstance(cell, str):
        return None
    matches = VARIABLES[key].findall(_spell_plainly(cell))
    if len(matches) > 1:
        raise where.refuse(
            f'"{cell[:30]}" holds several joints\' variables.',
            row=row,
            column=column,
            remedy="Write the joint's own alone. That joints turn together is said by coupling in a "
            "robot file (TOML).",
        )
    if not matches:
        return None
    (found,) = matches
    return re.sub(r"[{}*+-]", "", found).upper(), -1 if found.startswith("-") else 1


def check_unit(unit: str | None, is_angle: bool, where: Where, column: str) -> None:
    """Check that the unit of a column, where it says one, is of an angle, or else of a length.
    Raises DataError."""
    kind, units = "an angle", ANGLE_UNITS
    if not is_angle:
        kind, units = "a length", LENGTH_UNITS
    if unit is None or unit in units:
        return
    raise where.refuse(
        f"{kind} is expected in {choice_list(units)}, found {unit}.",
        column=column,
        remedy="Correct the unit, or the name of the column.",
    )


def find_angle_unit(columns: Sequence[tuple[Array, bool]], where: Where) -> str:
    """Find the unit of angles whose columns do not say it. Raises DataError where both fit."""
    if any(has_pi for _, has_pi in columns):
        return "radians"
    angles = np.concatenate([numbers for numbers, _ in columns])
    angles = angles[angles != 0]
    largest = np.abs(angles).max(initial=0.0)
    if largest > 2 * np.pi or not len(angles):
        return "degrees"
    parts = angles / (np.pi / 4)
    if largest > 1 and (np.abs(parts - parts.round()) < NEAR_MULTIPLE).all():
        return "radians"
    raise where.refuse(
        f"angles up to {largest:.3g} may be degrees or radians.",
        remedy="Say it in the columns' names: alpha_deg or alpha_rad.",
    )


def find_length_unit(columns: Sequence[tuple[Array, bool]], where: Where) -> str:
    """Find the unit of lengths whose columns do not say it."""
    lengths = np.concatenate([numbers for numbers, _ in columns])
    return "mm" if np.abs(lengths).max(initial=0.0) > LONGEST_IN_M else "m"
