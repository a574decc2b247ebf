"""Join the points that an instrument measured with a log of joint readings: by the points' names, by
nearest time, or by the order of the rows. What does not match is said."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..._typing import Array, Index
from ...exceptions import DataError, write_rounded
from ..formats.column_names import parse_column_name
from ..formats.table import Table
from ..quantities.columns import convert_to_numbers, find_blank_cells
from ..quantities.point_times import DATE_WORDS, TIME_WORDS, find_common_seconds, find_times
from .clock_offset import find_clock_offset, write_seconds
from .joined_blanks import MAX_BLANK_SHARE, check_coordinates
from .matched_names import keep_number, may_be_names, pair_names, squeeze_name
from .nearest_times import find_nearest_times, read_clocks

WAYS = ("name", "time", "order")
# share of the points that a way must match
MIN_SHARE = 0.5
# different names that a column must match
MIN_NAMES = 4
MAX_REFLECTORS = 12
# share of the positions' range that reflectors on one flange are apart, at least
MIN_APART = 2e-3
COORDINATES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class Join:
    """A way to join: rows of the points and, as many, of the log; in words; rows of the points that
    are `repeated` shots of others; `key`: the log's column of names; `blank`: whether some rows have no
    partner for want of a time."""

    way: str
    points: Index
    log: Index
    words: str
    repeated: tuple[int, ...] = ()
    key: str = ""
    blank: bool = False

    def is_like(self, other: Join) -> bool:
        """Whether two ways join the same rows."""
        points = other.points
        log = other.log
        has_points = np.array_equal(self.points, points)
        has_log = np.array_equal(self.log, log)
        return has_points and has_log

    def is_within(self, other: Join) -> bool:
        """Whether another way joins these rows, and more."""
        points = self.points.tolist()
        log = self.log.tolist()
        own = set(zip(points, log, strict=True))
        more_points = other.points.tolist()
        more_log = other.log.tolist()
        others = set(zip(more_points, more_log, strict=True))
        return own <= others


def find_joins(
    points: Table, log: Table, max_gap: float, clock_offset: float = 0.0
) -> tuple[dict[str, Join], dict[str, str]]:
    """Find the ways that join two tables, and why others do not; `max_gap`: seconds that the time
    of a point and that of its readings may differ; `clock_offset`: seconds by which the log's clock is
    ahead."""
    by_name = _join_by_name(points, log)
    by_time = _join_by_time(points, log, max_gap, clock_offset)
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
    check_coordinates(points)
    order = np.lexsort((join.points, join.log))
    at_points = join.points[order]
    at_log = join.log[order]
    dropped = list_dropped_columns(log)
    columns = {}
    for name, cells in log.columns.items():
        if name not in dropped:
            columns[name] = cells[at_log]
    for name, cells in points.columns.items():
        columns[name] = cells[at_points]
    seconds = find_common_seconds(points, log)
    if seconds is not None and "time_s" not in columns:
        columns["time_s"] = seconds[at_points]
    units = {**log.units, **points.units}
    of_points = points.where.take(at_points)
    parts = dict.fromkeys(points.columns, of_points)
    where = replace(log.where.take(at_log), parts=parts)
    notes = (*points.notes, *log.notes)
    return Table(columns, where, units, notes)


def find_reflectors(joined: Table, readings: Index) -> str | None:
    """Find the column that tells reflectors apart, where rows share their readings (the same number
    in `readings`, (m,)) and stand apart; None where there is none."""
    distinct = np.unique(readings)
    if len(distinct) == len(readings):
        return None
    coordinates = [_read_coordinate(joined, axis) for axis in COORDINATES]
    position = np.stack(coordinates, 1)
    if not _stand_apart(position, readings):
        return None
    for name, cells in joined.columns.items():
        labels = [str(cell) for cell in cells]
        different = set(labels)
        count = len(different)
        is_blank = find_blank_cells(cells).any()
        if is_blank or not 1 < count <= MAX_REFLECTORS:
            continue
        pairs = zip(readings.tolist(), labels, strict=True)
        if len(set(pairs)) == len(labels):
            return name
    return None


def _read_coordinate(joined: Table, axis: str) -> Array:
    columns = joined.columns
    parsed = map(parse_column_name, columns)
    named = [name for name in parsed if name.quantity == axis]
    measured = [name for name in named if name.is_measured]
    chosen = measured or named
    if not chosen:
        count = len(joined)
        return np.zeros(count)
    first = chosen[0]
    column = columns[first.given]
    return convert_to_numbers(column)


def _stand_apart(position: Array, readings: Index) -> bool:
    """Whether rows of the same readings are further apart than an arm that comes again."""
    order = np.argsort(readings, kind="stable")
    same = np.diff(readings[order]) == 0
    steps = np.diff(position[order], axis=0)
    apart = np.abs(steps).max(axis=1)
    typical = np.median(apart[same])
    extent = np.ptp(position)
    return bool(typical > MIN_APART * extent)


def list_dropped_columns(log: Table) -> list[str]:
    """List the coordinates of a log: the controller's own, not the instrument's."""
    parsed = [parse_column_name(name) for name in log.columns]
    coordinates = [name for name in parsed if name.quantity in COORDINATES]
    return [name.given for name in coordinates]


def refuse_swapped(points: Table, log: Table) -> DataError | None:
    """Return the error of two files that are each in the other's place; None where they are not."""
    of_points = {parse_column_name(name).quantity for name in points.columns}
    of_log = {parse_column_name(name).quantity for name in log.columns}
    has_coordinates = of_log >= set(COORDINATES)
    if "joint" not in of_points or "joint" in of_log or not has_coordinates:
        return None
    first, second = log.where.file, points.where.file
    return DataError(
        f"it holds joint readings, and {first} coordinates without joint readings: the files look "
        "swapped.",
        file=second,
        remedy=f"Give them the other way round: {first}, and --joints {second}.",
    )


