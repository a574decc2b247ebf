"""The contract's columns -> Measurements, from CSV, Parquet or a DataFrame: strict, and every
refusal says place and remedy."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._names import plain_word
from .._typing import Array
from ..exceptions import StudyError, one_line, suggest
from ..notices import Note
from ..robot.rigid import from_quaternion
from .columns import READINGS, as_numbers, labels, measured, numbers, together
from .duplicates import copies, duplicates
from .measurements import Measurements, measurements, numbered
from .observation_columns import (
    COLUMNS,
    Kinds,
    read_kinds,
    read_positions,
    read_quaternions,
    read_uncertainties,
)
from .state_names import is_state_name
from .table import Source, Table, Where, read_table, renamed
from .unit_names import mapped_units, other_units

JOINT = re.compile(r"q([0-9]{1,9})_(?:rad|deg|mm|m)")
TEXT = ("target", "configuration", "group")
USED = (
    *TEXT,
    "order",
    "sx_mm",
    "sy_mm",
    "sz_mm",
    "qw",
    "qx",
    "qy",
    "qz",
    "srx_rad",
    "sry_rad",
    "srz_rad",
)
KNOWN = ("payload_kg", "temperature_C", "time_s")
# copies of a single number to one repeat that differs, from which they are taken for copies
SINGLE = 10.0
STANDING_RAD, STANDING_MM = (
    1e-3,
    0.1,
)  # by how much an arm that stands still may be read anew: encoders' noise, servos' hold
FUNCTIONS = {"sin", "cos", "sign", "abs", "exp", "tanh", "free"}


def _joints(table: Table, prismatic: Sequence[bool]) -> Array:
    columns, where = [], table.where
    for j, slides in enumerate(prismatic, 1):
        q = measured(table, f"q{j}", READINGS[slides])
        if not slides and f"q{j}_rad" in table and len(q) and np.abs(q).max() > 4 * np.pi:
            row = int(np.argmax(np.abs(q) > 4 * np.pi))
            raise where.refuse(
                f"{q[row]:g} rad is beyond two turns: it looks like degrees.",
                row=row,
                column=f"q{j}_rad",
                remedy=f"If the readings are degrees, name the column q{j}_deg.",
            )
        columns.append(q)
    for name in table.columns:
        if (found := JOINT.fullmatch(name)) and not 1 <= int(found[1]) <= len(prismatic):
            raise where.refuse(
                f"{'the file' if where.is_file else 'it'} has a joint q{int(found[1])}, but the robot has "
                f"{len(prismatic)} joints.",
                column=name,
                remedy="Check the robot's name in the study, or rename the column.",
            )
    return np.stack(columns, 1)


def _covariates(table: Table, used: set[str]) -> tuple[dict[str, Array], list[Note]]:
    out, ignored, unusable = {}, [], []
    for name in table.columns:
        if name in used or JOINT.fullmatch(name):
            continue
        values = (
            numbers(table, name, -1e12, 1e12) if name in KNOWN else as_numbers(table.columns[name])
        )
        if not np.isfinite(values).any():
            ignored.append(name)
        elif (
            not (np.abs(values) <= 1e30).all()
            or not plain_word(name)
            or name in FUNCTIONS
            or is_state_name(name)
        ):
            unusable.append(name)
        else:
            out[name] = values

    def shown(
        names: list[str],
    ) -> str:  # a column may be called anything: what cannot be seen is escaped
        return ", ".join(map(one_line, names))

    notes = []
    if ignored:
        notes.append(
            Note("columns-ignored", f"Columns that hold no numbers are ignored: {shown(ignored)}.")
        )
    if unusable:
        notes.append(
            Note(
                "covariates-ignored",
                "Columns that cannot serve as causes are ignored (empty cells, numbers above "
                f"1e30, or a name that is not a plain word): {shown(unusable)}.",
            )
        )
    return out, notes


def read_measurements(
    source: Source,
    prismatic: Sequence[bool],
    columns: Mapping[str, str] | None = None,
    group: int | None = None,
    *,
    positions: bool = True,
    once: bool = True,
) -> Measurements:
    """Measurements in contract form of a robot whose joints slide where `prismatic` says so
    (`robot.prismatic`), from a CSV or Parquet file or a pandas DataFrame with the same columns.

    `columns` maps contract names to names in the file; `group`: one row group of a Parquet file
    alone; where `positions` need not be there, absent ones are nan; where rows count `once`, what
    stands there twice is one. Raises DataError with file, line and column, or row (from 0) and
    column of the DataFrame; StudyError for a contract name that is none."""
    _known(columns or {}, prismatic)
    table = read_table(source, group)
    mapped_units(columns or {}, prismatic, table.where)
    table = renamed(table, columns or {})
    where, n, m = table.where, len(prismatic), len(table)
    gauged = "kind" in table and "feature" in table
    other_units(table, _names(prismatic) - set(() if gauged else COLUMNS), prismatic, gauged)
    q = _joints(table, prismatic)
    there = positions or any(
        name in table for axis in "xyz" for name in (axis, f"{axis}_mm", f"{axis}_m")
    )
    kinds = read_kinds(table)
    if kinds is not None:
        position = read_positions(table, kinds)
    else:
        position = (
            np.stack([measured(table, axis, ("mm", "m")) for axis in "xyz"], 1)
            if there
            else np.full((m, 3), np.nan)
        )
    if not m:
        raise where.refuse("a header, but no rows.", row=0, remedy="Each measured point is a row.")
    sigma, quaternion, sigma_rotation = _spreads(table, kinds)
    approach = together(table, [f"approach{j}" for j in range(1, n + 1)])
    if approach is not None and not np.isin(approach, (-1.0, 0.0, 1.0)).all():
        at, j = np.argwhere(~np.isin(approach, (-1.0, 0.0, 1.0)))[0]
        raise where.refuse(
            "a direction of approach is -1, 0 or +1.",
            row=int(at),
            column=f"approach{j + 1}",
            remedy="Correct the cell, or leave the approach columns out.",
        )
    text = {name: labels(table, name) for name in TEXT if name in table}
    order = numbers(table, "order") if "order" in table else None
    covariates, notes = _covariates(
        table, _names(prismatic) - {*KNOWN, *(() if kinds is not None else COLUMNS)}
    )
    if "configuration" in text:
        _one_reading_each(text["configuration"], q, prismatic, where)
    others = [] if quaternion is None else list(quaternion.T)
    others += [numbered(text["target"])[0]] if "target" in text else []
    others += [covariates[name] for name in ("payload_kg", "temperature_C") if name in covariates]
    keep = np.ones(m, bool)
    if once:
        keep, said = _once(table, q, *_compared(position, others, kinds))
        notes += said

    def kept(values: Any) -> Any:
        return None if values is None else np.asarray(values)[keep]

    made = measurements(
        q[keep],
        position[keep],
        row=np.flatnonzero(keep),
        configuration=kept(text.get("configuration")),
        target=kept(text.get("target")),
        group=kept(text.get("group")),
        order=kept(order),
        approach=kept(approach),
        covariates={name: values[keep] for name, values in covariates.items()},
        sigma=kept(sigma),
        rotation=None if quaternion is None else from_quaternion(quaternion[keep]),
        sigma_rotation=kept(sigma_rotation),
        notes=tuple(notes),
        prismatic=prismatic,
        **(
            {}
            if kinds is None
            else {
                "kind": kept(kinds.kind).tolist(),
                "feature": kept(kinds.feature).tolist(),
                "length": kinds.length[keep],
            }
        ),
    )
    return replace(
        made,
        where=where,
        units=tuple(
            next(u for u in READINGS[slides] if f"q{j}_{u}" in table)
            for j, slides in enumerate(prismatic, 1)
        ),
    )


def _spreads(table: Table, kinds: Kinds | None) -> tuple[Array | None, Array | None, Array | None]:
    """(standard uncertainties [mm], quaternions, their standard uncertainties [rad])."""
    if kinds is not None:
        return read_uncertainties(table, kinds), *read_quaternions(table, kinds)
    return (
        together(table, ("sx_mm", "sy_mm", "sz_mm"), "not positive"),
        together(table, ("qw", "qx", "qy", "qz"), "zero"),
        together(table, ("srx_rad", "sry_rad", "srz_rad"), "not positive"),
    )


def _compared(
    position: Array, others: list[Array], kinds: Kinds | None
) -> tuple[Array, list[Array], Array]:
    """What copies are told by: position and others, and how surely (see `copies`); of kinds what
    each row measures, nought where it measures nothing, and what the row is of. Repeats of a single
    number agree easily. A row that measures nothing (a touch) is its readings: the same again to
    the last digit says nothing more."""
    if kinds is None:
        return position, others, np.ones(len(position))
    value = np.nan_to_num(position)
    value[:, 0] += np.nan_to_num(kinds.length)
    begins = kinds.of("distance") & np.isnan(kinds.length)
    times = np.select(
        [kinds.of("point"), kinds.of("ball-bar", "same-point", "plane")], [1.0, 0.0], SINGLE
    )
    return (
        value,
        [
            *others,
            *(
                np.asarray(c, float)
                for c in (numbered(kinds.kind)[0], numbered(kinds.feature)[0], begins)
            ),
        ],
        times,
    )


def _once(
    table: Table, q: Array, position: Array, others: list[Array], times: Array
) -> tuple[NDArray[np.bool_], list[Note]]:
    """((m,) rows that count, what is said of the others): a measurement that stands in the file
    twice is one."""
    again, notes = duplicates(table.columns, len(q)), []
    if again.any():
        notes.append(
            Note(
                "duplicate-rows",
                f"{int(again.sum())} rows repeat an earlier row cell for cell and are counted once.",
            )
        )
    rows = np.flatnonzero(~again)
    found, pair = copies(q[rows], position[rows], [values[rows] for values in others], times[rows])
    if pair is not None:
        first, second = (table.where.named(int(rows[k])) for k in reversed(pair))
        notes.append(
            Note(
                "copied-rows",
                f"{int(found.sum())} rows hold the readings and the position of an earlier row to the "
                f"last digit, under another number, time or name ({second} is {first} "
                "again): they are taken for copies and counted once.",
            )
        )
    keep = ~again
    keep[rows[found]] = False
    return keep, notes


def _names(prismatic: Sequence[bool]) -> set[str]:
    """The column names of the contract, for a robot whose joints are `prismatic` or not."""
    n = len(prismatic)
    return {
        *USED,
        *KNOWN,
        *COLUMNS,
        *(f"{axis}_{u}" for axis in "xyz" for u in ("mm", "m")),
        *(f"approach{j}" for j in range(1, n + 1)),
        *(f"q{j}_{u}" for j, slides in enumerate(prismatic, 1) for u in READINGS[slides]),
    }


def _known(columns: Mapping[str, str], prismatic: Sequence[bool]) -> None:
    """Refuses a mapping to a name that the contract has not."""
    names = _names(prismatic)
    problems = [
        f'measurements.columns: "{name}" is no name of the contract. {suggest(name, names)}'
        for name in columns
        if name not in names
    ]
    problems += [
        f'measurements.columns: "{given}" is mapped to twice. Name another column.'
        for given in sorted(set(columns.values()))
        if list(columns.values()).count(given) > 1
    ]
    if problems:
        raise StudyError(*problems)


def _one_reading_each(names: list[str], q: Array, prismatic: Sequence[bool], where: Where) -> None:
    """Refuses a configuration whose rows have other joint readings than an arm that stands still
    has, read again."""
    first: dict[str, int] = {}
    at = np.array([first.setdefault(label, k) for k, label in enumerate(names)])
    bad = np.flatnonzero(
        (np.abs(q - q[at]) > np.where(prismatic, STANDING_MM, STANDING_RAD)).any(1)
    )
    if len(bad):
        raise where.refuse(
            f'configuration "{names[bad[0]]}" has other joint readings on {where.named(int(at[bad[0]]))}.',
            row=int(bad[0]),
            column="configuration",
            remedy="Rows that share a configuration share its readings; number configurations through all groups.",
        )


def read_labels(source: Source, column: str) -> NDArray[np.object_]:
    """A text column (the split's) of every row of the file or DataFrame. Raises DataError."""
    table = read_table(source)
    if column not in table:
        raise table.where.refuse(
            f'the study\'s split column "{column}" is missing. {suggest(column, table.columns)}'
        )
    return np.array(labels(table, column), dtype=object)
