"""A table of commands under the names, in the units and in the order of the targets' own columns."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..._names import unguard_cell
from ...measurements.formats.table import Table
from ...measurements.quantities.columns import POSITION_UNITS, UNITS
from ...measurements.quantities.contract_columns import JOINT_COLUMN
from ...measurements.quantities.orientation_columns import ORIENTATION_COLUMNS, QUATERNION_COLUMNS
from ...measurements.quantities.other_units import convert_mapped
from .commands_table import FIGURE_COLUMNS

if TYPE_CHECKING:
    import pandas as pd

POSITION_COLUMN = re.compile(rf"([xyz])_({'|'.join(POSITION_UNITS)})")
# what a table has where the targets have no such column: there is one target, in one group
LABELS = ("target", "group")
CONFIGURATION = "configuration"
NUMBER_KINDS = "fiub"  # of numpy's types


def arrange_as_targets(
    frame: pd.DataFrame,
    table: Table,
    mapping: Mapping[str, str],
    prismatic: Sequence[bool],
    rows: NDArray[np.intp],
    forward: bool = False,
) -> pd.DataFrame:
    """Arrange a table of commands, with the contract's names, as the targets are (`mapping`: contract
    name -> name in their table), `rows` of which it has. Cells that nothing was computed of stay as they
    are; what the targets do not have comes after their columns. `forward`: whether positions and
    orientations were computed, not commands."""
    import pandas as pd

    contract_names = {own: name for name, own in mapping.items()}
    computed = _list_computed(frame, forward)
    arranged: dict[str, Any] = {}
    used = set(LABELS)
    for own, cells in table.columns.items():
        contract = contract_names.get(own, own)
        kept = _keep_cells(table, cells, rows)
        if contract in FIGURE_COLUMNS or contract == CONFIGURATION and _repeats(kept):
            continue
        source, size = _find_source(contract)
        used.add(source)
        if source in computed:
            if own != contract:
                size *= _measure_unit(table, contract, own, prismatic)
            values = frame[source].to_numpy()
            kept = values if size == 1 else values / size
        arranged[_mean_text(table, own)] = kept
    for name in frame.columns:
        if name not in used:
            arranged[name] = frame[name].to_numpy()
    return pd.DataFrame(arranged)


def _find_source(contract: str) -> tuple[str, float]:
    """Find the column of commands that a column of the targets has, and the targets' unit in the unit
    of that: their positions may be in another unit than mm."""
    position = POSITION_COLUMN.fullmatch(contract)
    if position is None:
        return contract, 1.0
    axis, unit = position.groups()
    return f"{axis}_mm", UNITS[unit]


def _keep_cells(table: Table, cells: NDArray[Any], rows: NDArray[np.intp]) -> NDArray[Any]:
    """Return cells of a column as they were meant: those of a text file may be guarded against
    spreadsheets, which is done anew where they are written."""
    kept = np.asarray(cells)[rows]
    if kept.dtype.kind in NUMBER_KINDS:
        return kept
    meant = [_mean_text(table, cell) if isinstance(cell, str) else cell for cell in kept]
    return np.array(meant, dtype=kept.dtype)


def _mean_text(table: Table, cell: str) -> str:
    """Return a cell, or the name of a column, without what guards it."""
    return unguard_cell(cell) if table.where.is_text else cell


def _list_computed(frame: pd.DataFrame, forward: bool) -> set[str]:
    """List the columns that hold what was computed."""
    names = set(frame.columns)
    if forward:
        orientations = {*QUATERNION_COLUMNS, *ORIENTATION_COLUMNS}
        places = {name for name in names if POSITION_COLUMN.fullmatch(name)}
        return places | orientations & names
    return {name for name in names if JOINT_COLUMN.fullmatch(name)}


def _measure_unit(table: Table, contract: str, own: str, prismatic: Sequence[bool]) -> float:
    """Return one of the unit of a column, in that of the contract's name."""
    one = replace(table, columns={own: np.ones(1)})
    converted, _ = convert_mapped(one, {contract: own}, prismatic)
    return float(converted.columns[own][0])


def _repeats(cells: NDArray[Any]) -> bool:
    """Whether a name of configurations stands twice: their commands differ from each other now."""
    names = list(map(str, cells))
    return len(set(names)) < len(names)