# -- by name
# --------------------------------------------------------------------------------------------


def _join_by_name(points: Table, log: Table) -> Join | str:
    """Join by the pair of columns that have most names in common."""
    for shorten in (squeeze_name, keep_number):
        best, most = None, MIN_NAMES - 1
        for name, cells in list_name_columns(points, MAX_BLANK_SHARE).items():
            for other, readings in list_name_columns(log, MAX_BLANK_SHARE).items():
                rows, partners, repeated = pair_names(cells, readings, shorten)
                different = np.unique(partners)
                distinct = len(different)
                least = MIN_SHARE * len(points)
                is_enough = len(rows) >= least
                if is_enough and distinct > most:
                    words = f'by name ("{name}" = "{other}")'
                    best = Join("name", rows, partners, words, repeated, other)
                    most = distinct
        if best is not None:
            return best
    return _describe_names(points, log)


def _describe_names(points: Table, log: Table) -> str:
    """Say which columns of names were compared, and why none joins."""
    best, said = (-1, 0), "one of the files has no column of names that is filled"
    for name, cells in list_name_columns(points, MAX_BLANK_SHARE).items():
        keys = [squeeze_name(cell) for cell in cells[~find_blank_cells(cells)]]
        for other, readings in list_name_columns(log, MAX_BLANK_SHARE).items():
            partners = Counter(map(squeeze_name, readings[~find_blank_cells(readings)]))
            common = sum(key in partners for key in keys)
            rank = (common, len(set(keys)))
            if rank <= best:
                continue
            best = rank
            said = f'"{name}" and "{other}" have {common} of {len(keys)} points in common'
            key, times = partners.most_common(1)[0]
            if times > 1:
                said += f', but "{key}" stands {times} times in {log.where.file}'
    return said


