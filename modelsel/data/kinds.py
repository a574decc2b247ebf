"""What a row measures where it is no point: a coordinate, a wire's or ball-bar's length, a distance, a shared point or plane.

A column `kind` says it; `feature` names what rows share; `length_mm` and `s_mm` are the measured length and its uncertainty.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..words.errors import DataError, StudyError, suggest
from ..words.rigid import Array
from .columns import Mask, Table, blank, column_of, numbers, together
from .measurements import KINDS, UNKNOWN, Measurements

NAMED = ("wire", "ball-bar", "distance", "same-point", "plane")      # kinds whose rows name a feature
COLUMNS = ("kind", "feature", "length_mm", "s_mm")


@dataclass(frozen=True, eq=False)
class Kinds:
    """The columns of a file that has kinds: a word a row, the feature's name ("" for none), the length (nan for none)."""

    kind: list[str]
    feature: list[str]
    length: Array

    def of(self, *kinds: str) -> Mask:
        """(m,) rows of some kinds."""
        return np.isin(self.kind, kinds)


def read_kinds(table: Table, path: Path) -> Kinds | None:
    """The kinds of a table's rows; None where it has no such column, or one that says something else. Raises DataError."""
    kind = ["" if blank(cell) else str(cell).strip() for cell in table.get("kind", ())]
    if not set(kind) & set(KINDS):
        return None
    for row, word in enumerate(kind):
        if word not in KINDS:
            raise DataError(f'"{word}" is no kind of measurement. {suggest(word, KINDS)}', file=path.name, line=row + 2,
                            column="kind", remedy=f"Kinds are {', '.join(KINDS)}.")
    feature = ["" if blank(cell) else str(cell).strip() for cell in table.get("feature", [""] * len(kind))]
    first: dict[str, int] = {}
    for row, (word, name) in enumerate(zip(kind, feature, strict=True)):
        if bool(name) != (word in NAMED):
            what = f"a row of kind {word} names no feature" if name else f"a row of kind {word} has to name its feature"
            raise DataError(f"{what}.", file=path.name, line=row + 2, column="feature", remedy="Leave the cell empty." if name
                            else "Rows that share an anchor, sphere, point, plane or first position share its name.")
        if name and kind[first.setdefault(name, row)] != word:
            raise DataError(f'feature "{name}" is of kind {kind[first[name]]} on line {first[name] + 2} and of kind {word} here.',
                            file=path.name, line=row + 2, column="feature", remedy="Give each its own name.")
    return Kinds(kind, feature, _lengths(table, path, kind, feature, first))


def _lengths(table: Table, path: Path, kind: Sequence[str], feature: Sequence[str], first: Mapping[str, int]) -> Array:
    """(m,) lengths: in every row of a wire, all rows of a ball-bar or none, every row of a distance but the feature's first."""
    bars = {name for name, word, cell in zip(feature, kind, table.get("length_mm", [""] * len(kind)), strict=True)
            if word == "ball-bar" and not blank(cell)}
    where = np.array([word == "wire" or (word == "ball-bar" and name in bars) or (word == "distance" and first[name] != row)
                      for row, (word, name) in enumerate(zip(kind, feature, strict=True))])
    if not where.any() and "length_mm" not in table:
        return np.full(len(kind), np.nan)
    out = column_of(table, path, "length", ("mm",), where)
    if (out <= 0).any():
        raise DataError("a length must be above zero.", file=path.name, line=int(np.argmax(out <= 0)) + 2, column="length_mm")
    return out


def read_positions(table: Table, path: Path, kinds: Kinds) -> Array:
    """(m, 3) mm; nan where a row's kind does not measure the coordinate. Raises DataError."""
    out = np.full((len(kinds.kind), 3), np.nan)
    for a, axis in enumerate("xyz"):
        where = kinds.of("point", axis)
        if where.any() or any(f"{axis}_{unit}" in table for unit in ("mm", "m")):
            out[:, a] = column_of(table, path, axis, ("mm", "m"), where)
    return out


