"""Rows that stand in a file twice: the same row again, cell for cell, or the same measurement under
another number or name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._typing import Array

Mask = NDArray[np.bool_]


def _suspects(columns: Sequence[NDArray[Any]], m: int) -> Mask:
    """(m,) rows whose numbers hash as another row's do; all where there are no numbers."""
    suspect = np.ones(m, bool)
    if columns:
        code = np.zeros(m, np.uint64)
        for k, column in enumerate(columns):
            bits = (np.asarray(column, float) + 0.0).view(
                np.uint64
            )  # + 0.0: minus nought is nought
            code = (code ^ (bits >> np.uint64(29 + k % 5))) * np.uint64(0x9E3779B97F4A7C15) + bits
        order = np.argsort(code, kind="stable")
        alike = code[order][1:] == code[order][:-1]
        suspect[order] = np.r_[False, alike] | np.r_[alike, False]
    return suspect


def find_duplicates(table: Mapping[str, NDArray[Any]], m: int) -> Mask:
    """(m,) rows that repeat an earlier one cell for cell; compared one by one only where a hash of
    the numbers agrees."""
    suspect = _suspects([column for column in table.values() if column.dtype != object], m)
    seen: set[tuple[Any, ...]] = set()
    out = np.zeros(m, bool)
    index = np.flatnonzero(suspect)
    for k, row in zip(
        index.tolist(), zip(*(column[index] for column in table.values()), strict=True), strict=True
    ):
        out[k] = row in seen
        seen.add(row)
    return out


def find_copies(
    q: Array, position: Array, others: Sequence[NDArray[Any]], times: Array | None = None
) -> tuple[Mask, tuple[int, int] | None]:
    """((m,) rows that hold the readings q (m, n), the position (m, 3) and the `others` (m,) of an
    earlier row to the last digit, (one of them, that earlier row)). No two measurements of a point
    agree so, unless positions are written so coarsely that repeats agree in a coordinate here and
    there: those are repeats, and none is a copy. `times` (m,): how many times as many pairs have to
    agree as agree only here and there (1 without it); rows with one value are judged together."""
    out, pair = np.zeros(len(q), bool), None
    known = [*q.T, *others]
    if not _suspects([*known, *position.T], len(q)).any():
        return out, pair
    keys = [np.asarray(c, float) + 0.0 for c in (*known, *position.T)]
    order = np.lexsort((np.arange(len(q)), *reversed(keys)))
    same = np.array([key[order][1:] == key[order][:-1] for key in keys])
    reading, coordinates = same[:-3].all(0), same[-3:]
    alike = reading & coordinates.all(0)
    near = reading & coordinates.any(0) & ~alike
    asked = np.ones(len(q)) if times is None else times
    for least in np.unique(asked):
        own = asked[order][1:] == least
        if (alike & own).sum() <= least * (near & own).sum():
            alike &= ~own
    if alike.any():
        later, earlier = order[1:][alike], order[:-1][alike]
        out[later] = True
        k = int(later.argmin())
        pair = int(later[k]), int(earlier[k])
    return out, pair
