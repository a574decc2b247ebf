"""Names for the columns of a table without header, as Spatial Analyzer and many controllers write
them: names, then three coordinates or as many readings as the arm has joints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .columns import convert_to_numbers
from .point_times import are_clock_times
from .table import Table

COORDINATES = ("X", "Y", "Z")


def name_columns(table: Table, joints: int) -> Table:
    """Name the columns of a table without header. Raises DataError where they are neither the
    coordinates of points nor the readings of so many joints."""
    if not all(name.startswith("column ") for name in table.columns):
        return table
    names, numbers, times = list[str](), list[str](), list[str]()
    for name, cells in table.columns.items():
        values = convert_to_numbers(cells)
        is_number = bool(np.isfinite(values).all())
        is_whole = is_number and bool((values == np.round(values)).all())
        is_first = not numbers
        if are_clock_times(cells):
            times.append(name)
        elif not is_number or (is_whole and is_first):
            names.append(name)
        else:
            numbers.append(name)
    called = {3: COORDINATES, joints: tuple(f"J{k}" for k in range(1, joints + 1))}
    if joints == len(COORDINATES) or len(numbers) not in called:
        raise table.where.refuse(
            f"there is no header, and {len(numbers)} columns of numbers are neither X, Y, Z nor "
            f"the readings of {joints} joints for certain.",
            remedy="Write the columns' names in a line above them.",
        )
    renamed = dict(zip(numbers, called[len(numbers)], strict=True))
    renamed |= {name: _number_name(k, len(names)) for k, name in enumerate(names, 1)}
    renamed |= {name: f"time {k}" if k else "time" for k, name in enumerate(times)}
    columns = {renamed[name]: cells for name, cells in table.columns.items()}
    return replace(table, columns=columns)


def _number_name(number: int, count: int) -> str:
    """Call the last column of names the point's; collection and group stand before it."""
    return "point" if number == count else f"name {number}"
