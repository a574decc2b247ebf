"""Names of points in two files, without what differs from program to program."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._typing import Index
from ..quantities.columns import convert_to_numbers, find_blank_cells
from ..quantities.point_times import are_clock_times
from .leftover_points import find_repeated_name

LETTERS_BEFORE = re.compile(r"^\D*0*(?=\d)")


def may_be_names(cells: NDArray[Any], blank_share: float) -> bool:
    """Return whether cells may be names: text other than times, or whole numbers; up to a share of them
    may be empty."""
    is_blank = find_blank_cells(cells)
    filled = cells[~is_blank]
    if not len(filled) or are_clock_times(filled):
        return False
    if is_blank.mean() > blank_share:
        return False
    values = convert_to_numbers(filled)
    is_number = np.isfinite(values)
    numbers = values[is_number]
    whole = np.round(numbers)
    return bool(np.array_equal(numbers, whole))


def squeeze_name(cell: Any) -> str:
    """Write a name without what differs between programs: capitals, the collection and group that
    stand before it."""
    text = str(cell).strip()
    parts = text.split("::")
    name = parts[-1]
    plain = name.casefold()
    return plain.removesuffix(".0")


def keep_number(cell: Any) -> str:
    """Write a name without the letters and zeros before its number: P007 and 7 are one."""
    name = squeeze_name(cell)
    return LETTERS_BEFORE.sub("", name)


def pair_names(
    cells: NDArray[Any], readings: NDArray[Any], shorten: Callable[[Any], str]
) -> tuple[Index, Index, tuple[int, ...]]:
    """Match names: (rows of the points, rows of the log, those of the points that are repeated
    shots); none where the log has a name twice. A row without a name has no partner; a point that was shot again (P031_2) has the
    readings of the first."""
    keys = _list_names(readings, shorten)
    place = {key: row for row, key in keys.items()}
    rows, partners = list[int](), list[int]()
    if len(place) < len(keys):
        place = {}
    names = _list_names(cells, shorten)
    measured = set(names.values())
    repeated = list[int]()
    for row, key in names.items():
        first = find_repeated_name(key, measured, place)
        if first is not None:
            repeated.append(row)
        partner = place.get(first or key)
        if partner is not None:
            rows.append(row)
            partners.append(partner)
    of_points = np.array(rows, np.intp)
    of_log = np.array(partners, np.intp)
    return of_points, of_log, tuple(repeated)


def _list_names(cells: NDArray[Any], shorten: Callable[[Any], str]) -> dict[int, str]:
    """List the names in some cells by their rows; empty cells have none."""
    is_blank = find_blank_cells(cells)
    filled = np.flatnonzero(~is_blank)
    names = {}
    for row in filled.tolist():
        cell = cells[row]
        names[row] = shorten(cell)
    return names
