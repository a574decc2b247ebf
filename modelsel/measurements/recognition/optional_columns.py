"""Guess columns that a measurements file may have: reflectors, sessions, temperature, payload,
time. Only what is plain by name and values; everything else stays a covariate."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..formats.column_names import (
    CELSIUS_WORDS,
    LENGTHS,
    OTHER_QUANTITIES,
    TEMPERATURE_WORDS,
    ColumnName,
    list_units,
    parse_column_name,
)
from ..formats.table import Table
from ..quantities.columns import convert_to_numbers, find_blank_cells
from ..quantities.contract_columns import UNCERTAINTY_COLUMNS
from ..quantities.epoch_times import scale_epoch
from ..quantities.other_units import CELSIUS, SECONDS, find_said_unit, write_unit
from ..quantities.point_times import (
    DATE_WORDS,
    MIN_EPOCH,
    find_date_column,
    holds_epoch,
    read_clock,
)
from ..quantities.point_times import TIME_WORDS as CLOCK_WORDS
from .column_guesses import Reading
from .uncausal_columns import UNCERTAINTY_WORDS, find_uncertainties

TARGET_WORDS = frozenset[str]().union(
    ("target", "reflector", "smr", "prism", "reflektor", "kugel", "sphere", "marker")
)
GROUP_WORDS = frozenset(("group", "session", "day", "trajectory", "series", "gruppe", "serie"))
PAYLOAD_WORDS = frozenset(("payload", "load", "nutzlast", "last", "traglast"))
TIME_WORDS = frozenset(("time", "timestamp", "zeit", "t"))
# words of standard uncertainties; the others may be expanded ones
STANDARD_WORDS = UNCERTAINTY_WORDS - {"u", "u95", "unc", "uncertainty", "unsicherheit"} | {
    "sx",
    "sy",
    "sz",
}
MAX_TARGETS = 12
# seconds by which two clocks of one moment may differ
SAME_MOMENT = 1.0
# rows per group, at least
MIN_GROUP_ROWS = 4
# columns of the log that Universal Robots' controllers write, with seconds since their start
UR_CLOCK = "timestamp"
UR_COLUMNS = {"actual_q_0", "target_q_0"}
# °C in which people work
ROOM_CELSIUS = (-10.0, 60.0)


def guess_optional_columns(table: Table, taken: Collection[str]) -> list[Reading]:
    """Guess the optional columns among those that are not `taken` already."""
    names = [
        parse_column_name(name, table.units.get(name))
        for name in table.columns
        if name not in taken
    ]
    guesses = {
        "target": _find_labels(table, names, TARGET_WORDS, MAX_TARGETS),
        "group": _find_labels(table, names, GROUP_WORDS, len(table) // MIN_GROUP_ROWS),
        "temperature_C": _find_temperature(table, names),
        "payload_kg": _find_number(table, names, PAYLOAD_WORDS, "kg"),
        "time_s": _find_time(table, names) or _find_clock(table, names),
    }
    words = {"target": "reflectors", "group": "groups"}
    readings = []
    for wanted, found in guesses.items():
        if wanted not in table and len(found) == 1:
            given = found[0].given
            date = find_date_column(table, given) if wanted == "time_s" else None
            dated = "" if date is None else f' with "{date}"'
            said = f'"{given}"{dated} as {words.get(wanted, wanted)}'
            readings.append(Reading({wanted: given}, said, _describe(table, found[0])))
    return [*readings, *_read_uncertainties(table, names)]


def _read_uncertainties(table: Table, names: Sequence[ColumnName]) -> list[Reading]:
    """Read three standard uncertainties of the coordinates, above zero, where all say one unit of
    length; expanded ones (U95) are none."""
    standard = [name for name in names if name.words <= STANDARD_WORDS]
    given = find_uncertainties(standard)
    is_there = any(name in table for name in UNCERTAINTY_COLUMNS)
    if is_there or len(given) != len(UNCERTAINTY_COLUMNS):
        return []
    values = [convert_to_numbers(table.columns[name]) for name in given]
    is_positive = np.stack(values) > 0
    units = {find_said_unit(name, table.units.get(name), LENGTHS) for name in given}
    unit = units.pop()
    if units or not unit or not is_positive.all():
        return []
    columns = dict(zip(UNCERTAINTY_COLUMNS, given, strict=True))
    listed = " ".join(given)
    reading = Reading(columns, f'"{listed}" as {" ".join(UNCERTAINTY_COLUMNS)}')
    return [reading]


def _find_labels(
    table: Table, names: Sequence[ColumnName], words: frozenset[str], most: int
) -> list[ColumnName]:
    """Find columns of a few names that repeat, without empty cells: text or whole numbers, and of no
    other quantity, as "Mean Marker Error" is."""
    found = []
    for name in names:
        column = table.columns[name.given]
        is_blank = find_blank_cells(column)
        is_called = name.words & words and not name.words & OTHER_QUANTITIES
        if is_blank.any() or not is_called or _holds_fractions(column):
            continue
        different = {str(cell) for cell in column}
        if 1 <= len(different) <= most:
            found.append(name)
    return found


def _holds_fractions(cells: NDArray[Any]) -> bool:
    """Whether some cell is a number that is not whole."""
    values = convert_to_numbers(cells)
    numbers = values[np.isfinite(values)]
    parts = numbers % 1
    return bool(parts.any())


def _find_number(
    table: Table, names: Sequence[ColumnName], words: frozenset[str], unit: str
) -> list[ColumnName]:
    """Find columns of numbers whose name says the quantity and the unit."""
    return [
        name
        for name in names
        if name.words & words and name.unit == unit and _is_complete(table, name.given)
    ]


def _find_converted(
    table: Table, names: Sequence[ColumnName], words: frozenset[str], sizes: Collection[str]
) -> list[ColumnName]:
    """Find columns of numbers whose name says the quantity, and a unit that is converted."""
    found = []
    for name in _find_number(table, names, words, ""):
        row_of_units = table.units.get(name.given)
        said = find_said_unit(name.given, row_of_units, sizes)
        if said:
            found.append(name)
    return found


def _find_temperature(table: Table, names: Sequence[ColumnName]) -> list[ColumnName]:
    """Find columns of temperatures in °C, °F or kelvin, by the unit, or by values that rooms
    have."""
    found = _find_number(table, names, CELSIUS_WORDS, "C")
    found += _find_converted(table, names, CELSIUS_WORDS, CELSIUS)
    for name in names:
        if name.words & TEMPERATURE_WORDS and name.unit is None and _is_complete(table, name.given):
            values = convert_to_numbers(table.columns[name.given])
            low, high = ROOM_CELSIUS
            found += [name] if ((values > low) & (values < high)).all() else []
    return found or _find_celsius(table, names)


def _find_celsius(table: Table, names: Sequence[ColumnName]) -> list[ColumnName]:
    """Find columns of any name that are in °C."""
    in_celsius = [name for name in names if name.unit == "C"]
    return [name for name in in_celsius if _is_complete(table, name.given)]


def _find_time(table: Table, names: Sequence[ColumnName]) -> list[ColumnName]:
    """Find columns of seconds, or another unit of time, that never go back; without a unit, times
    since 1970, and the clock of a UR's log."""
    found = _find_number(table, names, TIME_WORDS, "s")
    bare = [name for name in names if name.unit is None]
    for name in bare:
        cells = table.columns[name.given]
        is_called = name.words & CLOCK_WORDS
        is_of_ur = name.given == UR_CLOCK and _is_ur_log(table)
        if is_called and (is_of_ur or holds_epoch(cells)):
            found.append(name)
    found += _find_converted(table, names, TIME_WORDS, SECONDS)
    clocks = []
    for name in found:
        cells = table.columns[name.given]
        values = convert_to_numbers(cells)
        steps = np.diff(values)
        if (steps >= 0).all():
            clocks.append(name)
    return _keep_one_clock(table, clocks)


