"""Names for the columns of a table without header, as Spatial Analyzer and many controllers write
them: names, then three coordinates or as many readings as the arm has joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...exceptions import one_line
from ..formats.table import Table, apply_stated_unit
from ..quantities.columns import convert_to_numbers
from ..quantities.point_times import are_clock_times

COORDINATES = ("X", "Y", "Z")
# names that a message shows
MAX_NAMES = 3


def name_columns(table: Table, joints: int) -> Table:
    """Name the columns of a table without header. Raises DataError where they are neither the
    coordinates of points nor the readings of so many joints."""
    if not is_headerless(table):
        return table
    numbers, renamed = _sort_columns(table)
    called = {3: COORDINATES, joints: _number_joints(joints)}
    if joints == len(COORDINATES) or len(numbers) not in called:
        raise table.where.refuse(
            f"there is no header, and {len(numbers)} columns of numbers are neither X, Y, Z nor "
            f"the readings of {joints} joints for certain.",
            remedy="Write the columns' names in a line above them.",
        )
    renamed |= dict(zip(numbers, called[len(numbers)], strict=True))
    return _rename(table, renamed)


def list_orders(table: Table, joints: int) -> list[Table]:
    """List the tables that one without header may be, of readings and points together: readings
    first, then coordinates, and the other way round. Raises DataError where there are more or fewer
    columns of numbers."""
    numbers, renamed = _sort_columns(table)
    readings = _number_joints(joints)
    if len(numbers) != joints + len(COORDINATES):
        _refuse_transposed(table, numbers)
        raise table.where.refuse(
            f"there is no header, and {len(numbers)} columns of numbers are not the readings of "
            f"{joints} joints with X, Y and Z.",
            remedy="Write the columns' names in a line above them: q1_deg, …, x_mm, y_mm, z_mm.",
        )
    tables = []
    for order in (readings + COORDINATES, COORDINATES + readings):
        called = dict(zip(numbers, order, strict=True))
        named = _rename(table, renamed | called)
        tables.append(named)
    return tables


def _refuse_transposed(table: Table, numbers: Sequence[str]) -> None:
    """Refuse a table whose rows are what its columns should be. Raises DataError."""
    first = next(iter(table.columns))
    if first in numbers or len(table) >= len(numbers):
        return
    names = [f'"{one_line(str(cell))}"' for cell in table.columns[first][:MAX_NAMES]]
    raise table.where.refuse(
        f"the names stand in the first column ({', '.join(names)} …), and every column is a point.",
        remedy="Exchange rows and columns: Paste Special, Transpose in a spreadsheet program.",
    )


def is_headerless(table: Table) -> bool:
    """Whether a table's columns are numbered, for want of a header."""
    return all(name.startswith("column ") for name in table.columns)


def _number_joints(joints: int) -> tuple[str, ...]:
    numbers = range(1, joints + 1)
    return tuple(f"J{number}" for number in numbers)


def _rename(table: Table, renamed: Mapping[str, str]) -> Table:
    columns = {}
    for name, cells in table.columns.items():
        columns[renamed[name]] = cells
    return apply_stated_unit(replace(table, columns=columns))


def _sort_columns(table: Table) -> tuple[list[str], dict[str, str]]:
    """Sort columns into (those of numbers, what to call the others)."""
    names, numbers, times = list[str](), list[str](), list[str]()
    for name, cells in table.columns.items():
        values = convert_to_numbers(cells)
        is_number = np.isfinite(values).all()
        is_whole = np.array_equal(values, np.round(values))
        is_name = is_whole and not numbers
        if are_clock_times(cells):
            times.append(name)
        elif is_number and not is_name:
            numbers.append(name)
        else:
            names.append(name)
    renamed = {name: _number_name(k, len(names)) for k, name in enumerate(names, 1)}
    renamed |= {name: f"time {k}" if k else "time" for k, name in enumerate(times)}
    return numbers, renamed


def _number_name(number: int, count: int) -> str:
    """Call the last column of names the point's; collection and group stand before it."""
    if number == count:
        return "point"
    return f"name {number}"
