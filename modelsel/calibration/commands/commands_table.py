"""A table of commands, or of what they lead to, in the form of the targets that it was made from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..._typing import Array
from ...measurements.formats.table import Table
from ...measurements.measurements import ONE_GROUP, Measurements
from ...measurements.quantities.columns import convert_to_numbers, find_blank_cells
from ...measurements.quantities.contract_columns import list_contract_names
from ...measurements.quantities.orientation_columns import (
    QUATERNION_COLUMNS,
    choose_orientation_names,
    write_orientations,
)
from .command_notes import needs_approach

if TYPE_CHECKING:
    import pandas as pd

    from ..calibration import Calibration

UNITS_PER_READING = {"rad": 1.0, "deg": 180 / np.pi, "mm": 1.0, "m": 1e-3}  # from rad or mm
POINT = "point"
# what a table of corrected commands says of them, which is not of what is made from it
FIGURE_COLUMNS = frozenset[str]().union(
    ("error_before_mm", "error_left_mm", "model_uncertainty_mm", "expected_error_mm"),
    ("orientation_before_mrad", "orientation_left_mrad", "orientation_uncertainty_mrad"),
)


@dataclass(frozen=True, eq=False)
class CarriedColumns:
    """What a table of targets has for people and for what reads it next: its columns of `texts`
    and of points (name -> cells of all rows), the names of its `orientations`, whether it says the `order` of
    motion."""

    texts: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    orientations: tuple[str, ...] = QUATERNION_COLUMNS
    order: bool = False


PLAIN_FORM = CarriedColumns()


def find_carried_columns(
    c: Calibration, table: Table, mapping: Mapping[str, str]
) -> CarriedColumns:
    """Find what a table of targets has to carry on; `mapping`: contract name -> name in the
    table."""
    contract = list_contract_names(c.robot.prismatic)
    known = contract.union(mapping.values())
    texts = {}
    for name, cells in table.columns.items():
        is_point = name.lower() == POINT
        if name not in known and (is_point or _hold_text(cells)):
            texts[name] = cells
    names = {*table.columns, *mapping}
    orientations = choose_orientation_names(names)
    return CarriedColumns(texts, orientations, "order" in names)


def _hold_text(cells: NDArray[Any]) -> bool:
    """Whether a cell of a column is neither blank nor a number."""
    numbers = convert_to_numbers(cells)
    is_other = np.isnan(numbers)
    is_blank = find_blank_cells(cells)
    is_text = is_other & ~is_blank
    return bool(is_text.any())


def build_commands_table(
    c: Calibration,
    data: Measurements,
    q: Array,
    x: Array,
    more: Mapping[str, Array],
    form: CarriedColumns = PLAIN_FORM,
) -> pd.DataFrame:
    """Tabulate commands q (m, n) and positions x (m, 3) in the form of a measurements file, the
    commands in the units of the planned ones, the orientations of `data` as the targets have them,
    with `more` columns."""
    import pandas as pd

    units = data.units or [c.robot.unit(j) for j in range(1, c.robot.n + 1)]
    columns: dict[str, object] = {}
    for name, cells in form.texts.items():
        columns[name] = cells[data.row]
    for j, unit in enumerate(units, 1):
        factor = UNITS_PER_READING[unit]
        readings = q[:, j - 1]
        columns[f"q{j}_{unit}"] = readings * factor
    columns |= dict(zip(("x_mm", "y_mm", "z_mm"), x.T, strict=True))
    if data.rotation is not None:
        columns |= write_orientations(data.rotation, form.orientations)
    columns["target"] = np.array(data.targets)[data.target]
    if data.groups != ONE_GROUP:
        columns["group"] = np.array(data.groups)[data.group]
    if form.order:
        columns["order"] = data.order
    if needs_approach(c, data):
        directions = data.approach.T.astype(int)
        for j, column in enumerate(directions, 1):
            columns[f"approach{j}"] = column
    covariates = {n: v for n, v in data.covariates.items() if n not in FIGURE_COLUMNS}
    return pd.DataFrame({**columns, **covariates, **more})


def list_point_names(data: Measurements, form: CarriedColumns) -> list[str]:
    """List what the targets call their rows: their column of points, else the one that names the
    rows; empty where there is none."""
    labels = data.where.labels
    for name, cells in form.texts.items():
        if name.lower() == POINT:
            labels = cells
    if labels is None:
        return []
    own = [labels[row] for row in data.row.tolist()]
    cells = np.array(own, dtype=object)
    is_blank = find_blank_cells(cells)
    named = zip(cells, is_blank, strict=True)
    return ["" if blank else str(cell) for cell, blank in named]
