"""Which columns hold the measured position, where several may: none that no arm of this size
reaches, and none that was computed from the joint readings, which a nominal arm always fits best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...exceptions import write_rounded
from ...measurements.formats.table import Table
from ...measurements.quantities.columns import (
    POSITION_UNITS,
    QUANTITY_COLUMN,
    UNITS,
    convert_to_numbers,
)
from ...measurements.recognition.column_guesses import Choice, Reading, merge_columns
from ...robot.kinematics import Robot

POSITION = "the position"
# share of twice the reach that measured positions span at most: a target may be far from the flange
MAX_SPAN_SHARE = 1.5
# what rounding leaves of a length, of its last digit: a median of three coordinates is 0.48
ROUNDING_SHARE = 0.7
# cells whose digits are looked at
MAX_CELLS = 200
MAX_DIGITS = 12
# combined readings of all choices, and how far the nominal arm is from the positions by them [mm]
Tried = Sequence[tuple[Sequence[Reading], float]]


@dataclass(frozen=True)
class Setting:
    """The choices that are left, and a sentence on what was set aside."""

    choices: tuple[Choice, ...]
    sentence: str = ""


def drop_unreachable(
    choices: Sequence[Choice], columns: Mapping[str, NDArray[Any]], robot: Robot
) -> tuple[Choice, ...]:
    """Drop the readings of the position that no arm of this size reaches, where others are left."""
    if any(robot.prismatic):
        return tuple(choices)
    limit = MAX_SPAN_SHARE * 2 * robot.reach
    kept = []
    for choice in choices:
        readings = choice.readings
        if choice.what == POSITION:
            near = [each for each in readings if _measure_span(each, columns) <= limit]
            readings = tuple(near) or readings
        kept.append(replace(choice, readings=readings))
    return tuple(kept)


def _measure_span(reading: Reading, columns: Mapping[str, NDArray[Any]]) -> float:
    """Compute the largest extent [mm] of a position along a coordinate."""
    extents = [0.0]
    for wanted, given in reading.columns.items():
        values = convert_to_numbers(columns[given])
        finite = values[np.isfinite(values)]
        if len(finite):
            size = UNITS[wanted.rpartition("_")[2]]
            extent = np.ptp(finite) * size
            extents.append(float(extent))
    return max(extents)


def drop_computed(
    choices: Sequence[Choice], tried: Tried, table: Table, robot: Robot, good_mm: float
) -> Setting:
    """Drop the positions that the nominal arm fits to the last digit, where it fits others well, to
    `good_mm`: a controller computed them."""
    left = list(choices)
    for place, choice in enumerate(choices):
        if choice.what != POSITION or not choice.is_doubtful:
            continue
        computed = list[Reading]()
        others = list[Reading]()
        misfits = []
        for reading in choice.readings:
            combined, misfit = _find_best(tried, place, reading)
            if misfit <= _measure_rounding(combined, table, robot):
                computed.append(reading)
                misfits.append(misfit)
            elif misfit <= good_mm:
                others.append(reading)
        if not computed or not others:
            continue
        left[place] = replace(choice, readings=tuple(others))
        least = write_rounded(misfits[0])
        sentence = (
            f"Not the position: {computed[0].words}. The nominal arm fits them to {least} mm, their "
            "last digits: they were computed from the joint readings, not measured."
        )
        return Setting(tuple(left), sentence)
    return Setting(tuple(choices))


def _find_best(tried: Tried, place: int, reading: Reading) -> tuple[Sequence[Reading], float]:
    """Find the combination with a reading at the place of its choice that the arm fits best."""
    misfits = [(combined, misfit) for combined, misfit in tried if combined[place] is reading]
    return min(misfits, key=itemgetter(1))


def _measure_rounding(combined: Sequence[Reading], table: Table, robot: Robot) -> float:
    """Compute how far [mm] rounded digits, of positions and joint readings, put a computed position
    from the nominal arm, at most."""
    columns = {name: name for name in table.columns if QUANTITY_COLUMN.fullmatch(name)}
    columns |= merge_columns(combined)
    of_joints = [0.0]
    of_position = [0.0]
    for wanted, given in columns.items():
        step = _find_step(table, wanted, given)
        unit = wanted.rpartition("_")[2]
        if unit in ("rad", "deg"):
            of_joints.append(step)
        elif unit in POSITION_UNITS:
            of_position.append(step)
    size = max(of_position) + max(of_joints) * robot.reach
    return ROUNDING_SHARE * size


def _find_step(table: Table, wanted: str, given: str) -> float:
    """Find the size [mm, rad] of the last digit of a column's numbers."""
    cells = table.columns[given][:MAX_CELLS].tolist()
    digits = 0
    for cell in cells:
        fraction = str(cell).partition(".")[2]
        digits = max(digits, len(fraction.rstrip("0")))
    size = UNITS[wanted.rpartition("_")[2]]
    return float(size * 10.0 ** -min(digits, MAX_DIGITS))


def is_only_position(chosen: Sequence[Reading], tried: Tried, good_mm: float) -> bool:
    """Whether no other columns are a position that the nominal arm fits well, to `good_mm`: of two
    good ones it does not tell which was measured."""
    own = _list_position_columns(chosen)
    for combined, misfit in tried:
        others = _list_position_columns(combined)
        if misfit <= good_mm and others != own:
            return False
    return True


def describe_several_targets(tried: Tried, good_mm: float) -> str:
    """Say what to do where every row has several positions that the nominal arm fits well, to
    `good_mm`; empty where it has one."""
    good = [combined for combined, misfit in tried if misfit <= good_mm]
    places = set(map(_list_position_columns, good))
    count = len(places)
    if count < 2:
        return ""
    return (
        f"The nominal arm fits {count} positions of every row; one of them alone is used. If they are of "
        "several targets on the flange, write a row for each, with the same readings and its name in a "
        "column target."
    )


def _list_position_columns(readings: Sequence[Reading]) -> frozenset[str]:
    columns = dict[str, str]()
    for reading in readings:
        columns |= reading.columns
    return frozenset(given for wanted, given in columns.items() if wanted[0] in "xyz")
