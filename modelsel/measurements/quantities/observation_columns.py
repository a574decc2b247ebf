"""Columns of rows that measure something other than a point: a coordinate, a wire's or ball-bar's
length, a distance, a shared point or plane.

A column `kind` says what; `feature` names what rows share; `length_mm` and `s_mm` are the measured
length and its uncertainty."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from ..._typing import LARGEST, Array
from ...exceptions import suggest
from ..campaign.features import KINDS, KindColumns
from ..formats.table import Table
from .columns import (
    MIN_UNCERTAINTY,
    POSITION_UNITS,
    Mask,
    check_names,
    find_blank_cells,
    read_column_set,
    read_numbers,
    read_quantity,
)
from .duplicates import find_duplicates

# kinds whose rows name a feature
KINDS_WITH_FEATURE = ("wire", "ball-bar", "distance", "same-point", "plane")
KIND_COLUMNS = ("kind", "feature", "length_mm", "s_mm")


def _read_words(table: Table, name: str) -> list[str]:
    """Read a text column; "" where a cell is empty or there is no such column."""
    if name not in table:
        return [""] * len(table)
    column = table.columns[name]
    is_empty = find_blank_cells(column)
    return [
        "" if empty else str(cell).strip() for cell, empty in zip(column, is_empty, strict=True)
    ]


def read_kinds(table: Table) -> KindColumns | None:
    """Read the kinds of a table's rows; None where it has no such column, or one that says
    something else. Raises DataError."""
    kind = _read_words(table, "kind")
    if set(kind).isdisjoint(KINDS):
        return None
    _check_kinds(table, kind)
    words = _read_words(table, "feature")
    feature = check_names(table, "feature", words)
    first_rows = _check_features(table, kind, feature)
    # rows that repeat another are counted once, later: a distance may begin twice
    repeated = find_duplicates(table.columns, len(kind))
    _check_distances(table, kind, feature, first_rows, repeated)
    length = _read_lengths(table, kind, feature, first_rows, repeated)
    return KindColumns(kind, feature, length)


def _check_kinds(table: Table, kind: Sequence[str]) -> None:
    for row, word in enumerate(kind):
        if word not in KINDS:
            raise table.where.refuse(
                f'"{word}" is not a kind of measurement. {suggest(word, KINDS)}',
                row=row,
                column="kind",
                remedy=f"Kinds are {', '.join(KINDS)}.",
            )


def _check_features(table: Table, kind: Sequence[str], feature: Sequence[str]) -> dict[str, int]:
    """Return the first row of every feature; refuse rows that name one where their kind has none,
    or none where it has one, and features of two kinds."""
    first_rows: dict[str, int] = {}
    for row, (word, name) in enumerate(zip(kind, feature, strict=True)):
        if name and word not in KINDS_WITH_FEATURE:
            raise table.where.refuse(
                f"a row of kind {word} does not name a feature.",
                row=row,
                column="feature",
                remedy="Leave the cell empty.",
            )
        if not name and word in KINDS_WITH_FEATURE:
            raise table.where.refuse(
                f"a row of kind {word} has to name its feature.",
                row=row,
                column="feature",
                remedy="Rows that share an anchor, sphere, point, plane or first position share its name.",
            )
        if not name:
            continue
        first = first_rows.setdefault(name, row)
        if kind[first] != word:
            earlier = table.where.name_row(first)
            raise table.where.refuse(
                f'feature "{name}" is of kind {kind[first]} on {earlier} and of kind {word} here.',
                row=row,
                column="feature",
                remedy="Give each its own name.",
            )
    return first_rows


def _check_distances(
    table: Table,
    kind: Sequence[str],
    feature: Sequence[str],
    first_rows: Mapping[str, int],
    repeated: Mask,
) -> None:
    """Refuse a distance that has one row only."""
    marked = zip(feature, repeated, strict=True)
    rows = Counter(name for name, again in marked if not again)
    for name, first in first_rows.items():
        if kind[first] == "distance" and rows[name] < 2:
            raise table.where.refuse(
                f'distance "{name}" has one row.',
                row=first,
                remedy="The first row of a feature is where its distances begin; add the row where one ends.",
            )


def _read_lengths(
    table: Table,
    kind: Sequence[str],
    feature: Sequence[str],
    first_rows: Mapping[str, int],
    repeated: Mask,
) -> Array:
    """Read lengths (m,): in every row of a wire, all rows of a ball-bar or none, every row of a
    distance but the feature's first."""
    count = len(kind)
    words = np.asarray(kind)
    has_column = "length_mm" in table
    is_empty = np.ones(count, bool)
    if has_column:
        is_empty = find_blank_cells(table.columns["length_mm"])
    is_first = np.array([first_rows.get(name) == row for row, name in enumerate(feature)], bool)
    begins = is_first | (repeated & is_empty)
    is_wire = words == "wire"
    is_bar = words == "ball-bar"
    is_distance = words == "distance"
    measured_rows = np.flatnonzero(is_bar & ~is_empty).tolist()
    measured_bars = {feature[row] for row in measured_rows}
    is_measured_bar = np.array([name in measured_bars for name in feature], bool)
    is_measured_bar &= is_bar
    is_measured_distance = is_distance & ~begins
    rows = is_wire | is_measured_bar | is_measured_distance
    if not rows.any() and not has_column:
        return np.full(count, np.nan)
    length = read_quantity(table, "length", ("mm",), rows)
    is_wrong = length <= 0
    if is_wrong.any():
        row = int(np.argmax(is_wrong))
        raise table.where.refuse(
            "a length must be above zero.",
            row=row,
            column="length_mm",
            remedy="Correct the cell or remove the row.",
        )
    return length


