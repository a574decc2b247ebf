"""What a file has in place of columns that it needs, and what to do."""

from __future__ import annotations

import re
import shlex
from collections import defaultdict
from collections.abc import Sequence
from itertools import groupby

from ...exceptions import DataError, count_words, one_line, sentence_list
from ...measurements.formats.column_names import AXES, ColumnName, parse_column_name
from ...measurements.formats.table import Table
from ...measurements.quantities.contract_columns import list_contract_names
from ...measurements.quantities.numbered_joints import describe_missing_joints, find_numbered_joints
from ...measurements.recognition.column_guesses import (
    Choice,
    find_spoilt_cell,
    is_numeric,
    merge_columns,
)
from ...robot.kinematics import Robot
from ...robot.urdf import read_joint_names

# columns that a message names
MAX_SHOWN = 20
NUMBERED_AXIS = re.compile(r"([xyz])[ _]?(\d{1,2})(?![\w.])", re.IGNORECASE)
# numbers in one cell
LIST = re.compile(r"\s*[\[({]\s*[-+.\de]+(\s*[,;\s]\s*[-+.\de]+)+\s*[\])}]\s*", re.IGNORECASE)
# distance, bearing and elevation, as instruments call them
SPHERICAL = (
    frozenset(("range", "distance", "dist", "r", "d")),
    frozenset(("az", "azimuth", "hz", "horizontal", "theta")),
    frozenset(("el", "elevation", "v", "vertical", "zenith", "phi")),
)


def refuse_missing(
    table: Table, choice: Choice, robot: Robot, choices: Sequence[Choice] = ()
) -> DataError:
    """Return the error of a file in which nothing looks like joint readings, or like a position;
    `choices`: what it has of both."""
    spoilt = find_spoilt_cell(table, choice, robot.prismatic, read_joint_names(robot))
    if spoilt is not None:
        return spoilt
    known = (
        _explain_lists(table)
        or _explain_count(table, choice.what, robot)
        or _explain_columns(table, choice.what)
        or _explain_half(table, choice, robot, choices)
    )
    if known is not None:
        what, remedy = known
        return table.where.refuse(what, remedy=remedy)
    is_joints = "joint" in choice.what
    where = table.where
    first, wanted = "x_mm", "x_mm, y_mm and z_mm"
    if is_joints:
        first, wanted = _name_readings(robot.prismatic)
    names = list(table.columns)
    shown = names[:MAX_SHOWN]
    quoted = [f'"{name}"' for name in shown]
    listed = ", ".join(quoted)
    joint_count = count_words(robot.n, "joint")
    joints = f"{robot.name} has {joint_count}"
    return where.refuse(
        f"nothing looks like {choice.what}: {joints}, and the columns are {listed}.",
        remedy=f"Say which they are: --column {first}=NAME, and so on ({wanted}).",
    )


def _explain_half(
    table: Table, choice: Choice, robot: Robot, choices: Sequence[Choice]
) -> tuple[str, str] | None:
    """Say that a file is one of two, points or joint readings alone; None where other columns of
    numbers may be what it lacks, or two files were joined."""
    others = [each for each in choices if each is not choice]
    if table.where.parts or not all(each.readings for each in others):
        return None
    taken = merge_columns([each.readings[0] for each in others])
    own = set(taken.values()) | list_contract_names(robot.prismatic)
    free = [name for name in table.columns if name not in own and is_numeric(table, name)]
    joints = count_words(robot.n, "joint")
    if "joint" not in choice.what:
        if len(free) >= len(AXES):
            return None
        command = f"modelsel init POINTS --joints {shlex.quote(table.where.file)}"
        return (
            "it holds joint readings only.",
            f"Give the file of points, and this one with it: {command}.",
        )
    if len(free) >= robot.n:
        return None
    what = f"it holds points only: no columns look like the readings of {robot.name}'s {joints}."
    return what, "Give the controller's log of them, too: --joints LOG."


def _name_readings(prismatic: Sequence[bool]) -> tuple[str, str]:
    """Name the contract's columns of all joints: (the first, all of them)."""
    names = list[str]()
    for j, slides in enumerate(prismatic, 1):
        unit = "mm" if slides else "deg"
        names.append(f"q{j}_{unit}")
    runs = list[str]()
    for _, run in groupby(names, key=_find_unit):
        first, *others = run
        if others:
            first = f"{first} to {others[-1]}"
        runs.append(first)
    return names[0], sentence_list(runs)


