"""Positions that no arm of some size reaches in the unit that their columns say, and reaches in
another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..._typing import Array
from ...exceptions import sentence_list
from ...robot.kinematics import Robot
from ..formats.stated_units import COORDINATES, name_unit
from ..formats.table import Table
from .columns import POSITION_UNITS, UNITS

# joints from which the links tell how far a target goes
MIN_JOINTS = 4
# a target's median distance from the middle of its places: of a point on a long tool [mm] at most
MAX_REACHES, LONG_TOOL_MM = 2.0, 1000.0
# that of a campaign which a unit explains, in reaches
MIN_USUAL, MAX_USUAL = 0.02, 1.2
MIN_ROWS = 4
MILLIMETRES = {"mm": 1.0, "m": 1e3, "cm": 10.0, "in": 25.4}


def refuse_wide_positions(
    table: Table, robot: Robot, position: Array, group: NDArray[np.intp]
) -> None:
    """Raise DataError where positions (m, 3) [mm], in the unit that their columns say, lie wider
    apart than the arm goes in every group (m,), and do not in one other unit: says both."""
    names = _list_names(table)
    unit = _find_unit(names)
    if unit is None or robot.n < MIN_JOINTS:
        return
    spread = measure_spread(position, group)
    largest = MAX_REACHES * robot.reach + LONG_TOOL_MM
    if spread <= largest:
        return
    others = _list_likely_units(spread / MILLIMETRES[unit], robot.reach)
    if len(others) != 1:
        return
    (other,) = others
    said = name_unit(unit)
    meant = name_unit(other)
    given = [table.where.names.get(name, name) for name in names]
    listed = sentence_list([f'"{name}"' for name in given])
    raise table.where.refuse(
        f"the file says {said} of {listed}, but half of the points then lie more than "
        f"{spread:,.0f} mm from their middle, too far for {robot.name} (links of "
        f"{robot.reach:,.0f} mm in all); read as {meant} it is {others[other]:,.0f} mm.",
        column=names[0],
        remedy=f"If they are {meant}, correct what says {said}: the columns' names, the line of "
        "units or a comment.",
    )


def measure_spread(position: Array, group: NDArray[np.intp]) -> float:
    """Measure the median distance [mm] of positions (m, 3) from their middle, in the group (m,)
    where it is least; 0 where no group has rows enough."""
    finite = np.isfinite(position)
    is_known = finite.all(1)
    spreads = []
    for each in np.unique(group):
        rows = is_known & (group == each)
        if rows.sum() < MIN_ROWS:
            continue
        points = position[rows]
        middle = np.median(points, axis=0)
        distances = np.linalg.norm(points - middle, axis=1)
        spread = np.median(distances)
        spreads.append(float(spread))
    return min(spreads, default=0.0)


def _list_likely_units(spread: float, reach: float) -> dict[str, float]:
    """List the units in which a spread, a mere number, is one of an arm's campaign, with it in mm."""
    likely = {}
    for unit, size in MILLIMETRES.items():
        in_mm = spread * size
        share = in_mm / max(reach, 1.0)
        if MIN_USUAL <= share <= MAX_USUAL:
            likely[unit] = in_mm
    return likely


def _find_unit(names: list[str]) -> str | None:
    """Find the unit of three coordinates; None where they have several."""
    units = {name.partition("_")[2] for name in names}
    if len(names) != len(COORDINATES) or len(units) != 1:
        return None
    (unit,) = units
    factor = UNITS[unit]
    same = [other for other, size in MILLIMETRES.items() if size == factor]
    return same[0]


def _list_names(table: Table) -> list[str]:
    """List the coordinates' columns, by their names in the contract."""
    wanted = [f"{axis}_{unit}" for axis in COORDINATES for unit in POSITION_UNITS]
    return [name for name in wanted if name in table]
