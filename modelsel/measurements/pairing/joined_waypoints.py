"""Readings of a joint log that no point belongs to: shots that were missed, kept among the joined
rows without a position, since the arm went there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._typing import Index
from ..formats.table import Table
from .joining import Join


def add_waypoints(joined: Table, points: Table, log: Table, join: Join) -> Table:
    """Add the log's unmatched rows to the joined ones, each in its place in the log; the points'
    columns are empty there. A log that is joined by time, or has more rows without a point than
    with one, is no list of poses: its rows are left out."""
    unused = np.setdiff1d(np.arange(len(log)), join.log)
    if join.way == "time" or not 0 < len(unused) <= len(join.log):
        return joined
    sequence = np.argsort(np.concatenate([np.sort(join.log), unused]), kind="stable")
    columns = {}
    for name, cells in joined.columns.items():
        own: Sequence[Any] | NDArray[Any]
        if name in points or name not in log:
            own = np.full(len(unused), None if cells.dtype.kind in "OUSb" else np.nan)
        else:
            own = log.columns[name][unused]
        columns[name] = np.concatenate([cells, own])[sequence]
    lines = log.where.take(unused).at
    nowhere = np.zeros(len(unused), np.intp)
    parts = {
        name: replace(part, at=_arrange(part.at, nowhere, sequence))
        for name, part in joined.where.parts.items()
    }
    at = _arrange(joined.where.at, lines, sequence)
    return replace(joined, columns=columns, where=replace(joined.where, at=at, parts=parts))


def _arrange(first: Any, second: Any, sequence: Index) -> Index:
    """Put the numbers of rows of two tables, one after the other, into their sequence."""
    numbers = np.concatenate([first, second])
    return np.asarray(numbers[sequence], np.intp)
