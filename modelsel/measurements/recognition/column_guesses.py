"""Guess which columns of a file are joint readings and positions, and in which unit: all of them at
once, each with its reason, and with every reading that fits."""

from __future__ import annotations

import shlex
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from ..._typing import Array
from ...exceptions import DataError, one_line, sentence_list
from ..formats.column_names import (
    AXES,
    OTHER_QUANTITIES,
    TURN_WORDS,
    WEAK_JOINT_WORDS,
    ColumnName,
    parse_column_name,
)
from ..formats.table import Table
from ..quantities.columns import POSITION_UNITS, READING_UNITS, convert_to_numbers, read_numbers
from ..quantities.joint_names import find_named_joints
from ..quantities.numbered_joints import describe_missing_joints, group_numbered_joints
from ..quantities.other_units import convert_units

# rad: readings beyond it are degrees; below it, and above the next, they are radians
MAX_READING_RAD = 4 * np.pi
MAX_USUAL_RAD = 6.4
MIN_USUAL_RAD = 1.5
# extent of the measured positions: in mm above the first, in m below the second
MIN_EXTENT_MM = 20.0
MAX_EXTENT_M = 10.0
# share of cells that are numbers in a column of numbers
MIN_NUMBERS = 0.8
UNIT_NAMES = {"deg": "degrees", "rad": "radians", "mm": "mm", "m": "m", "in": "inches"}


@dataclass(frozen=True)
class Reading:
    """One way to read columns: the contract's names for the file's, in words, and why."""

    columns: Mapping[str, str]
    words: str
    reason: str = ""

    @property
    def sentence(self) -> str:
        """Say how the columns are read."""
        return f"{self.words} ({self.reason})" if self.reason else self.words

    def write_options(self) -> str:
        """Write the options of a command that ask for this reading."""
        pairs = [f"{wanted}={given}" for wanted, given in self.columns.items()]
        return " ".join(f"--column {shlex.quote(pair)}" for pair in pairs)


@dataclass(frozen=True)
class Choice:
    """The readings that fit, the best first; doubtful where there are several, absent where none."""

    what: str
    readings: tuple[Reading, ...]

    @property
    def is_doubtful(self) -> bool:
        """Whether several readings fit."""
        count = len(self.readings)
        return count > 1


def guess_columns(
    table: Table, prismatic: Sequence[bool], joint_names: Sequence[str] = ()
) -> list[Choice]:
    """Guess the columns that a table does not have under the contract's names; `joint_names`: what
    the robot file calls the joints, where it does."""
    units = table.units
    names = [parse_column_name(name, units.get(name)) for name in table.columns]
    numeric = [name for name in names if is_numeric(table, name.given)]
    choices = []
    if list_missing_joints(table, prismatic):
        readings = _read_joint_columns(table, numeric, prismatic, joint_names)
        choice = Choice("the joint readings", readings)
        choices.append(choice)
    if is_position_missing(table):
        readings = _read_position_columns(table, numeric)
        choice = Choice("the position", readings)
        choices.append(choice)
    return choices


def find_spoilt_cell(
    table: Table, choice: Choice, prismatic: Sequence[bool], joint_names: Sequence[str] = ()
) -> DataError | None:
    """Return the error of the first cell that is no number, where nothing fits a choice only since
    the cells of the columns with the right names are none; else None."""
    if choice.readings or not len(table):
        return None
    columns = {
        name: cells if is_numeric(table, name) else np.arange(len(table), dtype=float)
        for name, cells in table.columns.items()
    }
    filled = replace(table, columns=columns)
    for other in guess_columns(filled, prismatic, joint_names):
        if other.what == choice.what and other.readings:
            for name in other.readings[0].columns.values():
                try:
                    read_numbers(table, name)
                except DataError as error:
                    return error
    return None


def list_missing_joints(table: Table, prismatic: Sequence[bool]) -> list[int]:
    """List the joints, from 1, that a table has no column of."""
    return [
        j
        for j, slides in enumerate(prismatic, 1)
        if not any(f"q{j}_{unit}" in table for unit in READING_UNITS[slides])
    ]


def is_position_missing(table: Table) -> bool:
    """Whether a table of points lacks a coordinate."""
    return any(map(partial(_lacks_axis, table), AXES))


def _lacks_axis(table: Table, axis: str) -> bool:
    """Whether a table has no column of a coordinate."""
    return not any(f"{axis}_{unit}" in table for unit in POSITION_UNITS)


def is_numeric(table: Table, name: str) -> bool:
    """Whether most cells of a column are numbers."""
    values = convert_to_numbers(table.columns[name])
    if not len(values):
        return False
    share = np.isfinite(values).mean()
    return bool(share >= MIN_NUMBERS)


# -- joints
# --------------------------------------------------------------------------------------------


