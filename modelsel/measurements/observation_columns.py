"""What a row measures where it is no point: a coordinate, a wire's or ball-bar's length, a
distance, a shared point or plane.

A column `kind` says it; `feature` names what rows share; `length_mm` and `s_mm` are the measured
length and its uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .._typing import LARGEST, Array
from ..exceptions import StudyError, suggest
from .columns import (
    MIN_UNCERTAINTY,
    Mask,
    check_names,
    find_blank_cells,
    read_column_set,
    read_numbers,
    read_quantity,
)
from .duplicates import find_duplicates
from .features import FREE_NUMBERS, KINDS
from .measurements import Measurements
from .table import Table

KINDS_WITH_FEATURE = (
    "wire",
    "ball-bar",
    "distance",
    "same-point",
    "plane",
)  # kinds whose rows name a feature
KIND_COLUMNS = ("kind", "feature", "length_mm", "s_mm")


@dataclass(frozen=True, eq=False)
class Kinds:
    """The columns of a file that has kinds: a word a row, the feature's name ("" for none), the
    length (nan for none)."""

    kind: list[str]
    feature: list[str]
    length: Array

    def of(self, *kinds: str) -> Mask:
        """(m,) rows of some kinds."""
        return np.isin(self.kind, kinds)


def _words(table: Table, name: str) -> list[str]:
    """A text column; "" where a cell is empty or there is no such column."""
    if name not in table:
        return [""] * len(table)
    column = table.columns[name]
    return [
        "" if none else str(cell).strip()
        for cell, none in zip(column, find_blank_cells(column), strict=True)
    ]


def read_kinds(table: Table) -> Kinds | None:
    """The kinds of a table's rows; None where it has no such column, or one that says something
    else. Raises DataError."""
    kind, where = _words(table, "kind"), table.where
    if not set(kind) & set(KINDS):
        return None
    for row, word in enumerate(kind):
        if word not in KINDS:
            raise where.refuse(
                f'"{word}" is no kind of measurement. {suggest(word, KINDS)}',
                row=row,
                column="kind",
                remedy=f"Kinds are {', '.join(KINDS)}.",
            )
    feature = check_names(table, "feature", _words(table, "feature"))
    first: dict[str, int] = {}
    for row, (word, name) in enumerate(zip(kind, feature, strict=True)):
        if bool(name) != (word in KINDS_WITH_FEATURE):
            what = (
                f"a row of kind {word} names no feature"
                if name
                else f"a row of kind {word} has to name its feature"
            )
            raise where.refuse(
                f"{what}.",
                row=row,
                column="feature",
                remedy="Leave the cell empty."
                if name
                else "Rows that share an anchor, sphere, point, plane or first position share its name.",
            )
        if name and kind[first.setdefault(name, row)] != word:
            raise where.refuse(
                f'feature "{name}" is of kind {kind[first[name]]} on {where.named(first[name])} and of kind '
                f"{word} here.",
                row=row,
                column="feature",
                remedy="Give each its own name.",
            )
    again = find_duplicates(
        table.columns, len(kind)
    )  # counted once, later: a distance may begin twice
    for name, row in first.items():
        if (
            kind[row] == "distance"
            and [f for f, twice in zip(feature, again, strict=True) if not twice].count(name) < 2
        ):
            raise where.refuse(
                f'distance "{name}" has one row.',
                row=row,
                remedy="The first row of a feature is where its distances begin; add the row where one ends.",
            )
    return Kinds(kind, feature, _lengths(table, kind, feature, first, again))


def _lengths(
    table: Table, kind: Sequence[str], feature: Sequence[str], first: Mapping[str, int], again: Mask
) -> Array:
    """(m,) lengths: in every row of a wire, all rows of a ball-bar or none, every row of a distance
    but the feature's first."""
    empty = (
        find_blank_cells(table.columns["length_mm"])
        if "length_mm" in table
        else np.ones(len(kind), bool)
    )
    bars = {
        name
        for name, word, none in zip(feature, kind, empty, strict=True)
        if word == "ball-bar" and not none
    }
    begun = again & empty
    rows = np.array(
        [
            word == "wire"
            or (word == "ball-bar" and name in bars)
            or (word == "distance" and first[name] != row and not begun[row])
            for row, (word, name) in enumerate(zip(kind, feature, strict=True))
        ]
    )
    if not rows.any() and "length_mm" not in table:
        return np.full(len(kind), np.nan)
    out = read_quantity(table, "length", ("mm",), rows)
    if (out <= 0).any():
        raise table.where.refuse(
            "a length must be above zero.",
            row=int(np.argmax(out <= 0)),
            column="length_mm",
            remedy="Correct the cell or remove the row.",
        )
    return out


def read_positions(table: Table, kinds: Kinds) -> Array:
    """(m, 3) mm; nan where a row's kind does not measure the coordinate. Raises DataError."""
    out = np.full((len(kinds.kind), 3), np.nan)
    for a, axis in enumerate("xyz"):
        rows = kinds.of("point", axis)
        if rows.any() or any(f"{axis}_{unit}" in table for unit in ("mm", "m")):
            out[:, a] = read_quantity(table, axis, ("mm", "m"), rows)
    return out


