"""Measurement files (CSV, Parquet) -> Measurements: strict, and every refusal says file, line, column and remedy."""
from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..words.errors import DataError, StudyError, suggest
from ..words.rigid import LARGEST, Array, from_quaternion
from .measurements import Measurements, Note, measurements
from .table import Table, distinct, read_table

SMALLEST = 1e-9        # mm or rad: the least standard uncertainty
JOINT = re.compile(r"q([0-9]{1,9})_(?:rad|deg|mm|m)")
COMMA = re.compile(r"[-+]?\d+,\d+")
UNITS = {"rad": 1.0, "deg": np.pi / 180, "mm": 1.0, "m": 1e3}
TEXT = ("target", "configuration", "group")
USED = (*TEXT, "order", "sx_mm", "sy_mm", "sz_mm", "qw", "qx", "qy", "qz", "srx_rad", "sry_rad", "srz_rad")
KNOWN = ("payload_kg", "temperature_C", "time_s")
FUNCTIONS = {"sin", "cos", "sign", "abs", "exp", "tanh", "free"}
RESERVED = re.compile(r"(q|approach|move|torque)\d+|[xyz]_mm|range_mm|(moment\d*|down)_[xyz]|torque\d+_\d+|progress")


def _numbers(table: Table, name: str, path: Path, low: float = -np.inf, high: float = np.inf) -> Array:
    """A column as finite floats between two bounds; refuses the first cell that is not one, with its line."""
    column = table[name]
    out = np.asarray(column, float) if column.dtype.kind in "fiu" else np.array([_number(cell) for cell in column], float)
    with np.errstate(invalid="ignore"):
        bad = np.flatnonzero(~(np.isfinite(out) & (out >= low) & (out <= high)))
    if len(bad):
        cell = column[bad[0]]
        shown = "an empty cell" if cell is None or str(cell).strip() == "" else f'"{str(cell)[:30]}"'
        more = f" ({len(bad)} such cells)" if len(bad) > 1 else ""
        bounds = f" between {low:g} and {high:g}" if np.isfinite(out[bad[0]]) else ""
        comma = " Numbers need a decimal point, not a comma." if COMMA.fullmatch(str(cell).strip()) else ""
        raise DataError(f"expected a finite number{bounds}, found {shown}{more}.", file=path.name, line=int(bad[0]) + 2,
                        column=name, remedy=f"Correct the cell or remove the row.{comma}")
    return out


def _number(cell: Any) -> float:
    if isinstance(cell, (bool, np.bool_)) or isinstance(cell, str) and "_" in cell:
        return float("nan")         # Python would read 1_000 as a number; no measuring program writes that
    try:
        return float(cell)
    except (TypeError, ValueError, OverflowError):
        return float("nan")


def _column(table: Table, path: Path, stem: str, units: Sequence[str]) -> Array:
    """The column `stem_unit` in mm or rad; refuses a missing one, two units, or none in the name."""
    present = [unit for unit in units if f"{stem}_{unit}" in table]
    wanted = " or ".join(f"{stem}_{unit}" for unit in units)
    if len(present) == 1:
        return _numbers(table, f"{stem}_{present[0]}", path, -LARGEST, LARGEST) * UNITS[present[0]]
    if present:
        raise DataError(f"{' and '.join(f'{stem}_{u}' for u in present)} are both there.", file=path.name, line=1,
                        remedy="Keep one of them.")
    if stem in table:
        raise DataError(f'column "{stem}" has no unit in its name.', file=path.name, line=1, column=stem,
                        remedy=f'Rename it to {wanted}, or map it in the study file: [measurements] columns = '
                               f'{{ {stem}_{units[0]} = "{stem}" }}.')
    raise DataError(f"column {wanted} is missing. {suggest(f'{stem}_{units[0]}', list(table))}", file=path.name, line=1,
                    remedy=f'If it has another name, map it in the study file: [measurements] columns = '
                           f'{{ {stem}_{units[0]} = "NAME" }}.')