def _read_joint_columns(
    table: Table, names: Sequence[ColumnName], prismatic: Sequence[bool], joint_names: Sequence[str]
) -> tuple[Reading, ...]:
    """List the readings of columns that are called as the robot's joints are, else of those that
    are numbered like them."""
    count = len(prismatic)
    named = find_named_joints(names, joint_names)
    if named:
        whole = [_read_family(table, columns, prismatic) for columns in _prefer_measured(named)]
        return tuple(_list_each(reading) for readings in whole for reading in readings)
    complete = []
    for family in group_numbered_joints(names):
        first = 0 if 0 in family else 1
        numbers = range(first, first + count)
        goes_on = first + count in family
        if goes_on or not set(numbers) <= set(family):
            continue
        complete.append([family[number] for number in numbers])
    strong = [family for family in complete if not _is_weak(family)]
    complete = strong or complete
    readings = list[Reading]()
    for columns in _prefer_measured(complete):
        readings += _read_family(table, columns, prismatic)
    return tuple(readings)


def _list_each(reading: Reading) -> Reading:
    """Say of a reading by joints' names which column each joint has."""
    pairs = [f"{wanted.split('_')[0]} = {_quote(name)}" for wanted, name in reading.columns.items()]
    unit = reading.words.rpartition(" in ")[2]
    words = f"by the names of the robot file's joints, {', '.join(pairs)}, in {unit}"
    return replace(reading, words=words)


def _is_weak(family: Sequence[ColumnName]) -> bool:
    """Whether columns are joints' only where no others are."""
    first = family[0]
    return first.stem in WEAK_JOINT_WORDS


def _prefer_measured(families: list[list[ColumnName]]) -> list[list[ColumnName]]:
    """Return the families whose names say that they were measured, else those that do not say
    that they were commanded, else all."""
    measured = [family for family in families if all(name.is_measured for name in family)]
    neutral = [family for family in families if not any(name.is_commanded for name in family)]
    return measured or neutral or families


def _read_family(
    table: Table, family: Sequence[ColumnName], prismatic: Sequence[bool]
) -> list[Reading]:
    """List the readings of one column per joint: in the units that are said, else in those that
    the values allow."""
    angles, reason_angles = _list_units(table, family, prismatic, slides=False)
    slides, reason_slides = _list_units(table, family, prismatic, slides=True)
    readings = []
    for angle, length in product(angles, slides):
        columns, units = {}, []
        for j, (name, is_sliding) in enumerate(zip(family, prismatic, strict=True), 1):
            unit = length if is_sliding else angle
            columns[f"q{j}_{unit}"] = name.given
            units.append(UNIT_NAMES[unit])
        first = _quote(family[0].given)
        last = _quote(family[-1].given)
        distinct = list(dict.fromkeys(units))
        words = f"{first} to {last} in {sentence_list(distinct)}"
        reasons = filter(None, (reason_angles, reason_slides))
        reading = Reading(columns, words, "; ".join(reasons))
        readings.append(reading)
    return readings


def _list_units(
    table: Table, family: Sequence[ColumnName], prismatic: Sequence[bool], slides: bool
) -> tuple[list[str], str]:
    """List the units that the joints of one kind may have, the likelier first, and say why."""
    chosen = [name for name, sliding in zip(family, prismatic, strict=True) if sliding == slides]
    allowed = READING_UNITS[slides]
    if not chosen:
        return [allowed[0]], ""
    said = {name.unit for name in chosen}
    if said != {None}:
        return _keep_read_unit(said, allowed), ""
    values = np.concatenate([_read_values(table, name) for name in chosen])
    highest = float(np.nanmax(values))
    lowest = float(np.nanmin(values))
    if slides:
        return _list_length_units(highest - lowest, "travel")
    return _list_angle_units(max(highest, -lowest))


def _keep_read_unit(said: set[str | None], allowed: Sequence[str]) -> list[str]:
    """Keep the unit that all columns say, where it is one that is read; none otherwise."""
    count = len(said)
    if count > 1:
        return []
    return [unit for unit in allowed if unit in said]


def _list_angle_units(largest: float) -> tuple[list[str], str]:
    """List the units that angles up to some size may have, and say why."""
    reason = f"up to {float(f'{largest:.3g}'):,g}"
    if largest > MAX_READING_RAD:
        return ["deg"], reason
    if largest > MAX_USUAL_RAD:
        return ["deg", "rad"], reason
    return (["rad"] if largest >= MIN_USUAL_RAD else ["rad", "deg"]), reason


# -- positions
# --------------------------------------------------------------------------------------------