def _find_unit(name: str) -> str:
    """Find the unit in a contract's name."""
    _, _, unit = name.rpartition("_")
    return unit


def _explain_count(table: Table, what: str, robot: Robot) -> tuple[str, str] | None:
    """Say that columns number more or fewer joints than the robot has; None where none do."""
    if "joint" not in what:
        return None
    found = find_numbered_joints(table)
    count = len(found)
    first = min(found, default=0)
    one_by_one = range(first, first + count)
    if first > 1 or set(found) != set(one_by_one):
        return _explain_gap(table, robot)
    if not found or count == robot.n:
        return None
    wanted, _ = _name_readings(robot.prismatic)
    begin, end = found[first].given, found[first + count - 1].given
    option = shlex.quote(f"{wanted}={begin}")
    joints = count_words(robot.n, "joint")
    what = f'"{one_line(begin)}" to "{one_line(end)}" are {count} readings, but {robot.name} has {joints}.'
    return what, f"Check the robot; or say which are its joints: --column {option}, and so on."


def _explain_gap(table: Table, robot: Robot) -> tuple[str, str] | None:
    """Say that some joints have no column where the others have one; None where all have."""
    missing = describe_missing_joints(table, robot.n)
    first, wanted = _name_readings(robot.prismatic)
    remedy = f"Add them; or say which columns are the joints: --column {first}=NAME, and so on ({wanted})."
    if " has no column" in missing:
        remedy = remedy.replace("Add them", "Add it")
    return (missing, remedy) if missing else None


def _explain_lists(table: Table) -> tuple[str, str] | None:
    """Say that cells hold several numbers; None where none does."""
    found = []
    for name, cells in table.columns.items():
        first = str(cells[0]) if len(cells) else ""
        if LIST.fullmatch(first):
            found.append(f'"{one_line(name)}"')
    if not found:
        return None
    listed = sentence_list(found)
    words = "the cells of column {} hold" if len(found) == 1 else "the cells of columns {} hold"
    return (
        f"{words.format(listed)} several numbers each.",
        "Give every number a column of its own: q1_deg, …, x_mm, y_mm, z_mm.",
    )


def _explain_columns(table: Table, what: str) -> tuple[str, str] | None:
    """Say what a file has instead of columns (what is wrong, the remedy); None for nothing that is
    known."""
    names = [parse_column_name(name, table.units.get(name)) for name in table.columns]
    is_joints = "joint" in what
    wanted = ("joint",) if is_joints else AXES
    mixed = _explain_mixed_units(names, wanted, what)
    if mixed is not None or is_joints:
        return mixed
    return _explain_pairs(list(table.columns)) or _explain_spherical(names)


def _explain_mixed_units(
    names: Sequence[ColumnName], wanted: Sequence[str], what: str
) -> tuple[str, str] | None:
    """Say that columns of one kind have several units."""
    called = [name for name in names if name.quantity in wanted]
    found = [name for name in called if name.unit is not None]
    units = {name.unit for name in found}
    if len(units) < 2:
        return None
    listed = ", ".join(f'"{one_line(name.given)}"' for name in found)
    remedy = "Write all of them in one unit, or map each by --column NAME=COLUMN."
    return f"the columns of {what} have several units: {listed}.", remedy


def _explain_pairs(names: Sequence[str]) -> tuple[str, str] | None:
    """Say that rows have several positions: X1 Y1 Z1 X2 Y2 Z2."""
    positions: dict[str, dict[str, str]] = defaultdict(dict)
    for name in names:
        match = NUMBERED_AXIS.match(name)
        if match is not None:
            axes = positions[match[2]]
            axes[match[1].lower()] = name
    whole = [axes for axes in positions.values() if len(axes) == len(AXES)]
    count = len(whole)
    if count < 2:
        return None
    listed = ", ".join(" ".join(axes[axis] for axis in AXES) for axes in whole)
    return (
        f"every row has {count} positions ({listed}).",
        "Write a row for each reflector, with the same readings and its name in a column target.",
    )


def _explain_spherical(names: Sequence[ColumnName]) -> tuple[str, str] | None:
    """Say that positions are a distance and two angles."""
    found = []
    for words in SPHERICAL:
        called = [name.given for name in names if name.words & words]
        found += called[:1]
    if len(found) < len(SPHERICAL):
        return None
    listed = ", ".join(f'"{name}"' for name in found)
    return (
        f"{listed} look like an instrument's distance and angles, which are not read.",
        "Export Cartesian coordinates X, Y, Z from its program.",
    )
