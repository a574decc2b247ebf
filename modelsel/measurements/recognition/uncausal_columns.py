"""Columns of numbers that can be no causes, by their names and values: what was computed from the
measured positions, commanded positions, counters of rows, orientations, uncertainties."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..._typing import Array
from ...exceptions import one_line
from ...notices import Note
from ..formats.column_names import (
    AXES,
    COMMANDED,
    MEASURED,
    OTHER_QUANTITIES,
    ColumnName,
    parse_column_name,
)
from ..formats.table import Table
from ..quantities.columns import convert_to_numbers
from ..quantities.contract_columns import JOINT_COLUMN
from .orientation_guesses import find_orientation_columns, find_unnamed_quaternion
from .other_positions import find_other_positions

DEVIATION_WORDS = frozenset[str]().union(
    ("dev", "deviation", "abw", "abweichung", "err", "error", "fehler", "residual", "residuals"),
    ("delta", "diff", "difference", "differenz", "δ"),
)
# deviations along an axis, in one word
SHORT_DEVIATIONS = frozenset(("dx", "dy", "dz", "δx", "δy", "δz"))
# words beside them that leave a deviation one of positions
POSITION_WORDS = frozenset[str]().union(
    ("3d", "mag", "magnitude", "total", "norm", "pos", "position", "point", "abs", "length"),
    ("xyz", "distance", "dist", "gesamt", "vector"),
)
# words of what an instrument's own fit leaves: OptiTrack's "Mean Marker Error"
FIT_WORDS = frozenset(("mean", "marker", "markers"))
# the size of a deviation, beside its components
SIZE_WORDS = POSITION_WORDS | {"d", "dr", "d3d", "dxyz"}
UNCERTAINTY_WORDS = frozenset[str]().union(
    ("s", "u", "u95", "sigma", "std", "stdev", "sd", "unc", "uncertainty", "unsicherheit")
)
SHORT_UNCERTAINTIES = frozenset(("sx", "sy", "sz", "ux", "uy", "uz"))
# beside uncertainties of the coordinates: their size, and what the instrument's own readings leave
UNCERTAINTY_SIZES = frozenset(("rms", "umag", "u3d", "uxyz"))
# rows from which a column of any name may be said to count them
MIN_COUNTED = 8
# names of columns that count fewer rows, too
COUNTER_NAMES = frozenset(("no", "nr", "nummer", "lfd. nr", "lfdnr"))
# X1, y_2: a coordinate of one of several positions
NUMBERED_AXIS = re.compile(r"([xyz])[ _]?(\d+)$", re.IGNORECASE)
# what a column without a name is called
NO_NAME = "one without a name"
# what is said of the columns of each code
SENTENCES = {
    "computed-ignored": "Columns that look computed from the measured positions, and so are not "
    "causes of errors, are ignored: {}.",
    "commanded-ignored": "Commanded positions, which are not causes of errors, are ignored: {}.",
    "positions-ignored": "Positions beside the one that is measured, which are not causes of errors, "
    "are ignored: {}.",
    "counters-ignored": "Columns that only count the rows are ignored: {}.",
    "orientations-ignored": "Columns that look like an orientation, and so are not causes of errors, "
    "are ignored: {}.",
    "quaternion-ignored": "Columns that look like a quaternion are ignored: {}. Map them to qw qx qy "
    "qz to use them (ABB's q1 is qw).",
    "uncertainties-ignored": "Columns that look like uncertainties of the position, and so are not "
    "causes of errors, are ignored: {}. Map one standard deviation in mm to sx_mm sy_mm sz_mm to "
    "use them.",
}


def find_uncausal_columns(table: Table, taken: Collection[str]) -> dict[str, list[str]]:
    """Find the columns that can be no causes, those that are `taken` otherwise apart, by the code
    of what is said of them. The table has the contract's names."""
    columns = table.columns
    free = [name for name in columns if name not in taken]
    names = [parse_column_name(name, table.units.get(name)) for name in free]
    orientations = find_orientation_columns(table, names)
    quaternion = find_unnamed_quaternion(table, free)
    joints = [name for name in columns if JOINT_COLUMN.fullmatch(name)]
    commanded = _find_commanded_joints(names, len(joints))
    found = {
        "computed-ignored": _find_deviations(names),
        "commanded-ignored": [*_find_commanded(names), *commanded],
        "uncertainties-ignored": _find_stated(names),
        "positions-ignored": _find_positions(names),
        "orientations-ignored": orientations,
        "quaternion-ignored": quaternion,
        "counters-ignored": _find_counters(table, free),
    }
    named = set[str]().union(*found.values())
    unnamed = [name for name in free if name not in named]
    found["positions-ignored"] += find_other_positions(table, unnamed)
    numeric = [name for name in free if _holds_numbers(table, name)]
    distinct = dict[str, list[str]]()
    for code, listed in found.items():
        fresh = [name for name in numeric if name in listed]
        numeric = [name for name in numeric if name not in listed]
        distinct[code] = fresh
    return distinct


