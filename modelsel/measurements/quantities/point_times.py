"""Times of rows, as instruments and controllers write them: seconds, time of day, date and time."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._typing import Array
from ..formats.column_names import parse_column_name
from ..formats.table import Table
from .columns import convert_to_numbers, find_blank_cells
from .epoch_times import holds_small_epoch, scale_epoch

TIME_WORDS = frozenset[str]().union(
    ("time", "timestamp", "zeit", "stamp", "t", "datetime", "uhrzeit", "clock"),
    ("zeitpunkt", "zeitstempel"),
)
DATE_WORDS = frozenset(("date", "datum", "day"))
# seconds since 1970 from which a number is a time of the calendar
MIN_EPOCH = 1e8
# from here on it is in milliseconds, or in a smaller unit (`epoch_times`)
MAX_EPOCH = 1e11
CLOCK = re.compile(r"\b\d{1,2}:\d{2}")
DATE = re.compile(r"\d+[-./]\d+[-./]\d+")
# a date that begins with its day or its month: which of them, it does not say
UNCLEAR_DATE = re.compile(r"\b(\d{1,2})[-/](\d{1,2})[-/]\d{2,4}\b")
MONTHS = 12
# columns of texts whose times are remembered
REMEMBERED = 8


@dataclass(frozen=True, eq=False)
class Times:
    """Times (m,) in seconds, the column they are from, whether they are of the calendar or the
    clock, not counted from a beginning, and whether they have a date."""

    seconds: Array
    column: str
    absolute: bool
    dated: bool


def find_times(table: Table) -> Times | None:
    """Find a table's times: numbers of seconds, or text that is a date, a time of day or both, in
    one column or two; None where there are none."""
    parsed = {name: parse_column_name(name) for name in table.columns}
    named = [name for name in parsed if parsed[name].words & TIME_WORDS]
    dates = [name for name in parsed if parsed[name].words & DATE_WORDS and name not in named]
    for name in [*named, *(name for name in table.columns if name not in named)]:
        cells = table.columns[name]
        if find_blank_cells(cells).any():
            continue
        values = convert_to_numbers(cells)
        if np.isfinite(values).all():
            is_seconds = name in named and parsed[name].unit in (None, "s")
            if is_seconds:
                times = scale_epoch(values)
                is_epoch = bool(times.min() > MIN_EPOCH)
                return Times(times, name, is_epoch, is_epoch)
            continue
        texts = _join_texts(table, dates[:1], name)
        seconds = _parse_texts(texts)
        if seconds is not None:
            is_dated = _are_dated(texts)
            return Times(seconds, name, True, is_dated)
    return None


def find_common_seconds(points: Table, log: Table) -> Array | None:
    """Find the times of the points [s] from the first on, where both files have times; None where
    a time of day without a date may have passed midnight."""
    times = find_times(points)
    if times is None or find_times(log) is None:
        return None
    goes_back = bool((np.diff(times.seconds) < 0).any())
    if times.absolute and not times.dated and goes_back:
        return None
    first = times.seconds.min()
    return np.asarray(np.round(times.seconds - first, 6), float)


def holds_epoch(cells: NDArray[Any]) -> bool:
    """Whether all cells are times since 1970, in seconds or a smaller unit."""
    if holds_small_epoch(cells):
        return True
    values = convert_to_numbers(cells)
    if not len(values):
        return False
    first = values.min()
    last = values.max()
    return bool(first > MIN_EPOCH and last < MAX_EPOCH)


def list_clock_columns(table: Table) -> list[str]:
    """List the column of a table's times where these are numbers that never go back."""
    times = find_times(table)
    if times is None:
        return []
    column = times.column
    values = convert_to_numbers(table.columns[column])
    is_number = np.isfinite(values)
    steps = np.diff(times.seconds)
    goes_back = steps < 0
    if goes_back.any() or not is_number.all():
        return []
    return [column]


