"""Columns of the contract in units that it does not read: refused with the right name, never taken
for a covariate."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from ...exceptions import DataError
from ..formats.column_names import LENGTHS, find_unit
from ..formats.table import Table
from .columns import READING_UNITS
from .contract_columns import list_contract_names

# one of a unit in those that the contract reads
ANGLES = {"urad": 1e-6, "µrad": 1e-6, "μrad": 1e-6, "mrad": 1e-3, "rad": 1.0}  # rad
DEGREES = {
    "arcsec": 1 / 3600,
    "arcmin": 1 / 60,
    "gon": 0.9,
    "gons": 0.9,
    "gradian": 0.9,
    "gradians": 0.9,
    "deg": 1.0,
    "rev": 360.0,
    "turn": 360.0,
    "turns": 360.0,
}  # deg
MASSES = {"mg": 1e-6, "g": 1e-3, "lb": 0.45359237, "lbs": 0.45359237, "kg": 1.0, "t": 1e3}  # kg
TIMES = {
    "ns": 1e-9,
    "us": 1e-6,
    "µs": 1e-6,
    "μs": 1e-6,
    "ms": 1e-3,
    "s": 1.0,
    "min": 60.0,
    "h": 3600.0,
    "hours": 3600.0,
    "minutes": 60.0,
    "msec": 1e-3,
}  # s
JOINT = re.compile(r"q[0-9]{1,9}")
DEGREE = 0.017453292519943295  # rad
WORDS = (
    "in",
    "turn",
    "turns",
    "rev",
    "min",
    "h",
    "s",
    "t",
    "g",
    "m",
)  # that a name may end with for other reasons
SPREADS, TURNS = ("sx", "sy", "sz"), ("srx", "sry", "srz")


def refuse_other_units(
    table: Table, known: set[str], prismatic: Sequence[bool], gauged: bool
) -> None:
    """Refuse a column of the table that a name of the contract has in another unit (`sx_um`,
    `q1_grad`, `temperature_K`), or in other letters (`SX_mm`) where the contract's own is not
    there. `known`: the contract's names; `gauged`: whether rows have kinds, and `length_mm` and
    `s_mm` a meaning. Raises DataError."""
    known_in_small = {name.lower(): name for name in known}
    for name in table.columns:
        if name in known:
            continue
        small = name.lower()
        stem, _, unit = small.rpartition("_")
        right, factor = _read_as(stem, unit, prismatic, gauged)
        wanted = known_in_small.get(small)
        is_other_spelling = wanted is not None and wanted not in table
        if right is None and is_other_spelling:
            right, factor = wanted, "1"
        if right is None:
            continue
        is_there_already = right in table and factor == "1"
        if not is_there_already:
            raise _refused(table, name, right, factor)


def refuse_mapped_units(
    columns: Mapping[str, str], prismatic: Sequence[bool], table: Table
) -> None:
    """Refuse a mapping of a contract's name to a column whose own name, or the row of units below
    it, says another unit (`q1_rad = "J1_deg"`). Raises DataError."""
    where = table.where
    for wanted, given in columns.items():
        stem, _, unit = wanted.rpartition("_")
        unbracketed = given.strip("])} ")
        small = unbracketed.lower()
        words = re.split(r"[^a-zµμ]+", small)
        said = words[-1]
        units, _ = _units_of(stem, said, prismatic, True)
        is_joint = JOINT.fullmatch(stem)
        if is_joint and unit in ("mm", "m"):
            units = {**LENGTHS}
        elif is_joint:
            units = {**ANGLES, **DEGREES}
        is_inch = find_unit(said) == find_unit(unit) == "in"
        is_wanted = said in (unit, *WORDS) or is_inch
        if said in units and not is_wanted:
            raise where.refuse(
                f'it is given for {wanted}, but its name says "{said}", not "{unit}".',
                column=given,
                remedy=f"Map it to the name with that unit, where there is one; else convert it to {unit}.",
            )
        _refuse_unit_below(table, wanted, given)
    mapped = set(columns.values())
    for name in list_contract_names(prismatic) - mapped:
        if name in table.units:
            _refuse_unit_below(table, name, name)


def _refuse_unit_below(table: Table, wanted: str, given: str) -> None:
    """Refuse a column below whose name a row of units says another unit than the contract's."""
    unit = wanted.rpartition("_")[2]
    below = table.units.get(given, "")
    said = find_unit(below.strip("[](){}<> "))
    wanted_unit = find_unit(unit)
    if said is not None and wanted_unit in (unit, "in") and said != wanted_unit:
        raise table.where.refuse(
            f'it is read as {wanted}, but the line of units says "{below}".',
            column=given,
            remedy=f"Map it to the name with that unit, where there is one; else convert it to {unit}.",
        )


def _refused(table: Table, name: str, right: str, factor: str) -> DataError:
    if factor == "1":
        return table.where.refuse(
            f'a measurements file calls this column "{right}": under this name it would be ignored.',
            column=name,
            remedy=f"Rename it to {right}, or to something else if that is not what it holds.",
        )
    return table.where.refuse(
        f'this unit is not read; "{right}" is expected.',
        column=name,
        remedy=f"{factor} and name the column {right}, or remove it; if it holds something else, "
        "give it another name.",
    )


def _read_as(
    stem: str, unit: str, prismatic: Sequence[bool], gauged: bool
) -> tuple[str | None, str]:
    """Return (the contract's name for a quantity `stem` in some `unit`, None for what is none, what
    to do with its numbers)."""
    if stem == "temperature" and unit == "k":
        return "temperature_C", "Subtract 273.15"
    if stem == "temperature" and unit == "f":
        return "temperature_C", "Subtract 32, divide by 1.8"
    units, unit_read = _units_of(stem, unit, prismatic, gauged)
    if unit == "grad" and units is ANGLES:
        return f"{stem}_deg", "Multiply it by 0.9 if it is gon (in German it is degree: by 1)"
    if unit not in units:
        return None, ""
    size = units[unit]
    factor = "1"
    if size != 1:
        factor = f"Multiply it by {size:.10g}"
    return f"{stem}_{unit_read}", factor


def _units_of(
    stem: str, unit: str, prismatic: Sequence[bool], gauged: bool
) -> tuple[Mapping[str, float], str]:
    """Return (units of a quantity, each in that which is read; the latter), nothing where it is
    none of the contract's."""
    if JOINT.fullmatch(stem) and 1 <= int(stem[1:]) <= len(prismatic):
        slides = prismatic[int(stem[1:]) - 1]
        if unit in READING_UNITS[slides]:
            return {}, ""
        return (
            (LENGTHS, "mm") if slides else (DEGREES, "deg") if unit in DEGREES else (ANGLES, "rad")
        )
    if stem in ("x", "y", "z", *SPREADS) or gauged and stem in ("s", "length"):
        return LENGTHS, "mm"
    if stem in TURNS:
        return {**ANGLES, **{word: size * DEGREE for word, size in DEGREES.items()}}, "rad"
    return {"payload": (MASSES, "kg"), "time": (TIMES, "s")}.get(stem, ({}, ""))
