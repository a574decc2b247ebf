"""Which column of one file tells the targets of a configuration apart, whatever it is called."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...measurements.formats.table import Table
from ...measurements.pairing.joining import find_reflectors
from ...measurements.quantities.columns import convert_to_numbers
from ...measurements.quantities.contract_columns import JOINT_COLUMN
from ...measurements.recognition.column_guesses import Reading

REASON = "it tells rows apart that share their readings and stand at several places"


def add_target(optional: Sequence[Reading], table: Table) -> list[Reading]:
    """Add the column that tells targets apart to the optional ones, where none is read so yet;
    `table`: the measured rows, with the readings under the contract's names."""
    known = list(optional)
    if "target" in table or any("target" in reading.columns for reading in known):
        return known
    joints = list(filter(JOINT_COLUMN.fullmatch, table.columns))
    readings = [convert_to_numbers(table.columns[name]) for name in joints]
    if not len(table) or not readings:
        return known
    _, number = np.unique(np.stack(readings, 1), axis=0, return_inverse=True)
    kept = {name: cells for name, cells in table.columns.items() if name not in joints}
    name = find_reflectors(replace(table, columns=kept), number.ravel())
    if name is None:
        return known
    target = Reading({"target": name}, f'"{name}" as reflectors', REASON)
    # one column is not the target and something else
    others = [reading for reading in known if name not in reading.columns.values()]
    return [target, *others]