def read_positions(table: Table, kinds: KindColumns) -> Array:
    """Read positions (m, 3) [mm]; nan where a row's kind does not measure the coordinate. Raises
    DataError."""
    rows = len(kinds.kind)
    position = np.full((rows, 3), np.nan)
    for a, axis in enumerate("xyz"):
        measured = kinds.of("point", axis)
        has_column = any(f"{axis}_{unit}" in table for unit in POSITION_UNITS)
        is_needed = measured.any()
        if is_needed or has_column:
            coordinate = read_quantity(table, axis, POSITION_UNITS, measured)
            position[:, a] = coordinate
    return position


def read_uncertainties(table: Table, kinds: KindColumns) -> Array | None:
    """Read standard uncertainties (m, 3) [mm]: `s_mm`, of whatever a row measures, or `sx_mm sy_mm
    sz_mm` for its coordinates; one or the other in every row, or none at all. Raises DataError."""
    has_column = "s_mm" in table
    single = np.full(len(kinds.kind), np.nan)
    if has_column:
        is_empty = find_blank_cells(table.columns["s_mm"])
        single = read_numbers(table, "s_mm", -LARGEST, LARGEST, ~is_empty)
    axes = [axis for axis in "xyz" if f"s{axis}_mm" in table]
    if not axes and not has_column:
        return None
    has_single = np.isfinite(single)
    sigma = np.repeat(single[:, None], 3, axis=1)
    for axis in axes:
        a = "xyz".index(axis)
        rows = kinds.of("point", axis)
        rows &= ~has_single
        column = read_numbers(table, f"s{axis}_mm", -LARGEST, LARGEST, rows)
        is_given = np.isfinite(column)
        sigma[is_given, a] = column[is_given]
    sigma = _fill_rows(sigma)
    is_filled = np.isfinite(sigma).all(1)
    # where a distance begins, nothing is measured
    has_no_length = np.isnan(kinds.length)
    begins = kinds.of("distance") & has_no_length
    sigma[begins & ~is_filled] = 1.0
    is_finite = np.isfinite(sigma)
    is_large_enough = sigma >= MIN_UNCERTAINTY
    is_valid = (is_finite & is_large_enough).all(1)
    if not is_valid.all():
        row = int(np.argmin(is_valid))
        raise table.where.refuse(
            f"a row of kind {kinds.kind[row]} has no standard uncertainty above zero, "
            f"{MIN_UNCERTAINTY:g} at least.",
            row=row,
            column="s_mm",
            remedy="Give s_mm in every row (or sx_mm sy_mm sz_mm for coordinates), or nowhere.",
        )
    return sigma


def _fill_rows(sigma: Array) -> Array:
    """Fill what a row (m, 3) does not say with the largest number it has; -inf where it has
    none."""
    is_given = np.isfinite(sigma)
    given = np.where(is_given, sigma, -np.inf)
    largest = given.max(axis=1)
    filling = largest[:, None]
    return np.where(is_given, sigma, filling)


def read_quaternions(table: Table, kinds: KindColumns) -> tuple[Array | None, Array | None]:
    """Read (quaternions, their uncertainties) of the points; the other rows' are 1 0 0 0, and
    nobody looks at them. Raises DataError."""
    points = kinds.of("point")
    columns = ("qw", "qx", "qy", "qz")
    sigma_columns = ("srx_rad", "sry_rad", "srz_rad")
    quaternion = read_column_set(table, columns, "not unit", points)
    sigma = read_column_set(table, sigma_columns, "not positive", points)
    if quaternion is not None:
        quaternion[~points] = 1.0, 0.0, 0.0, 0.0
    if sigma is not None:
        sigma[~points] = 1.0
    return quaternion, sigma
