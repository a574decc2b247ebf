"""Readings whose unit is called "Grad": in German degrees, in English gon, and by mistake radians.

Each meaning is a column of its own until the nominal arm, or the user, says which one is right."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..formats.column_names import list_units, parse_column_name
from ..formats.table import Table
from ..quantities.columns import convert_to_numbers
from .column_guesses import MAX_USUAL_RAD, Choice, Reading

WORD = "grad"
GON_DEGREES = 0.9
JOINTS = "the joint readings"


@dataclass(frozen=True)
class Meaning:
    """What "Grad" may mean: in words, why, the unit that is read, and one of it in that unit."""

    words: str
    reason: str
    unit: str
    size: float

    @property
    def ending(self) -> str:
        """What is added to the names of columns of this meaning."""
        words = self.words
        unit = self.unit
        return f" ({words}) in {unit}"


DEGREES = Meaning("degrees", "is German for degrees", "deg", 1.0)
GON = Meaning("gon", "is gon, as in English", "deg", GON_DEGREES)
RADIANS = Meaning("radians", "stands for radians", "rad", 1.0)


def offer_meanings(
    table: Table, prismatic: Sequence[bool], given: Collection[str] = ()
) -> tuple[Table, dict[str, Meaning]]:
    """Add a column for every other meaning of a column of angles in "Grad" that the user has not
    named (`given`). Returns the table and the meanings of the columns, those of the file as
    degrees; none where no column says Grad."""
    free = [name for name in table.columns if name not in given]
    named = [name for name in free if _is_grad(table, name, prismatic)]
    if not named:
        return table, {}
    meanings = dict.fromkeys(named, DEGREES)
    others = _list_others(table, named)
    columns = dict(table.columns)
    units = dict(table.units)
    for name in named:
        values = convert_to_numbers(table.columns[name])
        for meaning in others:
            added = f"{name}{meaning.ending}"
            columns[added] = values * meaning.size
            units[added] = meaning.unit
            meanings[added] = meaning
    return replace(table, columns=columns, units=units), meanings


def _list_others(table: Table, named: Sequence[str]) -> list[Meaning]:
    """List what "Grad" may mean beside degrees, by the size of the readings."""
    largest = 0.0
    for name in named:
        values = convert_to_numbers(table.columns[name])
        sizes = np.abs(values)
        largest = max(largest, np.nanmax(sizes, initial=0.0))
    others = [GON]
    if largest <= MAX_USUAL_RAD:
        others.append(RADIANS)
    return others


def _is_grad(table: Table, name: str, prismatic: Sequence[bool]) -> bool:
    """Whether a column is of the readings of a joint that turns, in Grad."""
    below = table.units.get(name)
    parsed = parse_column_name(name, below)
    number = parsed.number
    if number is None:
        return False
    if parsed.quantity != "joint":
        return False
    joints = range(1, len(prismatic) + 1)
    slides = number in joints and prismatic[number - 1]
    said = list_units(name, below)
    first = said[:1]
    return not slides and first == [WORD]


def name_meanings(choices: Sequence[Choice], meanings: Mapping[str, Meaning]) -> tuple[Choice, ...]:
    """Say of the readings of joints which meaning of "Grad" each has."""
    named = []
    for choice in choices:
        readings = choice.readings
        if choice.what == JOINTS:
            readings = tuple(_name_meaning(reading, meanings) for reading in readings)
        explained = replace(choice, readings=readings)
        named.append(explained)
    return tuple(named)


def _name_meaning(reading: Reading, meanings: Mapping[str, Meaning]) -> Reading:
    names = list(reading.columns.values())
    given = [name for name in names if name in meanings]
    if not given:
        return reading
    first = given[0]
    last = given[-1]
    meaning = meanings[first]
    ending = meaning.ending
    first = first.removesuffix(ending)
    last = last.removesuffix(ending)
    words = f'"{first}" to "{last}" in {meaning.words}'
    reason = f'their "Grad" {meaning.reason}'
    if reading.reason:
        reason = f"{reason}; {reading.reason}"
    return replace(reading, words=words, reason=reason)


def keep_meaning(table: Table, meanings: Mapping[str, Meaning], reading: Reading) -> Table:
    """Keep, of the columns of all meanings, those of the reading that was chosen."""
    chosen = set(reading.columns.values())
    others = meanings.keys() - chosen
    columns = dict(table.columns)
    for name in others:
        del columns[name]
    return replace(table, columns=columns)
