"""Readings whose unit is called "Grad": in German degrees, in English gon, and by mistake radians.

Each meaning is a column of its own until the nominal arm, or the user, says which one is right."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .column_guesses import MAX_USUAL_RAD, Choice, Reading
from .column_names import list_units, parse_column_name
from .columns import convert_to_numbers
from .table import Table

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
        return f" ({self.words}) in {self.unit}"


DEGREES = Meaning("degrees", "is German for degrees", "deg", 1.0)
GON = Meaning("gon", "is gon, as in English", "deg", GON_DEGREES)
RADIANS = Meaning("radians", "stands for radians", "rad", 1.0)


def offer_meanings(
    table: Table, prismatic: Sequence[bool], given: Collection[str] = ()
) -> tuple[Table, dict[str, Meaning]]:
    """Add a column for every other meaning of a column of angles in "Grad" that the user has not
    named (`given`). Returns the table and the meanings of the columns, those of the file as
    degrees; none where no column says Grad."""
    named = [
        name for name in table.columns if name not in given and _is_grad(table, name, prismatic)
    ]
    meanings = dict.fromkeys(named, DEGREES)
    if not named:
        return table, {}
    values = np.stack([convert_to_numbers(table.columns[name]) for name in named])
    finite = np.abs(values[np.isfinite(values)])
    others = [GON]
    if finite.max(initial=0.0) <= MAX_USUAL_RAD:
        others.append(RADIANS)
    columns = dict(table.columns)
    units = dict(table.units)
    for meaning in others:
        for name, column in zip(named, values, strict=True):
            added = f"{name}{meaning.ending}"
            columns[added] = column * meaning.size
            units[added] = meaning.unit
            meanings[added] = meaning
    return replace(table, columns=columns, units=units), meanings


def _is_grad(table: Table, name: str, prismatic: Sequence[bool]) -> bool:
    """Whether a column is of the readings of a joint that turns, in Grad."""
    below = table.units.get(name)
    parsed = parse_column_name(name, below)
    if parsed.quantity != "joint" or parsed.number is None:
        return False
    index = parsed.number - 1
    slides = 0 <= index < len(prismatic) and prismatic[index]
    said = list_units(name, below)
    return not slides and said[:1] == [WORD]


def name_meanings(choice: Choice, meanings: Mapping[str, Meaning]) -> Choice:
    """Say of the readings of joints which meaning of "Grad" each has."""
    if choice.what != JOINTS or not meanings:
        return choice
    readings = tuple(_name_meaning(reading, meanings) for reading in choice.readings)
    return replace(choice, readings=readings)


def _name_meaning(reading: Reading, meanings: Mapping[str, Meaning]) -> Reading:
    given = [name for name in reading.columns.values() if name in meanings]
    if not given:
        return reading
    meaning = meanings[given[0]]
    first, last = (given[k].removesuffix(meaning.ending) for k in (0, -1))
    reasons = filter(None, (f'their "Grad" {meaning.reason}', reading.reason))
    return replace(
        reading, words=f'"{first}" to "{last}" in {meaning.words}', reason="; ".join(reasons)
    )


def keep_meaning(table: Table, meanings: Mapping[str, Meaning], reading: Reading) -> Table:
    """Keep, of the columns of all meanings, those of the reading that was chosen."""
    chosen = set(reading.columns.values())
    is_other = meanings.keys() - chosen
    columns = {name: cells for name, cells in table.columns.items() if name not in is_other}
    return replace(table, columns=columns)
