"""Columns in units that a measurements file does not have (cm, mrad, gon), converted to mm and
rad where a study is begun."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .column_names import LENGTHS, OTHER_QUANTITIES, ColumnName, list_units, parse_column_name
from .columns import convert_to_numbers
from .table import Table
from .unit_names import ANGLES, DEGREE, DEGREES

COORDINATES = ("x", "y", "z")
# one of each unit of an angle, in rad
RADIANS = {**{unit: size * DEGREE for unit, size in DEGREES.items()}, **ANGLES}
# of the units that are read, in mm or rad
SIZES = {"mm": 1.0, "m": 1e3, "in": 25.4, "inch": 25.4, "rad": 1.0, "deg": DEGREE}


def convert_units(
    table: Table, prismatic: Sequence[bool], given: Mapping[str, str] = MappingProxyType({})
) -> tuple[Table, tuple[str, ...]]:
    """Convert joint readings and coordinates whose names, or a row of units below them, say a unit
    that is not read; those that the user names (`given`) to the unit that is wanted, under the
    name that is wanted. A column whose own name says the unit is renamed. Returns the table, and
    what is said of it."""
    wanted = {name: contract for contract, name in given.items()}
    columns: dict[str, NDArray[np.generic]] = {}
    units = dict(table.units)
    converted: dict[str, list[str]] = {}
    for name, cells in table.columns.items():
        parsed = parse_column_name(name, units.get(name))
        if name in wanted:
            contract = parse_column_name(wanted[name])
            parsed = replace(contract, given=name, unit=parsed.unit)
        factor, unit, said = _find_factor(parsed, table, prismatic)
        if not said:
            columns[name] = cells
            continue
        renamed = name
        if name in wanted:
            renamed = wanted[name]
            unit = renamed.rpartition("_")[2]
        elif parse_column_name(name).unit is not None:
            renamed = f"{name} in {unit}"
        columns[renamed] = _scale(cells, factor / SIZES.get(unit, 1.0))
        units[renamed] = unit
        converted.setdefault(f"from {said} to {unit}", []).append(f'"{name}"')
    if not converted:
        return table, ()
    listed = "; ".join(f"{', '.join(names)} {way}" for way, names in converted.items())
    return replace(table, columns=columns, units=units), (f"Converted: {listed}.",)


def _scale(cells: NDArray[Any], factor: float) -> NDArray[np.generic]:
    """Multiply the numbers among cells; a cell that is none stays as it is, to be refused later."""
    values = convert_to_numbers(cells)
    is_number = np.isfinite(values)
    if is_number.all():
        return np.asarray(values * factor)
    scaled = np.asarray(cells, dtype=object).copy()
    scaled[is_number] = values[is_number] * factor
    return scaled


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