def are_clock_times(cells: Iterable[Any]) -> bool:
    """Whether all cells hold a time of the clock, with a date or without."""
    return all(CLOCK.search(str(cell)) for cell in cells)


def read_clock(table: Table, name: str) -> Array | None:
    """Read a column of times of the clock, with the date of another column where it has none, as
    seconds (m,) from the first one on; None where a cell is no time."""
    date = find_date_column(table, name)
    if date is None:
        return parse_clock(table.columns[name])
    dated = _join_texts(table, [date], name)
    return parse_clock(dated)


def find_date_column(table: Table, name: str) -> str | None:
    """Find the column with the dates of a column of times that has none; None where it has them,
    or nothing is a date."""
    cells = table.columns[name]
    if parse_clock(cells) is None or _are_dated(cells):
        return None
    for other in table.columns:
        words = parse_column_name(other).words
        is_date = words & DATE_WORDS
        is_time = words & TIME_WORDS
        if is_time or not is_date:
            continue
        dated = _join_texts(table, [other], name)
        if _are_dated(dated) and parse_clock(dated) is not None:
            return other
    return None


def _are_dated(cells: Iterable[Any]) -> bool:
    """Whether all cells hold a date."""
    return all(DATE.search(str(cell)) for cell in cells)


def parse_clock(cells: NDArray[Any]) -> Array | None:
    """Parse times of the clock, with a date or without, as seconds (m,) from the first one on; None
    where a cell is none."""
    if cells.dtype.kind != "O" or not len(cells):
        return None
    if find_blank_cells(cells).any():
        return None
    seconds = _parse_texts(cells)
    if seconds is None:
        return None
    return np.asarray(seconds - seconds[0], float)


def _join_texts(table: Table, dates: list[str], name: str) -> NDArray[Any]:
    """Put the date before the time where it has a column of its own."""
    cells = table.columns[name]
    if not dates:
        return cells
    days = table.columns[dates[0]]
    return np.array([f"{day} {cell}" for day, cell in zip(days, cells, strict=True)], object)


def _parse_texts(texts: NDArray[Any]) -> Array | None:
    """Parse text as times [s]; None where a cell is none."""
    words = [str(text).strip() for text in texts]
    return _parse_words(tuple(words))


@lru_cache(maxsize=REMEMBERED)
def _parse_words(words: tuple[str, ...]) -> Array | None:
    """Parse times without blanks around them, unless they were parsed lately: many steps ask for the
    times of one file.

    Of a date such as 03/04/2025 it is not known which is the month: where both readings fit all
    cells, that one holds in which the campaign is shorter."""
    if not are_clock_times(words):
        return None
    readings = []
    for day_first in _list_date_orders(words):
        seconds = _parse_dates(words, day_first)
        if seconds is not None:
            seconds.setflags(write=False)
            readings.append(seconds)
    return min(readings, key=np.ptp, default=None)


def _list_date_orders(words: Sequence[str]) -> list[bool]:
    """List the orders of day and month, day first or not, that fit all dates. A point between them
    puts the day first, as in German."""
    if any("." in word[1:3] for word in words):
        return [True]
    found = [UNCLEAR_DATE.search(word) for word in words]
    pairs = [(int(match[1]), int(match[2])) for match in found if match]
    orders = []
    if all(first <= MONTHS for first, _ in pairs):
        orders.append(False)
    if pairs and all(second <= MONTHS for _, second in pairs):
        orders.append(True)
    return orders


def _parse_dates(words: Sequence[str], day_first: bool) -> Array | None:
    """Parse dates and times as seconds since 1970; None where a cell is none."""
    import pandas as pd

    series = pd.Series(words)
    try:
        moments = pd.to_datetime(series, format="mixed", dayfirst=day_first, utc=True)
    except (ValueError, TypeError, OverflowError):
        return None
    beginning = pd.Timestamp(0, tz="UTC")
    since = moments - beginning
    return np.asarray(since.dt.total_seconds(), float)
