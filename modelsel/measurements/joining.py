"""Join the points that an instrument measured with a log of joint readings: by the points' names, by
nearest time, or by the order of the rows. What does not match is said."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .._typing import Array, Index
from ..exceptions import DataError
from .column_names import MEASURED, parse_column_name
from .columns import convert_to_numbers, find_blank_cells, read_numbers
from .point_times import DATE_WORDS, TIME_WORDS, are_clock_times, find_times
from .row_places import Where
from .table import Table

WAYS = ("name", "time", "order")
# share of the points that a way must match
MIN_SHARE = 0.5
# different names that a column must match
MIN_NAMES = 4
# points that a sentence lists
MAX_LISTED = 8
MAX_REFLECTORS = 12
# share of the positions' range that reflectors on one flange are apart, at least
MIN_APART = 2e-3
LETTERS_BEFORE = re.compile(r"^\D*0*(?=\d)")
DAY_SECONDS = 86400.0
COORDINATES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class Join:
    """A way to join: rows of the points and, as many, of the log; in words."""

    way: str
    points: Index
    log: Index
    words: str

    def is_like(self, other: Join) -> bool:
        """Whether two ways join the same rows."""
        return np.array_equal(self.points, other.points) and np.array_equal(self.log, other.log)


def find_joins(points: Table, log: Table, max_gap: float) -> tuple[dict[str, Join], dict[str, str]]:
    """Find the ways that join two tables, and why others do not; `max_gap`: seconds that the time
    of a point and that of its readings may differ."""
    by_name = _join_by_name(points, log)
    by_time = _join_by_time(points, log, max_gap)
    by_order = _join_by_order(points, log)
    joins, reasons = {}, {}
    for way, found in zip(WAYS, (by_name, by_time, by_order), strict=True):
        if isinstance(found, Join):
            joins[way] = found
        else:
            reasons[way] = found
    return joins, reasons


def join_tables(points: Table, log: Table, join: Join) -> Table:
    """Join two tables, a row per matched point in the order of the log; columns that both have are
    the instrument's. Raises DataError for a coordinate that is no number, with the line of its own
    file."""
    _check_coordinates(points)
    order = np.lexsort((join.points, join.log))
    at_points, at_log = join.points[order], join.log[order]
    dropped = list_dropped_columns(log)
    columns = {name: cells[at_log] for name, cells in log.columns.items() if name not in dropped}
    columns |= {name: cells[at_points] for name, cells in points.columns.items()}
    units = {**log.units, **points.units}
    lines = np.array([log.where.number(int(row)) for row in at_log], np.intp)
    where = replace(log.where, at=lines)
    return Table(columns, where, units, (*points.notes, *log.notes))


def find_reflectors(joined: Table, readings: Index) -> str | None:
    """Find the column that tells reflectors apart, where rows share their readings (the same number
    in `readings`, (m,)) and stand apart; None where there is none."""
    if len(np.unique(readings)) == len(readings):
        return None
    position = np.stack([_read_coordinate(joined, axis) for axis in COORDINATES], 1)
    for name, cells in joined.columns.items():
        labels = [str(cell) for cell in cells]
        if not 1 < len(set(labels)) <= MAX_REFLECTORS or find_blank_cells(cells).any():
            continue
        pairs = set(zip(readings.tolist(), labels, strict=True))
        if len(pairs) == len(labels) and _stand_apart(position, readings):
            return name
    return None


def _read_coordinate(joined: Table, axis: str) -> Array:
    named = [name for name in joined.columns if parse_column_name(name).quantity == axis]
    measured = [name for name in named if parse_column_name(name).is_measured]
    chosen = (measured or named or [""])[0]
    return convert_to_numbers(joined.columns[chosen]) if chosen else np.zeros(len(joined))


def _stand_apart(position: Array, readings: Index) -> bool:
    """Whether rows of the same readings are further apart than an arm that comes again."""
    order = np.argsort(readings, kind="stable")
    same = readings[order][1:] == readings[order][:-1]
    apart = np.abs(np.diff(position[order], axis=0)).max(axis=1)[same]
    return bool(np.median(apart) > MIN_APART * np.ptp(position))


def list_dropped_columns(log: Table) -> list[str]:
    """List the coordinates of a log: the controller's own, not the instrument's."""
    return [name for name in log.columns if parse_column_name(name).quantity in COORDINATES]


def describe_unmatched(points: Table, log: Table, join: Join) -> list[str]:
    """Say which rows of the points, and of the log, have no partner."""
    said = [f"Joined {join.words}: {len(np.unique(join.points))} of {len(points)} points."]
    alone = np.setdiff1d(np.arange(len(points)), join.points)
    if len(alone):
        said.append(f"Points without joint readings: {_list_rows(points.where, alone)}.")
    unused = np.setdiff1d(np.arange(len(log)), join.log)
    if len(unused) and join.way != "time":
        said.append(f"Joint readings without a point: {_list_rows(log.where, unused)}.")
    dropped = ", ".join(list_dropped_columns(log))
    if dropped:
        said.append(f"Left out of {log.where.file}, the controller's own coordinates: {dropped}.")
    return said


def _list_rows(where: Where, rows: Index) -> str:
    return f"{where.file}, {where.spans(rows, MAX_LISTED)}"


def _check_coordinates(points: Table) -> None:
    for name in points.columns:
        parsed = parse_column_name(name)
        other_words = parsed.words - MEASURED
        is_coordinate = parsed.quantity in COORDINATES
        if is_coordinate and not other_words:
            read_numbers(points, name)


# -- by name
# --------------------------------------------------------------------------------------------


def _join_by_name(points: Table, log: Table) -> Join | str:
    """Join by the pair of columns that have most names in common."""
    for shorten in (_squeeze_name, _keep_number):
        matches = [
            (len(np.unique(pairs[1])), name, other, pairs)
            for name, cells in _list_names(points).items()
            for other, readings in _list_names(log).items()
            if (pairs := _match_names(cells, readings, shorten)) is not None
            and len(pairs[0]) >= MIN_SHARE * len(points)
            and len(np.unique(pairs[1])) >= MIN_NAMES
        ]
        if matches:
            _, name, other, (rows, partners) = max(matches, key=lambda match: match[0])
            return Join("name", rows, partners, f'by name ("{name}" = "{other}")')
    return "no column of names has half of the points in common with one of the joint log"


def _list_names(table: Table) -> dict[str, Any]:
    """List the columns that may be names of points."""
    found = {}
    for name, cells in table.columns.items():
        parsed = parse_column_name(name)
        is_quantity = parsed.quantity is not None
        is_time = parsed.words & (TIME_WORDS | DATE_WORDS)
        if is_quantity or is_time:
            continue
        if _holds_names(cells):
            found[name] = cells
    return found


def _holds_names(cells: Any) -> bool:
    """Whether cells may be names: filled, and text other than times, or whole numbers."""
    if not len(cells) or are_clock_times(cells):
        return False
    if find_blank_cells(cells).any():
        return False
    values = convert_to_numbers(cells)
    is_number = np.isfinite(values)
    numbers = values[is_number]
    whole = np.round(numbers)
    return bool(np.array_equal(numbers, whole))


def _squeeze_name(cell: Any) -> str:
    """Write a name without what differs between programs: capitals, the collection and group that
    stand before it."""
    text = str(cell).strip().rpartition("::")[2].casefold()
    return text.removesuffix(".0")


def _keep_number(cell: Any) -> str:
    """Write a name without the letters and zeros before its number: P007 and 7 are one."""
    return LETTERS_BEFORE.sub("", _squeeze_name(cell))


def _match_names(cells: Any, readings: Any, shorten: Any) -> tuple[Index, Index] | None:
    """Match names (rows of the points, rows of the log); None where the log has a name twice."""
    keys = [shorten(cell) for cell in readings]
    if max(Counter(keys).values()) > 1:
        return None
    place = {key: row for row, key in enumerate(keys)}
    found = [(row, place.get(shorten(cell))) for row, cell in enumerate(cells)]
    pairs = [(row, partner) for row, partner in found if partner is not None]
    matched = np.array(pairs, np.intp).reshape(-1, 2)
    return matched[:, 0], matched[:, 1]


# -- by time and by order
# --------------------------------------------------------------------------------------------


def _join_by_time(points: Table, log: Table, max_gap: float) -> Join | str:
    """Join every point with the readings of the nearest time."""
    times, readings = find_times(points), find_times(log)
    if times is None or readings is None:
        lacking = points if times is None else log
        return f"{lacking.where.file} has no column of times"
    if times.absolute != readings.absolute:
        return "one file has the time of day, the other a time that begins at zero"
    both_dated = times.dated and readings.dated
    of_points, of_log = (
        each.seconds if both_dated or not each.absolute else each.seconds % DAY_SECONDS
        for each in (times, readings)
    )
    order = np.argsort(of_log, kind="stable")
    nearest = order[_find_nearest(of_log[order], of_points)]
    gap = np.abs(of_log[nearest] - of_points)
    close = np.flatnonzero(gap <= max_gap)
    if len(close) < MIN_SHARE * len(points):
        return (
            f"{len(close)} of {len(points)} points have readings within {max_gap:g} s; the median "
            f"gap is {np.median(gap):.3g} s (--max-gap, if the clocks differ by less)"
        )
    largest = float(gap[close].max())
    words = (
        f'by nearest time ("{times.column}" and "{readings.column}", {largest:.3g} s apart at most)'
    )
    return Join("time", close, nearest[close], words)


def _find_nearest(sorted_times: Array, times: Array) -> Index:
    after = np.clip(np.searchsorted(sorted_times, times), 1, max(len(sorted_times) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(sorted_times) - 1)
    is_before = times - sorted_times[before] <= sorted_times[after] - times
    return np.asarray(np.where(is_before, before, after), np.intp)


def _join_by_order(points: Table, log: Table) -> Join | str:
    """Join row by row, where both have as many."""
    if len(points) != len(log):
        return f"{len(points)} points and {len(log)} rows of joint readings are not as many"
    rows = np.arange(len(points))
    return Join("order", rows, rows, "row by row, in their order")


def refuse_join(
    points: Table, log: Table, reasons: Mapping[str, str], ways: Sequence[str]
) -> DataError:
    """Return the error of two files that no way, or not the wanted one, joins."""
    listed = "; ".join(f"by {way}: {reasons[way]}" for way in ways if way in reasons)
    return DataError(
        f"the points cannot be joined with {log.where.file}: {listed}.",
        file=points.where.file,
        remedy="Give both files a column of point names or of times, or as many rows.",
    )
