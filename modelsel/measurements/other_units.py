"""Columns in units that a measurements file does not have (cm, mrad, gon), converted to mm and
rad where a study is begun."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .column_names import LENGTHS, OTHER_QUANTITIES, ColumnName, list_units, parse_column_name
from .columns import convert_to_numbers, find_blank_cells
from .table import Table
from .unit_names import ANGLES, DEGREE, DEGREES

COORDINATES = ("x", "y", "z")
# one of each unit of an angle, in rad
RADIANS = {**{unit: size * DEGREE for unit, size in DEGREES.items()}, **ANGLES}
READ = ("mm", "m", "rad", "deg")


def convert_units(table: Table, prismatic: Sequence[bool]) -> tuple[Table, tuple[str, ...]]:
    """Convert joint readings and coordinates whose names, or a row of units below them, say a unit
    that is not read. Returns the table, its columns renamed, and what is said of it."""
    columns: dict[str, NDArray[np.generic]] = {}
    units = dict(table.units)
    converted: dict[str, list[str]] = {}
    for name, cells in table.columns.items():
        factor, unit, said = _find_factor(
            parse_column_name(name, units.get(name)), table, prismatic
        )
        values = convert_to_numbers(cells)
        if not said or not (np.isfinite(values) | find_blank_cells(cells)).all():
            columns[name] = cells
            continue
        renamed = f"{name} in {unit}"
        columns[renamed] = values * factor
        units[renamed] = unit
        converted.setdefault(f"from {said} to {unit}", []).append(f'"{name}"')
    if not converted:
        return table, ()
    listed = "; ".join(f"{', '.join(names)} {way}" for way, names in converted.items())
    return replace(table, columns=columns, units=units), (f"Converted: {listed}.",)


def _find_factor(
    name: ColumnName, table: Table, prismatic: Sequence[bool]
) -> tuple[float, str, str]:
    """Find (factor, unit that is read, unit that is said) of a column; no unit said where nothing
    is to be converted."""
    is_joint = name.quantity == "joint"
    is_unread = name.unit == "" or is_joint and name.unit == "in"
    if not is_unread or name.words & OTHER_QUANTITIES:
        return 1.0, "", ""
    is_length = name.quantity in COORDINATES
    if is_joint and name.number is not None:
        index = name.number - 1
        is_length = 0 <= index < len(prismatic) and prismatic[index]
    elif not is_length:
        return 1.0, "", ""
    sizes, unit = (LENGTHS, "mm") if is_length else (RADIANS, "rad")
    for said in list_units(name.given, table.units.get(name.given)):
        if said in sizes:
            return sizes[said], unit, said
    return 1.0, "", ""
