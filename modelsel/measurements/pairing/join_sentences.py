"""What is said of two tables that were joined: how, the rows without a partner, shots repeated, what
the clocks and the points at the start and the end tell."""

from __future__ import annotations

import numpy as np

from ..._typing import Array, Index
from ...exceptions import write_rounded
from ..formats.column_names import parse_column_name
from ..formats.table import Table
from ..quantities.columns import convert_to_numbers
from ..quantities.point_times import find_times
from ..quantities.row_labels import MAX_LISTED, label_rows
from .joined_blanks import MAX_BLANK_SHARE
from .joining import COORDINATES, Join, list_dropped_columns, list_name_columns
from .leftover_points import describe_drift

# s: a smaller difference between two clocks is not said
MIN_CLOCK_DIFFERENCE = 1.0


def describe_join(points: Table, log: Table, join: Join, max_gap: float) -> list[str]:
    """Say how two tables were joined, and which rows of the points, and of the log, have no
    partner; `max_gap`: seconds that the times of a point and of its readings may differ."""
    count = len(points)
    all_points = np.arange(count)
    alone = np.setdiff1d(all_points, join.points)
    matched = count - len(alone)
    said = [f"Joined {join.words}: {matched:,} of {count:,} points."]
    said += _describe_repeats(points, join)
    if len(alone):
        listed = _list_rows(points, alone)
        said.append(f"Points without joint readings: {listed}.")
        said += _describe_drift(points, alone)
    readings = len(log)
    all_readings = np.arange(readings)
    unused = np.setdiff1d(all_readings, join.log)
    is_dense = join.way == "time"
    if len(unused) and not is_dense:
        listed = _list_rows(log, unused)
        said.append(f"Joint readings without a point: {listed}.")
    if join.way == "name":
        said += _describe_clocks(points, log, join, max_gap)
    dropped = ", ".join(list_dropped_columns(log))
    if dropped:
        said.append(f"Left out of {log.where.file}, the controller's own coordinates: {dropped}.")
    return said


def _describe_repeats(points: Table, join: Join) -> list[str]:
    """Say which points were shot again, and that they have the readings of the first shot."""
    if not join.repeated:
        return []
    rows = np.array(join.repeated, np.intp)
    listed = _list_rows(points, rows)
    what = "a repeated shot"
    if len(rows) > 1:
        what = "repeated shots"
    said = (
        f"Taken for {what}, with the joint readings of the point of the same name without the "
        f"suffix: {listed}. Every shot is a row of its own."
    )
    return [said]


def _list_rows(table: Table, rows: Index) -> str:
    """List rows by the names of their points, and by their lines."""
    where = table.where
    spans = where.spans(rows, MAX_LISTED)
    place = f"{where.file}, {spans}"
    columns = list_name_columns(table, MAX_BLANK_SHARE)
    labels = label_rows(columns.values(), rows)
    return f"{labels} ({place})" if labels else place


def _describe_drift(points: Table, rows: Index) -> list[str]:
    """Say how far fixed points moved that were measured at the start and at the end."""
    coordinates = []
    for axis in COORDINATES:
        values = _read_axis(points, axis)
        if values is None:
            return []
        coordinates.append(values)
    position = np.stack(coordinates, 1)
    for cells in list_name_columns(points).values():
        names = [str(cell) for cell in cells]
        said = describe_drift(names, position, rows)
        if said:
            return said
    return []


def _read_axis(points: Table, axis: str) -> Array | None:
    """Read a coordinate (m,) of the measured points, in mm; None where its unit is another, or
    several columns may be it."""
    named = [parse_column_name(name, points.units.get(name)) for name in points.columns]
    found = [name for name in named if name.quantity == axis]
    measured = [name for name in found if name.is_measured]
    chosen = measured or found
    if len(chosen) != 1:
        return None
    only = chosen[0]
    if only.unit != "mm":
        return None
    return convert_to_numbers(points.columns[only.given])


def _describe_clocks(points: Table, log: Table, join: Join, max_gap: float) -> list[str]:
    """Say by how much the clocks of two files differ that were joined by names."""
    of_points = find_times(points)
    of_log = find_times(log)
    if of_points is None or of_log is None:
        return []
    if not (of_points.dated and of_log.dated):
        return []
    difference = of_log.seconds[join.log] - of_points.seconds[join.points]
    middle = float(np.median(difference))
    spread = float(np.median(np.abs(difference - middle)))
    size = abs(middle)
    least = max(max_gap, MIN_CLOCK_DIFFERENCE, spread)
    if size <= least:
        return []
    way = "behind"
    if middle > 0:
        way = "ahead of"
    said = (
        f"The joint log's clock is {write_rounded(size)} s {way} the instrument's (median of the pairs, half of "
        f"them within {write_rounded(spread, 2)} s of it): joined by name, the points do not need it."
    )
    return [said]