def read_uncertainties(table: Table, path: Path, kinds: Kinds) -> Array | None:
    """(m, 3) mm: `s_mm`, of whatever a row measures, or `sx_mm sy_mm sz_mm` for its coordinates; one or the other in every row,
    or none at all. Raises DataError."""
    own = None
    if "s_mm" in table:
        own = numbers(table, "s_mm", path, np.array([not blank(cell) for cell in table["s_mm"]]))
    each = np.full((len(kinds.kind), 3), np.nan)
    if any(f"s{axis}_mm" in table for axis in "xyz"):
        free = np.ones(len(each), bool) if own is None else ~np.isfinite(own)
        for a, axis in enumerate("xyz"):
            if f"s{axis}_mm" in table:
                each[:, a] = numbers(table, f"s{axis}_mm", path, kinds.of("point", axis) & free)
    elif own is None:
        return None
    out = np.where(np.isfinite(each), each, np.nan if own is None else own[:, None])
    out = np.where(np.isfinite(out), out, np.nanmax(np.where(np.isfinite(out), out, -np.inf), axis=1, initial=-np.inf)[:, None])
    out[kinds.of("distance") & np.isnan(kinds.length) & ~np.isfinite(out).all(1)] = 1.0       # where one begins, none is measured
    if not (np.isfinite(out) & (out > 0)).all():
        row = int(np.argmax(~(np.isfinite(out) & (out > 0)).all(1)))
        raise DataError(f"a row of kind {kinds.kind[row]} has no standard uncertainty above zero.", file=path.name, line=row + 2,
                        column="s_mm", remedy="Give s_mm in every row (or sx_mm sy_mm sz_mm for coordinates), or nowhere.")
    return out


def read_quaternions(table: Table, path: Path, kinds: Kinds) -> tuple[Array | None, Array | None]:
    """(quaternions, their uncertainties) of the points; the other rows' are 1 0 0 0, and nobody looks at them."""
    where = kinds.of("point")
    turned = together(table, path, ("qw", "qx", "qy", "qz"), where=where)
    spread = together(table, path, ("srx_rad", "sry_rad", "srz_rad"), "not positive", where)
    if turned is None:
        return None, spread
    turned[~where] = 1.0, 0.0, 0.0, 0.0
    if not turned.any(1).all():
        raise DataError("a quaternion of length zero.", file=path.name, line=int(np.argmin(turned.any(1))) + 2, column="qw")
    if spread is not None:
        spread[~where] = 1.0
    return turned, spread


# -- what the study knows of features --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Known:
    """What a study says of a feature: where it is, a plane's normal, a ball-bar's length; `estimate`: these are a first guess;
    `zero`: the wire's reading leaves out a length that is not known."""

    position: tuple[float, float, float] | None = None
    normal: tuple[float, float, float] | None = None
    length: float | None = None
    estimate: bool = False
    zero: bool = False


def with_known(data: Measurements, known: Mapping[str, Known]) -> Measurements:
    """The measurements with their features as a study knows them. Raises StudyError with every problem."""
    features = () if data.gauges is None else data.gauges.features
    names = [f.name for f in features]
    problems = [f"measurements.features.{name}: no row of the file names it. {suggest(name, names)}"
                for name in known if name not in names]
    out = []
    for f in features:
        k = known.get(f.name, Known())
        problems += [f"measurements.features.{f.name}: {what} goes with {kinds}, but its rows are of kind {f.kind}."
                     for what, given, kinds in (("normal", k.normal is not None, "plane"), ("length_mm", k.length is not None,
                     "ball-bar"), ("zero", k.zero, "wire"), ("position_mm", k.position is not None,
                     "wire, ball-bar, same-point, plane")) if given and f.kind not in kinds.split(", ")]
        if f.kind == "plane" and (k.position is None) != (k.normal is None):
            problems.append(f"measurements.features.{f.name}: a known plane needs position_mm and normal.")
        if f.kind == "ball-bar" and k.length is not None and "length" not in f.free:
            problems.append(f"measurements.features.{f.name}: length_mm stands in its rows already; give it once.")
        placed = k.position is not None and not k.estimate
        free = (() if placed else UNKNOWN[f.kind]) + (("length",) if k.zero else ())
        if f.kind == "ball-bar" and k.length is None and "length" in f.free:
            free += ("length",)
        out.append(replace(f, position=k.position, normal=k.normal, length=k.length, free=free))
    if problems:
        raise StudyError(*problems)
    return data if data.gauges is None else replace(data, gauges=replace(data.gauges, features=tuple(out)))
