"""Rows between the others that sum up those above them: their mean, standard deviation, least, most.

A word alone makes no summary, since it may be a point's or a person's name: the numbers beside it
must be those of the rows above."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._typing import Array, Index
from .number_format import clean_number, is_number

Statistic = Callable[[Array], Any]
Columns = Sequence[NDArray[Any]]

MEAN_WORDS = ("mean", "average", "avg", "mittelwert", "mittel", "mw", "moyenne", "media", "média")
DEVIATION_WORDS = ("std", "stddev", "stdev", "stdabw", "stabw", "standardabweichung", "sd", "sigma")
STATISTICS: dict[str, tuple[Statistic, ...]] = {
    **dict.fromkeys((*MEAN_WORDS, "promedio"), (np.mean,)),
    **dict.fromkeys(DEVIATION_WORDS, (np.std, partial(np.std, ddof=1))),
    **dict.fromkeys(("min", "minimum"), (np.min,)),
    **dict.fromkeys(("max", "maximum"), (np.max,)),
    **dict.fromkeys(("range", "spannweite", "spanne"), (np.ptp,)),
    **dict.fromkeys(("sum", "summe", "total", "somme", "suma"), (np.sum,)),
    "median": (np.median,),
}
WORD = re.compile(r"[^\W\d_]+")
NO_DIGITS = str.maketrans("", "", "0123456789")
# characters of a label, at most; rows of one summary, at most; rows that it sums up, at least
MAX_LABEL = 60
MAX_SUMMARY_ROWS = 12
MIN_SUMMED_ROWS = 2
# of the numbers of a row that agree with the rows above, and how many
MIN_AGREEING_SHARE = 0.8
MIN_AGREEING = 2
# of a value and the range of its column: by how much a rounded statistic may be off
RELATIVE_TOLERANCE = 2e-3


def find_group_summaries(columns: Columns) -> dict[int, str]:
    """Find the rows that sum up those above them, back to the last such rows, with their labels."""
    labels = _find_labels(columns)
    found = dict[int, str]()
    if not labels:
        return found
    numbers = _read_numbers(columns)
    end = 0
    for run in _split_runs(labels):
        first = run[0]
        above = numbers[:, end:first]
        end = run[-1] + 1
        count = above.shape[1]
        if len(run) > MAX_SUMMARY_ROWS or count < MIN_SUMMED_ROWS:
            continue
        if any(_sums_up(labels[row], numbers[:, row], above) for row in run):
            for row in run.tolist():
                found[row] = labels[row]
    return found


def _read_numbers(columns: Columns) -> Array:
    """Read the cells of columns as numbers (k, m)."""
    numbers = []
    for column in columns:
        values = [_read_cell(cell) for cell in column.tolist()]
        numbers.append(values)
    return np.array(numbers)


def _read_cell(cell: Any) -> float:
    """Read a cell of plain digits as a number; NaN for any other."""
    if not is_number(cell):
        return float("nan")
    text = clean_number(cell) or cell
    try:
        return float(text)
    except ValueError:
        return float("nan")


def _find_labels(columns: Columns) -> dict[int, str]:
    """Find the rows with a cell that a summary may have, and these cells."""
    labels = dict[int, str]()
    for column in columns:
        if _holds_numbers(column):
            continue
        words = _find_words(column)
        if not words:
            continue
        for row, cell in enumerate(column.tolist()):
            if isinstance(cell, str) and cell in words:
                labels.setdefault(row, cell.strip())
    return dict(sorted(labels.items()))


def _holds_numbers(column: NDArray[Any]) -> bool:
    """Whether all cells of a column are plain numbers, which is found out fast."""
    try:
        column.astype(float)
    except (TypeError, ValueError):
        return False
    return True


def _find_words(column: NDArray[Any]) -> set[str]:
    """Find the different cells of a column that may label a summary; those that differ by their
    digits alone are looked at once."""
    kinds = dict[str, bool]()
    found = set[str]()
    for cell in dict.fromkeys(column.tolist()):
        if not isinstance(cell, str) or len(cell) > MAX_LABEL:
            continue
        kind = cell.translate(NO_DIGITS)
        if kind not in kinds:
            kinds[kind] = bool(_list_statistics(kind))
        if kinds[kind] and not is_number(cell):
            found.add(cell)
    return found


def _list_statistics(label: str) -> list[Statistic]:
    """List the statistics that the words of a label name."""
    words = WORD.findall(label.casefold())
    joined = "".join(words)
    statistics = list[Statistic]()
    for word in {*words, joined}:
        statistics += STATISTICS.get(word, ())
    return statistics


def _split_runs(labels: Mapping[int, str]) -> list[Index]:
    """Split labelled rows into those that follow one another."""
    numbers = list(labels)
    rows = np.array(numbers, np.intp)
    steps = np.diff(rows)
    is_break = steps > 1
    breaks = np.flatnonzero(is_break)
    firsts = breaks + 1
    return np.split(rows, firsts)


def _sums_up(label: str, row: Array, above: Array) -> bool:
    """Whether the numbers of a row (k,) are a statistic of those above it (k, m)."""
    is_complete = np.isfinite(above).all(1)
    is_varied = np.ptp(np.nan_to_num(above), axis=1) > 0
    is_judged = np.isfinite(row) & is_complete & is_varied
    count = int(is_judged.sum())
    if count < MIN_AGREEING:
        return False
    values = row[is_judged]
    rows = above[is_judged]
    ranges = np.ptp(rows, axis=1)
    least = max(MIN_AGREEING, MIN_AGREEING_SHARE * count)
    for statistic in _list_statistics(label):
        expected = np.array([statistic(each) for each in rows])
        size = np.abs(expected) + ranges
        difference = np.abs(values - expected)
        is_alike = difference <= RELATIVE_TOLERANCE * size
        agreeing = int(is_alike.sum())
        if agreeing >= least:
            return True
    return False