def _together(table: Table, path: Path, names: Sequence[str], refuse: str = "") -> Array | None:
    """Columns that come together or not at all, (m, len(names)); refuses rows that are "not positive" or "zero"."""
    there = [name for name in names if name in table]
    if not there:
        return None
    if len(there) < len(names):
        raise DataError(f"{', '.join(there)} without {', '.join(n for n in names if n not in there)}.", file=path.name, line=1,
                        remedy=f"{' '.join(names)} come together.")
    out = np.stack([_numbers(table, name, path, -LARGEST, LARGEST) for name in names], 1)
    if refuse == "not positive" and (out < SMALLEST).any():
        row, column = np.argwhere(out < SMALLEST)[0]
        raise DataError(f"a standard uncertainty must be above zero, {SMALLEST:g} at least.", file=path.name, line=int(row) + 2,
                        column=names[column], remedy="Correct the cell, or leave the uncertainties out.")
    if refuse == "zero" and not out.any(1).all():
        raise DataError("a quaternion of length zero.", file=path.name, line=int(np.argmin(out.any(1))) + 2, column=names[0],
                        remedy="Correct the row or remove it.")
    return out


def _joints(table: Table, path: Path, prismatic: Sequence[bool]) -> Array:
    columns = []
    for j, slides in enumerate(prismatic, 1):
        q = _column(table, path, f"q{j}", ("mm",) if slides else ("rad", "deg"))
        if not slides and f"q{j}_rad" in table and len(q) and np.abs(q).max() > 4 * np.pi:
            row = int(np.argmax(np.abs(q) > 4 * np.pi))
            raise DataError(f"{q[row]:g} rad is beyond two turns: it looks like degrees.", file=path.name, line=row + 2,
                            column=f"q{j}_rad", remedy=f"If the readings are degrees, name the column q{j}_deg.")
        columns.append(q)
    for name in table:
        if (found := JOINT.fullmatch(name)) and not 1 <= int(found[1]) <= len(prismatic):
            raise DataError(f"the file has a joint q{int(found[1])}, but the robot has {len(prismatic)} joints.", file=path.name,
                            line=1, column=name, remedy="Check the robot's name in the study, or rename the column.")
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
        if name in used or JOINT.fullmatch(name):
            continue
        column = table[name]
        values = (np.asarray(column, float) if column.dtype.kind in "fiub" else
                  np.array([_number(cell) for cell in column], float))
        if name in KNOWN:
            values = _numbers(table, name, path, -1e12, 1e12)
        if not np.isfinite(values).any():
            ignored.append(name)
        elif not (np.abs(values) <= 1e30).all() or not name.isidentifier() or name in FUNCTIONS or RESERVED.fullmatch(name):
            unusable.append(name)
        else:
            out[name] = values
    notes = []
    if ignored:
        notes.append(Note("columns-ignored", f"Columns that hold no numbers are ignored: {', '.join(ignored)}."))
    if unusable:
        notes.append(Note("covariates-ignored", "Columns that cannot serve as causes are ignored (empty cells, numbers above "
                                                f"1e30, or a name that is not a plain word): {', '.join(unusable)}."))
    return out, notes