def read_uncertainties(table: Table, kinds: Kinds) -> Array | None:
    """(m, 3) mm: `s_mm`, of whatever a row measures, or `sx_mm sy_mm sz_mm` for its coordinates;
    one or the other in every row, or none at all. Raises DataError."""
    own = None
    if "s_mm" in table:
        own = read_numbers(
            table, "s_mm", -LARGEST, LARGEST, ~find_blank_cells(table.columns["s_mm"])
        )
    each = np.full((len(kinds.kind), 3), np.nan)
    if any(f"s{axis}_mm" in table for axis in "xyz"):
        free = np.ones(len(each), bool) if own is None else ~np.isfinite(own)
        for a, axis in enumerate("xyz"):
            if f"s{axis}_mm" in table:
                each[:, a] = read_numbers(
                    table, f"s{axis}_mm", -LARGEST, LARGEST, kinds.of("point", axis) & free
                )
    elif own is None:
        return None
    out = np.where(np.isfinite(each), each, np.nan if own is None else own[:, None])
    out = np.where(
        np.isfinite(out),
        out,
        np.nanmax(np.where(np.isfinite(out), out, -np.inf), axis=1, initial=-np.inf)[:, None],
    )
    out[kinds.of("distance") & np.isnan(kinds.length) & ~np.isfinite(out).all(1)] = (
        1.0  # where one begins, none is measured
    )
    good = (np.isfinite(out) & (out >= MIN_UNCERTAINTY)).all(1)
    if not good.all():
        row = int(np.argmin(good))
        raise table.where.refuse(
            f"a row of kind {kinds.kind[row]} has no standard uncertainty above zero, {MIN_UNCERTAINTY:g} at "
            "least.",
            row=row,
            column="s_mm",
            remedy="Give s_mm in every row (or sx_mm sy_mm sz_mm for coordinates), or nowhere.",
        )
    return out


def read_quaternions(table: Table, kinds: Kinds) -> tuple[Array | None, Array | None]:
    """(quaternions, their uncertainties) of the points; the other rows' are 1 0 0 0, and nobody
    looks at them. Raises DataError."""
    rows = kinds.of("point")
    turned = read_column_set(table, ("qw", "qx", "qy", "qz"), "zero", rows)
    spread = read_column_set(table, ("srx_rad", "sry_rad", "srz_rad"), "not positive", rows)
    if turned is not None:
        turned[~rows] = 1.0, 0.0, 0.0, 0.0
    if spread is not None:
        spread[~rows] = 1.0
    return turned, spread


# -- what the study knows of features
# --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class KnownFeature:
    """What a study says of a feature: where it is, a plane's normal, a ball-bar's length;
    `estimate`: these are a first guess; `zero`: the wire's reading leaves out a length that is not
    known."""

    position: tuple[float, float, float] | None = None
    normal: tuple[float, float, float] | None = None
    length: float | None = None
    estimate: bool = False
    zero: bool = False


def apply_known_features(data: Measurements, known: Mapping[str, KnownFeature]) -> Measurements:
    """The measurements with their features as a study knows them. Raises StudyError with every
    problem."""
    features = () if data.gauges is None else data.gauges.features
    names = [f.name for f in features]
    problems = [
        f"measurements.features.{name}: no row of the file names it. {suggest(name, names)}"
        for name in known
        if name not in names
    ]
    out = []
    for f in features:
        k = known.get(f.name, KnownFeature())
        problems += [
            f"measurements.features.{f.name}: {what} goes with {kinds}, but its rows are of kind {f.kind}."
            for what, given, kinds in (
                ("normal", k.normal is not None, "plane"),
                ("length_mm", k.length is not None, "ball-bar"),
                ("zero", k.zero, "wire"),
                ("position_mm", k.position is not None, "wire, ball-bar, same-point, plane"),
            )
            if given and f.kind not in kinds.split(", ")
        ]
        if f.kind == "plane" and (k.position is None) != (k.normal is None):
            problems.append(
                f"measurements.features.{f.name}: a known plane needs position_mm and normal."
            )
        if f.kind == "ball-bar" and k.length is not None and "length" not in f.free:
            problems.append(
                f"measurements.features.{f.name}: length_mm stands in its rows already; give it once."
            )
        placed = k.position is not None and not k.estimate
        free = (() if placed else FREE_NUMBERS[f.kind]) + (("length",) if k.zero else ())
        if f.kind == "ball-bar" and k.length is None and "length" in f.free:
            free += ("length",)
        out.append(replace(f, position=k.position, normal=k.normal, length=k.length, free=free))
    if problems:
        raise StudyError(*problems)
    return (
        data
        if data.gauges is None
        else replace(data, gauges=replace(data.gauges, features=tuple(out)))
    )