def _is_ur_log(table: Table) -> bool:
    """Whether columns are called as in the log of a controller of Universal Robots."""
    return any(name in UR_COLUMNS for name in table.columns)


def _keep_one_clock(table: Table, found: list[ColumnName]) -> list[ColumnName]:
    """Keep the first of several times since 1970 that are one, as of a message and of its receipt."""
    times = []
    for name in found:
        cells = table.columns[name.given]
        if not holds_epoch(cells):
            return found
        values = convert_to_numbers(cells)
        times.append(scale_epoch(values))
    for other in times[1:]:
        difference = np.abs(other - times[0])
        if difference.max() > SAME_MOMENT:
            return found
    return found[:1]


def _find_clock(table: Table, names: Sequence[ColumnName]) -> list[ColumnName]:
    """Find columns of times of the clock that never go back."""
    found = []
    for name in names:
        is_called = name.words & (CLOCK_WORDS | DATE_WORDS)
        seconds = read_clock(table, name.given) if is_called else None
        if seconds is None:
            continue
        steps = np.diff(seconds)
        if len(steps) and steps.min() >= 0:
            found.append(name)
    return found


def _is_complete(table: Table, name: str) -> bool:
    values = convert_to_numbers(table.columns[name])
    if not len(values):
        return False
    is_finite = np.isfinite(values)
    return bool(is_finite.all())


def _describe(table: Table, parsed: ColumnName) -> str:
    """Describe a column's values: how far they go, in the unit that it says where another is read,
    or how many there are."""
    name = parsed.given
    column = table.columns[name]
    values = convert_to_numbers(column)
    seconds = read_clock(table, name)
    if seconds is not None:
        last = seconds.max() - seconds.min()
        return f"0 to {last:.0f} s from the first row on"
    if not np.isfinite(values).all():
        different = {str(cell) for cell in column}
        return f"{len(different)} different"
    said = list_units(name, table.units.get(name)) if parsed.unit == "" else []
    size, _ = SECONDS.get(said[0] if said else "", (1.0, 0.0))
    times = scale_epoch(values * size)
    first = times.min()
    if parsed.words & CLOCK_WORDS and first > MIN_EPOCH:
        return f"0 to {times.max() - first:.0f} s from the first row on"
    unit = "".join(f" {write_unit(word)}" for word in said[:1])
    low = values.min()
    high = values.max()
    return f"{low:.4g} to {high:.4g}{unit}"