def read_measurements(path: Path | str, prismatic: Sequence[bool], columns: Mapping[str, str] | None = None,
                      group: int | None = None, *, positions: bool = True) -> Measurements:
    """Measurements of a robot whose joints are `prismatic` or not, from a CSV or Parquet file in contract form.

    `columns` maps contract names to names in the file; `group`: one row group of a Parquet file alone; where `positions` need
    not be there, absent ones are nan. Raises DataError, or StudyError for a contract name that is none.
    """
    path = Path(path)
    _known(columns or {}, prismatic)
    table = read_table(path, group)
    for wanted, given in (columns or {}).items():
        if given not in table:
            raise DataError(f'the study maps {wanted} to "{given}", which is not in the file. {suggest(given, table)}',
                            file=path.name, line=1)
    renamed = {given: wanted for wanted, given in (columns or {}).items()}
    kept_names = [renamed.get(name, name) for name in table if name in renamed or name not in (columns or {})]
    distinct(kept_names, path)
    table = {renamed.get(name, name): column for name, column in table.items() if name in renamed or name not in (columns or {})}
    n, m = len(prismatic), len(next(iter(table.values()), []))
    q = _joints(table, path, prismatic)
    there = positions or any(name in table for axis in "xyz" for name in (axis, f"{axis}_mm", f"{axis}_m"))
    position = np.stack([_column(table, path, axis, ("mm", "m")) for axis in "xyz"], 1) if there else np.full((m, 3), np.nan)
    if not m:
        raise DataError("a header, but no rows.", file=path.name, line=2, remedy="Each measured point is a row.")
    sigma = _together(table, path, ("sx_mm", "sy_mm", "sz_mm"), "not positive")
    quaternion = _together(table, path, ("qw", "qx", "qy", "qz"), "zero")
    sigma_rotation = _together(table, path, ("srx_rad", "sry_rad", "srz_rad"), "not positive")
    approach = _together(table, path, [f"approach{j}" for j in range(1, n + 1)])
    if approach is not None and not np.isin(approach, (-1.0, 0.0, 1.0)).all():
        at, j = np.argwhere(~np.isin(approach, (-1.0, 0.0, 1.0)))[0]
        raise DataError("a direction of approach is -1, 0 or +1.", file=path.name, line=int(at) + 2, column=f"approach{j + 1}",
                        remedy="Correct the cell, or leave the approach columns out.")
    text = {name: _labels(table, name, path) for name in TEXT if name in table}
    order = _numbers(table, "order", path) if "order" in table else None
    covariates, notes = _covariates(table, _names(prismatic) - set(KNOWN), path)
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
        notes=tuple(notes))


def _names(prismatic: Sequence[bool]) -> set[str]:
    """The column names of the contract, for a robot whose joints are `prismatic` or not."""
    n = len(prismatic)
    return {*USED, *KNOWN, *(f"{axis}_{u}" for axis in "xyz" for u in ("mm", "m")), *(f"approach{j}" for j in range(1, n + 1)),
            *(f"q{j}_{u}" for j, slides in enumerate(prismatic, 1) for u in (("mm",) if slides else ("rad", "deg")))}


def _known(columns: Mapping[str, str], prismatic: Sequence[bool]) -> None:
    """Refuses a mapping to a name that the contract has not."""
    names = _names(prismatic)
    problems = [f'measurements.columns: "{name}" is no name of the contract. {suggest(name, names)}' for name in columns
                if name not in names]
    problems += [f'measurements.columns: "{given}" is mapped to twice. Name another column.'
                 for given in sorted(set(columns.values())) if list(columns.values()).count(given) > 1]
    if problems:
        raise StudyError(*problems)


def _one_reading_each(labels: list[str], q: Array, path: Path) -> None:
    """Refuses a configuration whose rows have different joint readings."""
    first: dict[str, int] = {}
    at = np.array([first.setdefault(label, k) for k, label in enumerate(labels)])
    bad = np.flatnonzero(np.abs(q - q[at]).max(1) > 1e-6)
    if len(bad):
        raise DataError(f'configuration "{labels[bad[0]]}" has other joint readings on line {int(at[bad[0]]) + 2}.',
                        file=path.name, line=int(bad[0]) + 2, column="configuration",
                        remedy="Rows that share a configuration share its readings; number configurations through all groups.")


def _labels(table: Table, name: str, path: Path) -> list[str]:
    out = ["" if cell is None else str(cell).strip() for cell in table[name]]
    if "" in out:
        raise DataError("an empty cell.", file=path.name, line=out.index("") + 2, column=name,
                        remedy=f"Give every row its {name}, or leave the column out.")
    return out


def read_labels(path: Path, column: str) -> NDArray[np.object_]:
    """A text column (the split's) of every row of the file. Raises DataError."""
    table = read_table(path)
    if column not in table:
        raise DataError(f'the study\'s split column "{column}" is missing. {suggest(column, table)}', file=path.name, line=1)
    return np.array(_labels(table, column, path), dtype=object)
