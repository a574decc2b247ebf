"""Times since 1970 in milliseconds, microseconds or nanoseconds, as controllers, databases and ROS
write them, as seconds."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._typing import Array
from ...notices import Note
from ..formats.table import Table
from .columns import convert_to_numbers

# seconds since 1970 of the years 2000 to 2100: ticks of other beginnings lie outside
FIRST_SECOND = 9.4e8
LAST_SECOND = 4.2e9
# units that differ by more than these years do, and how many are a second
EPOCH_UNITS = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}


def find_epoch_unit(values: Array) -> str | None:
    """Find the unit, smaller than a second, of times since 1970; None where they are none."""
    if not len(values):
        return None
    first = values.min()
    last = values.max()
    for unit, size in EPOCH_UNITS.items():
        if FIRST_SECOND * size < first <= last < LAST_SECOND * size:
            return unit
    return None


def scale_epoch(values: Array) -> Array:
    """Return times since 1970 in seconds; other values as they are."""
    unit = find_epoch_unit(values)
    if unit is None:
        return values
    size = EPOCH_UNITS[unit]
    return np.asarray(values / size)


def holds_small_epoch(cells: NDArray[Any]) -> bool:
    """Whether all cells are times since 1970 in a unit smaller than a second."""
    values = convert_to_numbers(cells)
    return find_epoch_unit(values) is not None


def convert_epoch(table: Table) -> tuple[Table, list[Note]]:
    """Convert `time_s` to seconds where it holds times since 1970 in a smaller unit, and say so."""
    if "time_s" not in table:
        return table, []
    values = convert_to_numbers(table.columns["time_s"])
    unit = find_epoch_unit(values)
    if unit is None:
        return table, []
    columns = dict(table.columns)
    columns["time_s"] = scale_epoch(values)
    name = table.where.names.get("time_s", "time_s")
    sentence = f'Converted: "{name}", {unit} since 1970, to s.'
    note = Note("units-converted", sentence)
    return replace(table, columns=columns), [note]
