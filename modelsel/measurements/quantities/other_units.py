"""Columns in units that a measurements file does not have (cm, mrad, gon, °F, min), converted where
a file says them: by the names of columns, or a row of units below these."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...notices import Note
from ..formats.column_names import (
    LENGTHS,
    OTHER_QUANTITIES,
    ColumnName,
    list_units,
    parse_column_name,
)
from ..formats.table import Table
from .columns import UNITS, convert_to_numbers
from .unit_names import ANGLES, DEGREE, DEGREES, TIMES

COORDINATES = ("x", "y", "z")
# one of each unit of an angle, in rad
RADIANS = {**{unit: size * DEGREE for unit, size in DEGREES.items()}, **ANGLES}
# one of each unit of a time that is not read, in s
SECONDS = {unit: (size, 0.0) for unit, size in TIMES.items() if unit != "s"}
QUANTITY = re.compile(r"(s?[xyz]|q(\d{1,9}))_(\w+)")
# °C of one degree, and of zero, by other scales
KELVIN, FAHRENHEIT = (1.0, -273.15), (5 / 9, -160 / 9)
CELSIUS = {"k": KELVIN, "f": FAHRENHEIT, "°f": FAHRENHEIT, "degf": FAHRENHEIT}
DEGREES_SHOWN = {"k": "K", "f": "°F", "degf": "°F", "C": "°C"}
COVARIATE_UNITS = {"temperature_C": (CELSIUS, "C"), "time_s": (SECONDS, "s")}


@dataclass(frozen=True)
class Converted:
    """A table whose columns of unread units are converted and renamed: `originals`, the names that
    they have in the file."""

    table: Table
    originals: Mapping[str, str] = field(default_factory=dict)


def convert_units(table: Table, prismatic: Sequence[bool], mapped: Collection[str]) -> Converted:
    """Convert joint readings and coordinates whose names, or a row of units below them, say a unit
    that is not read, to look at their values; not those that are `mapped` already."""
    columns: dict[str, NDArray[np.generic]] = {}
    units = dict(table.units)
    originals: dict[str, str] = {}
    for name, cells in table.columns.items():
        parsed = parse_column_name(name, units.get(name))
        factor, unit, said = 1.0, "", ""
        if name not in mapped and not parsed.words & OTHER_QUANTITIES:
            factor, unit, said = _find_factor(parsed, table, _is_length(parsed, prismatic))
        if not said:
            columns[name] = cells
            continue
        is_in_name = parse_column_name(name).unit is not None
        renamed = f"{name} in {unit}" if is_in_name else name
        columns[renamed] = _scale(cells, factor)
        units[renamed] = unit
        originals[renamed] = name
    return Converted(replace(table, columns=columns, units=units), originals)


def convert_mapped(
    table: Table, mapping: Mapping[str, str], prismatic: Sequence[bool]
) -> tuple[Table, frozenset[str]]:
    """Convert the columns that are mapped to coordinates or readings and say a unit that is not
    read, to the unit of the contract's name. Returns the table, with a note, and these columns."""
    columns = dict(table.columns)
    units = dict(table.units)
    converted: dict[str, list[str]] = {}
    for wanted, given in mapping.items():
        if given not in columns:
            continue
        factor, shift, way = _find_way(wanted, given, table, prismatic)
        if not way:
            continue
        columns[given] = _scale(columns[given], factor, shift)
        units.pop(given, None)
        names = converted.setdefault(way, [])
        names.append(f'"{given}"')
    if not converted:
        return table, frozenset()
    listed = "; ".join(f"{', '.join(names)} {way}" for way, names in converted.items())
    notes = (*table.notes, Note("units-converted", f"Converted: {listed}."))
    done = frozenset(name[1:-1] for each in converted.values() for name in each)
    return replace(table, columns=columns, units=units, notes=notes), done


def _find_way(
    wanted: str, given: str, table: Table, prismatic: Sequence[bool]
) -> tuple[float, float, str]:
    """Find (factor, what is added then, the way in words) from the unit that a column says to that
    of the contract's name; no words where nothing is to be converted."""
    row_of_units = table.units.get(given)
    if wanted in COVARIATE_UNITS:
        sizes, unit = COVARIATE_UNITS[wanted]
        said = find_said_unit(given, row_of_units, sizes)
        known = sizes.get(said, (1.0, 0.0))
        factor, shift = known
        way = f"from {write_unit(said)} to {write_unit(unit)}"
        return factor, shift, way if said else ""
    match = QUANTITY.fullmatch(wanted)
    if match is None or match[3] not in UNITS:
        return 1.0, 0.0, ""
    is_length = match[2] is None or _slides(int(match[2]), prismatic)
    quantity = None if match[2] is None else "joint"
    parsed = parse_column_name(given, row_of_units)
    factor, _, said = _find_factor(replace(parsed, quantity=quantity), table, is_length)
    size = UNITS[match[3]]
    return factor / size, 0.0, f"from {said} to {match[3]}" if said else ""


def write_unit(unit: str) -> str:
    """Write a unit as people do."""
    return DEGREES_SHOWN.get(unit, unit)


def find_said_unit(given: str, row_of_units: str | None, sizes: Collection[str]) -> str:
    """Find the unit, one of `sizes`, that a column's name or the row of units says; empty for
    none."""
    said = list_units(given, row_of_units)
    return next((unit for unit in said if unit in sizes), "")


def _scale(cells: NDArray[Any], factor: float, shift: float = 0.0) -> NDArray[np.generic]:
    """Multiply the numbers among cells, and add to them; a cell that is none stays as it is, to be
    refused later."""
    values = convert_to_numbers(cells)
    is_number = np.isfinite(values)
    if is_number.all():
        return np.asarray(values * factor + shift)
    objects = np.asarray(cells, dtype=object)
    scaled = objects.copy()
    numbers = values[is_number]
    scaled[is_number] = numbers * factor + shift
    return scaled


def _is_length(name: ColumnName, prismatic: Sequence[bool]) -> bool | None:
    """Whether a column holds lengths, by what it is called: None for neither a joint's reading nor a
    coordinate."""
    quantity = name.quantity
    number = name.number
    if quantity in COORDINATES:
        return True
    if quantity != "joint":
        return None
    if number is None:
        return None
    return _slides(number, prismatic)


def _slides(joint: int, prismatic: Sequence[bool]) -> bool:
    """Whether a joint, from 1, slides."""
    return 1 <= joint <= len(prismatic) and bool(prismatic[joint - 1])


def _find_factor(name: ColumnName, table: Table, is_length: bool | None) -> tuple[float, str, str]:
    """Find (factor, unit that is read, unit that is said) of a column; no unit said where nothing
    is to be converted."""
    is_unread = name.unit == "" or name.quantity == "joint" and name.unit == "in"
    if not is_unread or is_length is None:
        return 1.0, "", ""
    sizes, unit = (LENGTHS, "mm") if is_length else (RADIANS, "rad")
    for said in list_units(name.given, table.units.get(name.given)):
        if said in sizes:
            return sizes[said], unit, said
    return 1.0, "", ""
