"""Rows that stand in a file twice: the same row again, cell for cell, or the same measurement under
another number or name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._typing import Array, Index

Mask = NDArray[np.bool_]
# 2^64 over the golden ratio: spreads the bits of a hash
HASH_FACTOR = np.uint64(0x9E3779B97F4A7C15)


def _find_suspects(columns: Sequence[NDArray[Any]], m: int) -> Mask:
    """Mask (m,) the rows whose numbers hash as another row's do; all where there are no numbers."""
    if not columns:
        return np.ones(m, bool)
    code = np.zeros(m, np.uint64)
    for k, column in enumerate(columns):
        numbers = np.asarray(column, float) + 0.0  # -0.0 becomes 0.0
        bits = numbers.view(np.uint64)
        code = (code ^ (bits >> np.uint64(29 + k % 5))) * HASH_FACTOR + bits
    order = np.argsort(code, kind="stable")
    same_as_before = code[order][1:] == code[order][:-1]
    suspect = np.zeros(m, bool)
    suspect[order[1:][same_as_before]] = True
    suspect[order[:-1][same_as_before]] = True
    return suspect


def find_duplicates(table: Mapping[str, NDArray[Any]], m: int) -> Mask:
    """Mask (m,) the rows that repeat an earlier one cell for cell; compared one by one only where a
    hash of the numbers agrees."""
    numeric = [column for column in table.values() if column.dtype != object]
    suspects = np.flatnonzero(_find_suspects(numeric, m))
    rows = zip(*(column[suspects] for column in table.values()), strict=True)
    earlier: set[tuple[Any, ...]] = set()
    repeated = np.zeros(m, bool)
    for number, row in zip(suspects.tolist(), rows, strict=True):
        repeated[number] = row in earlier
        earlier.add(row)
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
    keys = [np.asarray(column, float) + 0.0 for column in columns]
    rows = np.arange(len(keys[0]))
    order = np.lexsort((rows, *reversed(keys)))
    same = np.array([key[order][1:] == key[order][:-1] for key in keys])
    return order, same
