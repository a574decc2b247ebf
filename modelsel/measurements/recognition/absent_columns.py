"""Readings and positions that are not in a table: all of them are named in one refusal."""

from __future__ import annotations

from collections.abc import Sequence

from ...exceptions import list_within
from ..formats.table import Table
from ..quantities.columns import POSITION_UNITS, READING_UNITS
from ..quantities.numbered_joints import describe_missing_joints
from .column_guesses import list_missing_joints


def refuse_absent_columns(table: Table, prismatic: Sequence[bool], positions: bool) -> None:
    """Refuse a table that lacks several of the joints' readings and, where they must be there, of
    the coordinates of `positions`; one alone is refused where it is read. Raises DataError."""
    joints = len(prismatic)
    if len(list_missing_joints(table, prismatic)) == joints:
        missing = describe_missing_joints(table, joints)
        if missing:
            raise table.where.refuse(missing, remedy="Export them all.")
    quantities: dict[str, Sequence[str]] = {}
    for j, slides in enumerate(prismatic, 1):
        quantities[f"q{j}"] = READING_UNITS[slides]
    if positions and "kind" not in table:
        quantities |= dict.fromkeys("xyz", POSITION_UNITS)
    absent = []
    for stem, units in quantities.items():
        names = [f"{stem}_{unit}" for unit in units]
        # a name without a unit is told as that
        if not any(name in table for name in (stem, *names)):
            absent.append(names)
    if len(absent) < 2:
        return
    listed = list_within([" or ".join(names) for names in absent], "; ")
    first = [names[0] for names in absent[:2]]
    example = {name: f"NAME{number}" for number, name in enumerate(first, 1)}
    mapping = table.where.mapping_all(example)
    raise table.where.refuse(
        f"columns are missing: {listed}.", remedy=f"If they have other names, map them {mapping}."
    )
