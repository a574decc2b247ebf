"""Measurement files (CSV, Parquet) -> Measurements: strict, and every refusal says file, line, column and remedy."""
from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..words.errors import DataError, suggest
from ..words.rigid import Array, from_quaternion
from .columns import UNITS, Table, column_of, labels_of, number, numbers, together
from .kinds import COLUMNS, Kinds, read_kinds, read_positions, read_quaternions, read_uncertainties
from .measurements import Measurements, Note, measurements

CHUNK = 50_000
TEXT = ("target", "configuration", "group")
FUNCTIONS = {"sin", "cos", "sign", "abs", "exp", "tanh", "free"}
RESERVED = re.compile(r"(q|approach|move|torque)\d+|[xyz]_mm|range_mm|(moment\d*|down)_[xyz]|torque\d+_\d+|progress")


def _rows(path: Path) -> Iterator[list[list[str]]]:
    """Chunks of CSV rows, the header first as a chunk of its own; refuses ragged rows with their line."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            header = next(reader, None)
            if not header or "\0" in "".join(header):
                raise DataError("the file is empty or not text.", file=path.name,
                                remedy="A CSV with a header line and a row per measured point is expected.")
            yield [[name.strip() for name in header]]
            line = 2
            while chunk := list(islice(reader, CHUNK)):
                for k, row in enumerate(chunk):
                    if len(row) != len(header):
                        if not row and all(not later for later in chunk[k:]):
                            chunk = chunk[:k]
                            break
                        raise DataError(f"{len(row)} cells, but the header has {len(header)}.", file=path.name,
                                        line=line + k, remedy="Every row needs as many cells as the header.")
                if chunk:
                    yield chunk
                line += len(chunk)
    except FileNotFoundError:
        raise DataError("no such file.", file=path.name, remedy="Put it beside the study file, or set MODELSEL_DATA to the "
                        "folder that holds it.") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or ("it is not UTF-8 text" if isinstance(error, ValueError) else str(error))
        raise DataError(f"the file cannot be read: {reason}.", file=path.name) from None


def _read_csv(path: Path) -> Table:
    chunks = _rows(path)
    header = next(chunks)[0]
    _distinct(header, path)
    parts: list[list[NDArray[Any]]] = [[np.array(column, dtype=object) for column in zip(*chunk, strict=True)]
                                       for chunk in chunks]
    return {name: np.concatenate([part[k] for part in parts]) if parts else np.zeros(0, object)
            for k, name in enumerate(header)}


def _read_parquet(path: Path, group: int | None = None) -> Table:
    """All of a file, or one of its row groups."""
    import pyarrow.lib
    import pyarrow.parquet as pq
    try:
        table = (pq.read_table(path, use_threads=False, partitioning=None) if group is None
                 else pq.ParquetFile(path).read_row_group(group, use_threads=False))
    except FileNotFoundError:
        raise DataError("no such file.", file=path.name) from None
    except (OSError, pyarrow.lib.ArrowException) as error:
        raise DataError(f"not a readable Parquet file: {str(error)[:120]}", file=path.name) from None
    _distinct(table.column_names, path)
    return {name: table.column(name).to_numpy() for name in table.column_names}


def _distinct(header: Sequence[str], path: Path) -> None:
    for name in header:
        if list(header).count(name) > 1:
            raise DataError("the name stands twice in the header.", file=path.name, line=1, column=name or "(no name)",
                            remedy="Column names must differ.")


def _joints(table: Table, path: Path, prismatic: Sequence[bool]) -> Array:
    columns = []
    for j, slides in enumerate(prismatic, 1):
        q = column_of(table, path, f"q{j}", ("mm",) if slides else ("rad", "deg"))
        if not slides and f"q{j}_rad" in table and len(q) and np.abs(q).max() > 4 * np.pi:
            row = int(np.argmax(np.abs(q) > 4 * np.pi))
            raise DataError(f"{q[row]:g} rad is beyond two turns: it looks like degrees.", file=path.name, line=row + 2,
                            column=f"q{j}_rad", remedy=f"If the readings are degrees, name the column q{j}_deg.")
        columns.append(q)
    extra = f"q{len(prismatic) + 1}"
    if any(f"{extra}_{unit}" in table for unit in UNITS):
        raise DataError(f"the file has a joint {extra}, but the robot has {len(prismatic)} joints.", file=path.name, line=1,
                        remedy="Check the robot's name in the study.")
    return np.stack(columns, 1)


def _duplicates(table: Table, m: int) -> NDArray[np.bool_]:
    """Mask of rows that repeat an earlier one cell for cell; compared one by one only where a hash of the numbers agrees."""
    suspect = np.ones(m, bool)
    numeric = [column for column in table.values() if column.dtype != object]
    if numeric:
        code = np.zeros(m, np.uint64)
        for k, column in enumerate(numeric):
            bits = (np.asarray(column, float) + 0.0).view(np.uint64)       # + 0.0: minus nought is nought
            code = (code ^ (bits >> np.uint64(29 + k % 5))) * np.uint64(0x9E3779B97F4A7C15) + bits
        order = np.argsort(code, kind="stable")
        alike = code[order][1:] == code[order][:-1]
        suspect[order] = np.r_[False, alike] | np.r_[alike, False]
    seen: set[tuple[Any, ...]] = set()
    keep = np.ones(m, bool)
    index = np.flatnonzero(suspect)
    for k, row in zip(index.tolist(), zip(*(column[index] for column in table.values()), strict=True), strict=True):
        keep[k] = row not in seen
        seen.add(row)
    return keep


def _covariates(table: Table, used: set[str], path: Path) -> tuple[dict[str, Array], list[Note]]:
    out, ignored, unusable = {}, [], []
    for name in table:
        if name in used:
            continue
        column = table[name]
        values = np.array([number(cell) for cell in column]) if column.dtype.kind not in "fiub" else np.asarray(column, float)
        if name in ("payload_kg", "temperature_C", "time_s"):
            values = numbers(table, name, path)
        if not np.isfinite(values).any():
            ignored.append(name)
        elif not np.isfinite(values).all() or not name.isidentifier() or name in FUNCTIONS or RESERVED.fullmatch(name):
            unusable.append(name)
        else:
            out[name] = values
    notes = []
    if ignored:
        notes.append(Note("columns-ignored", f"Columns that hold no numbers are ignored: {', '.join(ignored)}."))
    if unusable:
        notes.append(Note("covariates-ignored", "Columns that cannot serve as causes are ignored (empty cells, or a name "
                                                f"that is not a plain word): {', '.join(unusable)}."))
    return out, notes


def row_groups(path: Path) -> tuple[int, ...]:
    """Rows of every row group of a Parquet file; each can be read alone. Raises DataError."""
    import pyarrow.lib
    import pyarrow.parquet as pq
    try:
        told = pq.ParquetFile(path).metadata
        return tuple(int(told.row_group(k).num_rows) for k in range(told.num_row_groups))
    except FileNotFoundError:
        raise DataError("no such file.", file=path.name) from None
    except (OSError, pyarrow.lib.ArrowException) as error:
        raise DataError(f"not a readable Parquet file: {str(error)[:120]}", file=path.name) from None


def read_measurements(path: Path | str, prismatic: Sequence[bool], columns: Mapping[str, str] | None = None,
                      group: int | None = None, *, positions: bool = True) -> Measurements:
    """Measurements of a robot whose joints are `prismatic` or not, from a CSV or Parquet file in contract form.

    `columns` maps contract names to names in the file; `group`: one row group of a Parquet file alone; where `positions` need
    not be there, absent ones are nan. Raises DataError.
    """
    path = Path(path)
    table = _read_parquet(path, group) if path.suffix.lower() in (".parquet", ".pq") else _read_csv(path)
    for wanted, given in (columns or {}).items():
        if given not in table:
            raise DataError(f'the study maps {wanted} to "{given}", which is not in the file. {suggest(given, table)}',
                            file=path.name, line=1)
    renamed = {given: wanted for wanted, given in (columns or {}).items()}
    kept_names = [renamed.get(name, name) for name in table if name in renamed or name not in (columns or {})]
    _distinct(kept_names, path)
    table = {renamed.get(name, name): column for name, column in table.items() if name in renamed or name not in (columns or {})}
    n, m = len(prismatic), len(next(iter(table.values()), []))
    q = _joints(table, path, prismatic)
    kinds = read_kinds(table, path)
    there = positions or any(name in table for axis in "xyz" for name in (axis, f"{axis}_mm", f"{axis}_m"))
    if kinds is not None:
        position = read_positions(table, path, kinds)
    else:
        position = np.stack([column_of(table, path, a, ("mm", "m")) for a in "xyz"], 1) if there else np.full((m, 3), np.nan)
    if not m:
        raise DataError("a header, but no rows.", file=path.name, line=2, remedy="Each measured point is a row.")
    sigma, quaternion, sigma_rotation = _spreads(table, path, kinds)
    approach = together(table, path, [f"approach{j}" for j in range(1, n + 1)])
    if approach is not None and not np.isin(approach, (-1.0, 0.0, 1.0)).all():
        at, j = np.argwhere(~np.isin(approach, (-1.0, 0.0, 1.0)))[0]
        raise DataError("a direction of approach is -1, 0 or +1.", file=path.name, line=int(at) + 2, column=f"approach{j + 1}")
    text = {name: labels_of(table, name, path) for name in TEXT if name in table}
    order = numbers(table, "order", path) if "order" in table else None
    used = {*TEXT, "order", *(() if kinds is None else COLUMNS), "sx_mm", "sy_mm", "sz_mm",
            "qw", "qx", "qy", "qz", "srx_rad", "sry_rad", "srz_rad",
            *(f"{axis}_{u}" for axis in "xyz" for u in ("mm", "m")),
            *(f"{stem}{j}{u}" for j in range(1, n + 1) for stem, u in (("q", "_rad"), ("q", "_deg"), ("q", "_mm"),
                                                                      ("approach", "")))}
    covariates, notes = _covariates(table, used, path)
    keep = _duplicates(table, m)
    if not keep.all():
        notes.append(Note("duplicate-rows", f"{int((~keep).sum())} rows repeat an earlier row cell for cell and are counted "
                                            "once."))
    if "configuration" in text:
        _one_reading_each(text["configuration"], q, path)
    def kept(values: Any) -> Any:
        return None if values is None else np.asarray(values)[keep]
    return measurements(
        q[keep], position[keep], row=np.flatnonzero(keep), configuration=kept(text.get("configuration")),
        target=kept(text.get("target")), group=kept(text.get("group")), order=kept(order), approach=kept(approach),
        covariates={name: values[keep] for name, values in covariates.items()}, sigma=kept(sigma),
        rotation=None if quaternion is None else from_quaternion(quaternion[keep]), sigma_rotation=kept(sigma_rotation),
        notes=tuple(notes), kind=None if kinds is None else kept(kinds.kind).tolist(),
        feature=None if kinds is None else kept(kinds.feature).tolist(), length=None if kinds is None else kinds.length[keep])


def _spreads(table: Table, path: Path, kinds: Kinds | None) -> tuple[Array | None, Array | None, Array | None]:
    """(standard uncertainties [mm], quaternions, their standard uncertainties [rad])."""
    if kinds is not None:
        return read_uncertainties(table, path, kinds), *read_quaternions(table, path, kinds)
    return (together(table, path, ("sx_mm", "sy_mm", "sz_mm"), "not positive"), together(table, path, ("qw", "qx", "qy", "qz"),
            "zero"), together(table, path, ("srx_rad", "sry_rad", "srz_rad"), "not positive"))


def _one_reading_each(labels: list[str], q: Array, path: Path) -> None:
    """Refuses a configuration whose rows have different joint readings."""
    first: dict[str, int] = {}
    at = np.array([first.setdefault(label, k) for k, label in enumerate(labels)])
    bad = np.flatnonzero(np.abs(q - q[at]).max(1) > 1e-6)
    if len(bad):
        raise DataError(f'configuration "{labels[bad[0]]}" has other joint readings on line {int(at[bad[0]]) + 2}.',
                        file=path.name, line=int(bad[0]) + 2, column="configuration",
                        remedy="Rows that share a configuration share its readings; number configurations through all groups.")


def read_labels(path: Path, column: str) -> NDArray[np.object_]:
    """A text column (the split's) of every row of the file. Raises DataError."""
    table = _read_parquet(path) if path.suffix.lower() in (".parquet", ".pq") else _read_csv(path)
    if column not in table:
        raise DataError(f'the study\'s split column "{column}" is missing. {suggest(column, table)}', file=path.name, line=1)
    return np.array(labels_of(table, column, path), dtype=object)