def describe_uncausal(found: Mapping[str, Sequence[str]]) -> list[Note]:
    """Say which columns are ignored, and why."""
    notes = []
    for code, names in found.items():
        if not names:
            continue
        listed = ", ".join(map(quote_column, names))
        sentence = SENTENCES[code].format(listed)
        notes.append(Note(code, sentence))
    return notes


def quote_column(name: str) -> str:
    """Quote a column's name, characters that cannot be seen escaped."""
    shown = one_line(name)
    return f'"{shown}"' if shown else NO_NAME


def _holds_numbers(table: Table, name: str) -> bool:
    """Whether some cell of a column is a number."""
    cells = table.columns[name]
    values = convert_to_numbers(cells)
    is_number = np.isfinite(values)
    return bool(is_number.any())


# -- by their names
# --------------------------------------------------------------------------------------------


def _find_commanded(names: Sequence[ColumnName]) -> list[str]:
    """Find commanded coordinates."""
    commanded = []
    for name in names:
        is_coordinate = name.quantity in AXES
        if is_coordinate and name.is_commanded:
            commanded.append(name.given)
    return commanded


def _find_commanded_joints(names: Sequence[ColumnName], joints: int) -> list[str]:
    """Find commanded readings, one for each of so many joints."""
    families = dict[tuple[str, frozenset[str]], list[str]]()
    for name in names:
        is_joint = name.quantity == "joint"
        is_other = name.words & OTHER_QUANTITIES
        if is_other or not is_joint or not name.is_commanded:
            continue
        key = name.stem, name.words
        family = families.setdefault(key, [])
        family.append(name.given)
    commanded = list[str]()
    for family in families.values():
        count = len(family)
        if count >= joints:
            commanded += family
    return commanded


def _find_positions(names: Sequence[ColumnName]) -> list[str]:
    """Find three coordinates of another position, one of each axis, in the order of the axes."""
    families = dict[frozenset[str], dict[str, str]]()
    for name in names:
        numbered = NUMBERED_AXIS.match(name.given)
        axis = name.quantity
        words = name.words
        if numbered is not None:
            axis = numbered[1].lower()
            words = frozenset((numbered[2],))
        others = [word for word in words - MEASURED - POSITION_WORDS if not word.isdigit()]
        if axis in AXES and not others:
            family = families.setdefault(words, {})
            family[axis] = name.given
    return _list_complete(families)


def _list_complete(families: Mapping[frozenset[str], Mapping[str, str]]) -> list[str]:
    """List the columns of the families that have one of each axis."""
    listed = list[str]()
    for family in families.values():
        is_complete = len(family) == len(AXES)
        if is_complete:
            listed += [family[axis] for axis in AXES]
    return listed