def find_repeated_reading(points: Table, log: Table) -> str | None:
    """Say which name the log has twice where most points have one of its names, and most of them
    once; None where names do not join for another reason."""
    for cells in list_name_columns(points, MAX_BLANK_SHARE).values():
        keys = {squeeze_name(cell) for cell in cells[~find_blank_cells(cells)]}
        for other, readings in list_name_columns(log, MAX_BLANK_SHARE).items():
            times = Counter(map(squeeze_name, readings[~find_blank_cells(readings)]))
            common = keys & set(times)
            again = [key for key in times if times[key] > 1]
            is_known = len(common) >= max(MIN_SHARE * len(keys), MIN_NAMES)
            if is_known and 0 < len(again) < MIN_SHARE * len(times):
                first = again[0]
                return f'"{first}" stands {times[first]} times in its column "{other}"'
    return None


def list_name_columns(table: Table, blank_share: float = 0.0) -> dict[str, Any]:
    """List the columns that may be names of points; up to a share of their cells may be empty."""
    found = {}
    for name, cells in table.columns.items():
        parsed = parse_column_name(name)
        is_quantity = parsed.quantity is not None
        is_time = parsed.words & (TIME_WORDS | DATE_WORDS)
        if is_quantity or is_time:
            continue
        if may_be_names(cells, blank_share):
            found[name] = cells
    return found


# -- by time and by order
# --------------------------------------------------------------------------------------------


def _join_by_time(points: Table, log: Table, max_gap: float, clock_offset: float) -> Join | str:
    """Join every point with the readings of the nearest time."""
    clocks = read_clocks(points, log, clock_offset)
    if isinstance(clocks, str):
        return clocks
    of_points, of_log = clocks.points, clocks.log
    order = np.argsort(of_log, kind="stable")
    sorted_times = of_log[order]
    nearest = order[find_nearest_times(sorted_times, of_points)]
    difference = of_log[nearest] - of_points
    gap = np.abs(difference)
    close = np.flatnonzero(gap <= max_gap)
    matched = len(close)
    count = len(points)
    if matched < MIN_SHARE * count:
        median = np.median(gap)
        return (
            f"{matched:,} of {count:,} points have readings within {max_gap:g} s; the median "
            f"gap is {write_rounded(median)} s ({_advise_on_gap(of_points, of_log, max_gap, clock_offset)})"
        )
    largest = float(gap[close].max())
    words = f"by nearest time ({clocks.columns}, at most {write_seconds(largest)} apart)"
    is_blank = len(clocks.point_rows) < count or len(clocks.log_rows) < len(log)
    at_points, at_log = clocks.point_rows[close], clocks.log_rows[nearest[close]]
    return Join("time", at_points, at_log, words, blank=is_blank)


def _advise_on_gap(points: Array, log: Array, max_gap: float, offset: float) -> str:
    """Say what would join by time: another offset between the clocks where one shows."""
    found = find_clock_offset(points, log, max_gap)
    if found is None:
        return "--max-gap, if the clocks differ by less"
    ahead, agreeing = found
    seconds = ahead + offset
    way = "ahead" if seconds > 0 else "behind"
    return (
        f"the joint log's clock looks {abs(seconds):.6g} s {way}: {agreeing} gaps are about equal; "
        f"--clock-offset {seconds:.6g} allows for it"
    )


def _join_by_order(points: Table, log: Table) -> Join | str:
    """Join row by row, where both have as many."""
    count = len(points)
    readings = len(log)
    if count != readings:
        return f"{count:,} points and {readings:,} rows of joint readings are not as many"
    rows = np.arange(count)
    return Join("order", rows, rows, "row by row, in their order")


def refuse_join(
    points: Table, log: Table, reasons: Mapping[str, str], ways: Sequence[str], advice: str = ""
) -> DataError:
    """Return the error of two files that no way, or not the wanted one, joins; `advice`: what would,
    where that is known."""
    listed = "; ".join(f"by {way}: {reasons[way]}" for way in ways if way in reasons)
    remedy = "Give both files a column of point names or of times, or as many rows."
    if find_times(points) is not None and find_times(log) is not None:
        remedy = (
            "Say --clock-offset or --max-gap, if the clocks differ; or give both files a column of "
            "point names, or as many rows."
        )
    return DataError(
        f"the points cannot be joined with {log.where.file}: {listed}.",
        file=points.where.file,
        remedy=advice or remedy,
    )