def _read_position_columns(table: Table, names: Sequence[ColumnName]) -> tuple[Reading, ...]:
    """List the readings of columns that are called x, y and z."""
    families: dict[Any, dict[str, ColumnName]] = defaultdict(dict)
    for name in names:
        is_other = name.words & (OTHER_QUANTITIES | TURN_WORDS)
        axis = name.quantity
        if axis in AXES and not is_other:
            family = families[name.stem, name.words]
            family.setdefault(str(axis), name)
    found = families.values()
    whole = [family for family in found if len(family) == len(AXES)]
    complete = [[family[axis] for axis in AXES] for family in whole]
    readings = []
    for columns in _prefer_measured(complete):
        units, reason = _list_position_units(table, columns)
        given = [name.given for name in columns]
        listed = sentence_list([_quote(name) for name in given])
        for unit in units:
            wanted = [f"{axis}_{unit}" for axis in AXES]
            mapped = dict(zip(wanted, given, strict=True))
            reading = Reading(mapped, f"{listed} in {UNIT_NAMES[unit]}", reason)
            readings.append(reading)
    return tuple(readings)


def _list_position_units(table: Table, family: Sequence[ColumnName]) -> tuple[list[str], str]:
    said = {name.unit for name in family}
    if said != {None}:
        return _keep_read_unit(said, POSITION_UNITS), ""
    values = np.stack([_read_values(table, name) for name in family])
    highest = np.nanmax(values, axis=1)
    lowest = np.nanmin(values, axis=1)
    extent = np.max(highest - lowest)
    return _list_length_units(float(extent), "over a range of")


def _list_length_units(extent: float, words: str) -> tuple[list[str], str]:
    size = f"{extent:.3g}"
    if extent >= 100:
        size = f"{extent:.0f}"
    reason = f"{words} {size}"
    if extent > MIN_EXTENT_MM:
        return ["mm"], reason
    if not extent:
        return ["mm", "m"], reason
    return (["m"] if extent <= MAX_EXTENT_M else ["mm", "m"]), reason


def _read_values(table: Table, name: ColumnName) -> Array:
    values = convert_to_numbers(table.columns[name.given])
    is_finite = np.isfinite(values)
    return np.where(is_finite, values, np.nan)


def _quote(name: str) -> str:
    return f'"{one_line(name)}"'


# -- what is said of a guess
# --------------------------------------------------------------------------------------------


def propose_columns(
    table: Table, prismatic: Sequence[bool], joint_names: Sequence[str] = (), positions: bool = True
) -> DataError | None:
    """Return the error that proposes names for all missing columns at once, those of `positions`
    where they must be there; None where fewer than two are missing, or nothing looks like any."""
    lacking = len(list_missing_joints(table, prismatic))
    if positions:
        lacking += sum(map(partial(_lacks_axis, table), AXES))
    if lacking < 2:
        return None
    converted = convert_units(table, prismatic, ())
    originals = converted.originals
    guesses = guess_columns(converted.table, prismatic, joint_names)
    choices = [
        name_originals(choice, originals)
        for choice in guesses
        if positions or choice.what != "the position"
    ]
    for choice in choices:
        spoilt = find_spoilt_cell(table, choice, prismatic, joint_names)
        if spoilt is not None:
            return spoilt
    if not any(choice.readings for choice in choices):
        return None
    sentences = [_describe_choice(table, choice, len(prismatic)) for choice in choices]
    guessed = merge_columns([choice.readings[0] for choice in choices if choice.readings])
    mapping = {wanted: originals.get(name, name) for wanted, name in guessed.items()}
    where = table.where
    what = f"{lacking} columns do not have the names of a measurements file."
    remedy = f"{' '.join(sentences)} Map them {where.mapping_all(mapping)}."
    if where.is_file:
        remedy += f" modelsel init {shlex.quote(where.file)} --robot NAME writes a study that does."
    return where.refuse(what, remedy=remedy)


def name_originals(choice: Choice, originals: Mapping[str, str]) -> Choice:
    """Say the readings of a choice by the names that converted columns have in the file."""
    readings = list[Reading]()
    for reading in choice.readings:
        words = reading.words
        for renamed, own in originals.items():
            as_renamed = _quote(renamed)
            as_own = _quote(own)
            words = words.replace(as_renamed, as_own)
        if words != reading.words:
            words += ", converted"
        renamed_reading = replace(reading, words=words)
        readings.append(renamed_reading)
    whole = tuple(readings)
    return replace(choice, readings=whole)


def merge_columns(readings: Sequence[Reading]) -> dict[str, str]:
    """Merge the mappings of several readings."""
    merged: dict[str, str] = {}
    for reading in readings:
        merged |= reading.columns
    return merged


def _describe_choice(table: Table, choice: Choice, joints: int) -> str:
    if not choice.readings:
        missing = describe_missing_joints(table, joints) if "joint" in choice.what else ""
        return missing or f"Nothing looks like {choice.what}."
    first, *others = choice.readings
    what = choice.what
    looks = "looks"
    if what.endswith("s"):
        looks = "look"
    subject = what.capitalize()
    said = [f"{subject} {looks} like {first.sentence}"]
    said += [f"or {other.words}" for other in others]
    return f"{', '.join(said)}."
