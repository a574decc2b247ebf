"""Rows that stand in a file twice: the same row again, cell for cell, or the same measurement under
another number or name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._hashing import HASH_FACTOR
from ..._typing import Array, Index
from ...exceptions import count_words

Mask = NDArray[np.bool_]


def _find_suspects(columns: Sequence[NDArray[Any]], m: int) -> Mask:
    """Mask (m,) the rows whose numbers hash as another row's do; all where there are no numbers."""
    if not columns:
        return np.ones(m, bool)
    code = np.zeros(m, np.uint64)
    for k, column in enumerate(columns):
        numbers = np.asarray(column, float)
        # -0.0 becomes 0.0
        numbers = numbers + 0.0
        bits = numbers.view(np.uint64)
        shift = np.uint64(29 + k % 5)
        shifted = bits >> shift
        mixed = code ^ shifted
        code = mixed * HASH_FACTOR + bits
    suspect = np.zeros(m, bool)
    values = np.sort(code)
    if not (values[1:] == values[:-1]).any():
        return suspect
    order = np.argsort(code, kind="stable")
    ordered = code[order]
    earlier_code = ordered[:-1]
    same_as_before = ordered[1:] == earlier_code
    later = order[1:]
    earlier = order[:-1]
    repeated = later[same_as_before]
    repeating = earlier[same_as_before]
    suspect[repeated] = True
    suspect[repeating] = True
    return suspect


def find_duplicates(table: Mapping[str, NDArray[Any]], m: int) -> Mask:
    """Mask (m,) the rows that repeat an earlier one cell for cell; compared one by one only where a
    hash of the numbers agrees."""
    repeated = np.zeros(m, bool)
    columns = list(table.values())
    numeric = [column for column in columns if column.dtype != object]
    is_suspect = _find_suspects(numeric, m)
    suspects = np.flatnonzero(is_suspect)
    cells = [column[suspects] for column in columns]
    rows = zip(*cells, strict=True)
    earlier: set[tuple[Any, ...]] = set()
    repeated_places = []
    for place, row in enumerate(rows):
        is_repeated = row in earlier
        if is_repeated:
            repeated_places.append(place)
        else:
            earlier.add(row)
    later = suspects[repeated_places]
    repeated[later] = True
    return repeated


def find_copies(
    q: Array, position: Array, others: Sequence[NDArray[Any]], repeats: Array | None = None
) -> tuple[Mask, tuple[int, int] | None]:
    """Find ((m,) rows that hold the readings q (m, n), the position (m, 3) and the `others` (m,) of
    an earlier row to the last digit, (one of them, that earlier row)).

    No two measurements of a point agree so, unless positions are written so coarsely that repeats
    agree in a coordinate here and there: those are repeats, and none is a copy. `repeats` (m,): how
    many copies a repeat outweighs that agrees only here and there (1 without it); rows with one
    value are judged together."""
    m = len(q)
    attributes = [*q.T, *others]
    if not _find_suspects([*attributes, *position.T], m).any():
        return np.zeros(m, bool), None
    order, same = _compare_neighbours([*attributes, *position.T])
    same_attributes, same_coordinates = same[:-3].all(0), same[-3:]
    is_copy = same_attributes & same_coordinates.all(0)
    is_repeat = same_attributes & same_coordinates.any(0) & ~is_copy
    weights = np.ones(m) if repeats is None else repeats
    for weight in np.unique(weights):
        judged = weights[order][1:] == weight
        if (is_copy & judged).sum() <= weight * (is_repeat & judged).sum():
            is_copy &= ~judged
    copied = np.zeros(m, bool)
    if not is_copy.any():
        return copied, None
    later, earlier = order[1:][is_copy], order[:-1][is_copy]
    copied[later] = True
    first = int(later.argmin())
    return copied, (int(later[first]), int(earlier[first]))


def _compare_neighbours(columns: Sequence[NDArray[Any]]) -> tuple[Index, NDArray[np.bool_]]:
    """Sort rows by columns: (their order (m,), whether each column (c, m-1) agrees with the row
    before)."""
    keys = []
    for column in columns:
        # -0.0 becomes 0.0
        key = np.asarray(column, float) + 0.0
        keys.append(key)
    rows = np.arange(len(keys[0]))
    order = np.lexsort((rows, *reversed(keys)))
    agreements = []
    for key in keys:
        ordered = key[order]
        agrees = ordered[1:] == ordered[:-1]
        agreements.append(agrees)
    same = np.array(agreements)
    return order, same


def describe_duplicates(count: int) -> str:
    """Say that so many rows repeat an earlier one."""
    rows = count_words(count, "row")
    if count == 1:
        return f"{rows} repeats an earlier row cell for cell and is counted once."
    return f"{rows} repeat an earlier row cell for cell and are counted once."
