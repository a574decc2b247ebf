"""Columns of a table as numbers or labels: strict, and every refusal says file, line, column and remedy."""
from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..words.errors import DataError, suggest
from ..words.rigid import Array

UNITS = {"rad": 1.0, "deg": np.pi / 180, "mm": 1.0, "m": 1e3}
Table = dict[str, "NDArray[Any]"]
Mask = NDArray[np.bool_]


def blank(cell: Any) -> bool:
    """Whether a cell is empty."""
    return cell is None or str(cell).strip() == "" or (isinstance(cell, float) and np.isnan(cell))


def numbers(table: Table, name: str, path: Path, where: Mask | None = None) -> Array:
    """A column as finite floats; refuses the first cell that is not one, with its line. `where`: rows that have a number; the
    others are to be empty and become nan."""
    column = table[name]
    out = np.array([number(cell) for cell in column]) if column.dtype == object else np.asarray(column, dtype=float)
    bad = np.flatnonzero(~np.isfinite(out) if where is None else ~np.isfinite(out) & where)
    if len(bad):
        cell = column[bad[0]]
        shown = "an empty cell" if cell is None or str(cell).strip() == "" else f'"{str(cell)[:30]}"'
        more = f" ({len(bad)} such cells)" if len(bad) > 1 else ""
        raise DataError(f"expected a finite number, found {shown}{more}.", file=path.name, line=int(bad[0]) + 2, column=name,
                        remedy="Correct the cell or remove the row.")
    if where is not None:
        filled = np.array([not blank(cell) for cell in column]) & ~where
        if filled.any():
            row = int(np.argmax(filled))
            raise DataError(f'found "{str(column[row])[:30]}", but a row of this kind measures nothing there.', file=path.name,
                            line=row + 2, column=name, remedy="Leave the cell empty, or correct the row's kind.")
        out = np.where(where, out, np.nan)
    return out


def number(cell: Any) -> float:
    """A cell as a float; nan where it is none."""
    if isinstance(cell, str) and "_" in cell:      # Python would read 1_000 as a number; no measuring program writes that
        return float("nan")
    try:
        return float(cell)
    except (TypeError, ValueError):
        return float("nan")


def column_of(table: Table, path: Path, stem: str, units: Sequence[str], where: Mask | None = None) -> Array:
    """The column `stem_unit` in mm or rad; refuses a missing one, two units, or none in the name. `where` as in `numbers`."""
    present = [unit for unit in units if f"{stem}_{unit}" in table]
    wanted = " or ".join(f"{stem}_{unit}" for unit in units)
    if len(present) == 1:
        return numbers(table, f"{stem}_{present[0]}", path, where) * UNITS[present[0]]
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


def together(table: Table, path: Path, names: Sequence[str], refuse: str = "", where: Mask | None = None) -> Array | None:
    """Columns that come together or not at all, (m, len(names)); refuses rows that are "not positive" or "zero". `where` as in
    `numbers`."""
    there = [name for name in names if name in table]
    if not there:
        return None
    if len(there) < len(names):
        raise DataError(f"{', '.join(there)} without {', '.join(n for n in names if n not in there)}.", file=path.name, line=1,
                        remedy=f"{' '.join(names)} come together.")
    out = np.stack([numbers(table, name, path, where) for name in names], 1)
    if refuse == "not positive" and (out <= 0).any():
        row, column = np.argwhere(out <= 0)[0]
        raise DataError("a standard uncertainty must be above zero.", file=path.name, line=int(row) + 2, column=names[column])
    if refuse == "zero" and not out.any(1).all():
        raise DataError("a quaternion of length zero.", file=path.name, line=int(np.argmin(out.any(1))) + 2, column=names[0])
    return out


def labels_of(table: Table, name: str, path: Path) -> list[str]:
    """A text column; refuses an empty cell."""
    out = ["" if cell is None else str(cell).strip() for cell in table[name]]
    if "" in out:
        raise DataError("an empty cell.", file=path.name, line=out.index("") + 2, column=name,
                        remedy=f"Give every row its {name}, or leave the column out.")
    return out