def _find_deviations(names: Sequence[ColumnName]) -> list[str]:
    """Find deviations from the nominal position; their size beside components of one."""
    listed = []
    has_components = False
    for name in names:
        if not _is_deviation(name):
            continue
        listed.append(name.given)
        is_component = name.quantity in AXES
        short = name.words & SHORT_DEVIATIONS
        has_components |= is_component or bool(short)
    if not has_components:
        return listed
    return listed + [name.given for name in names if _is_size(name)]


def _is_size(name: ColumnName) -> bool:
    """Whether a name beside deviations along axes says their size."""
    words = name.words
    is_other = name.quantity is not None
    if is_other or not words:
        return False
    return words <= SIZE_WORDS


def _is_deviation(name: ColumnName) -> bool:
    """Whether a name says a deviation of a position, and nothing else."""
    if name.quantity == "joint":
        return False
    marks = DEVIATION_WORDS | SHORT_DEVIATIONS
    if name.quantity in AXES:
        marks |= {"d"}
    usual = MEASURED | COMMANDED | POSITION_WORDS | FIT_WORDS
    others = name.words - usual
    return bool(others) and others <= marks


def find_uncertainties(names: Sequence[ColumnName]) -> list[str]:
    """Find three uncertainties, one of each coordinate, in the order of the axes."""
    families = dict[frozenset[str], dict[str, str]]()
    for name in names:
        axis = _find_uncertain_axis(name)
        if axis is None:
            continue
        words = name.words - SHORT_UNCERTAINTIES
        family = families.setdefault(words, {})
        family[axis] = name.given
    return _list_complete(families)


def _find_stated(names: Sequence[ColumnName]) -> list[str]:
    """Find three uncertainties of the coordinates, and what is stated beside them of their size."""
    found = find_uncertainties(names)
    if not found:
        return []
    sizes = [name.given for name in names if name.words and name.words <= UNCERTAINTY_SIZES]
    return [*found, *sizes]


def _find_uncertain_axis(name: ColumnName) -> str | None:
    """Find the axis of which a name says an uncertainty; None where it says none."""
    words = name.words
    axis = name.quantity
    if axis in AXES and words:
        return axis if words <= UNCERTAINTY_WORDS else None
    for short in SHORT_UNCERTAINTIES:
        if words == {short}:
            return short[1]
    return None


# -- by their values
# --------------------------------------------------------------------------------------------


def _find_counters(table: Table, names: Sequence[str]) -> list[str]:
    """Find columns that count the rows, or the configurations, a few left out or none: the order
    of motion, which has a place of its own."""
    moved = _find_moves(table)
    listed = []
    for name in names:
        values = convert_to_numbers(table.columns[name])
        is_called = name.lower().strip(" .:#") in COUNTER_NAMES
        is_long = len(values) >= MIN_COUNTED
        if (is_called or is_long) and _counts_rows(values, moved):
            listed.append(name)
    return listed


def _find_moves(table: Table) -> NDArray[np.bool_]:
    """Mask (m - 1,) the rows, from the second on, whose joint readings are not those before."""
    steps = max(len(table) - 1, 0)
    moved = np.zeros(steps, bool)
    for name, cells in table.columns.items():
        if not JOINT_COLUMN.fullmatch(name):
            continue
        after = cells[1:]
        before = cells[:-1]
        changed = after != before
        moved |= np.asarray(changed, bool)
    return moved


def _counts_rows(values: Array, moved: NDArray[np.bool_]) -> bool:
    """Whether whole numbers go on by one, with gaps, from row to row or where the arm `moved`."""
    is_number = np.isfinite(values)
    if len(values) < 2 or not is_number.all():
        return False
    steps = np.diff(values)
    is_back = steps < 0
    parts = steps % 1
    is_part = parts > 0
    if is_back.any() or is_part.any():
        return False
    counted = steps[moved] if moved.any() else steps
    least = counted.min()
    usual = np.median(counted)
    return bool(least > 0 and usual == 1)
