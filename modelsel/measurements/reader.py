"""The contract's columns -> Measurements, from a file or a DataFrame: strict, and every refusal says
place and remedy."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._arguments import check_sliding
from .._typing import Array
from ..exceptions import count_words, suggest
from ..notices import Note
from ..robot.coupling import Coupling, angles_of
from ..robot.files import load_robot
from ..robot.kinematics import Robot
from ..robot.rigid import from_quaternion
from ..robot.urdf import read_joint_names
from .campaign.features import KindColumns
from .campaign.motion import Waypoints
from .campaign.row_order import check_clock, choose_standstill, note_equal_orders
from .campaign.visits import number_keys
from .formats.row_places import Where
from .formats.table import Source, Table, load_table, rename_columns
from .measurements import Measurements, Orientation, build_measurements
from .quantities.board_columns import convert_board_poses
from .quantities.columns import (
    READING_UNITS,
    Mask,
    find_position_unit,
    read_column_set,
    read_coordinates,
    read_names,
    read_numbers,
    read_quantity,
    refuse_degrees,
)
from .quantities.contract_columns import (
    JOINT_COLUMN,
    LABEL_COLUMNS,
    ROTATION_UNCERTAINTY_COLUMNS,
    UNCERTAINTY_COLUMNS,
    check_mapping,
    list_contract_names,
)
from .quantities.duplicates import describe_duplicates, find_copies, find_duplicates
from .quantities.extent import refuse_wide_positions
from .quantities.missed_rows import read_waypoints, split_missed, split_nothing
from .quantities.observation_columns import (
    KIND_COLUMNS,
    read_kinds,
    read_positions,
    read_quaternions,
    read_uncertainties,
)
from .quantities.odd_uncertainties import note_odd_uncertainties
from .quantities.orientation_columns import QUATERNION_COLUMNS, convert_orientations
from .quantities.other_units import convert_mapped
from .quantities.row_names import list_row_names
from .quantities.unit_names import refuse_mapped_units, refuse_other_units
from .recognition.absent_columns import refuse_absent_columns
from .recognition.column_guesses import propose_columns
from .recognition.covariates import read_covariates

ROBOT_EXPECTED = "a Robot, the name of a built-in one, or for each joint whether it slides"
# copies of a single number to one repeat that differs, from which they are taken for copies
COPIES_PER_REPEAT = 10.0


@dataclass(frozen=True, eq=False)
class _Columns:
    """What the columns of a table hold, row by row, before rows that stand in it twice are left
    out; None where there is no such column."""

    q: Array  # (m, n) readings, rad or mm
    position: Array  # (m, 3) mm
    kinds: KindColumns | None
    sigma: Array | None  # (m, 3) mm
    quaternion: Array | None  # (m, 4)
    sigma_rotation: Array | None  # (m, 3) rad
    approach: Array | None  # (m, n)
    labels: Mapping[str, list[str]]  # of the columns LABEL_COLUMNS that there are
    order: Array | None  # (m,)
    covariates: Mapping[str, Array]
    notes: tuple[Note, ...]


def read_measurements(
    source: Source,
    robot: Robot | str | Sequence[bool],
    columns: Mapping[str, str] | None = None,
    group: int | None = None,
    *,
    positions: bool = True,
    once: bool = True,
    used: Collection[str] = (),
) -> Measurements:
    """Read measurements of a robot from a text table, spreadsheet or Parquet file, or a DataFrame.

    source: a path, or a DataFrame with the columns of a measurements file.
    robot: the robot, the name of a built-in one, or which of its joints are prismatic where none are coupled.
    columns: contract name -> name in the file, where they differ.
    group: one row group of a Parquet file; None reads all.
    positions: whether positions must be there; absent ones are NaN.
    once: whether a measurement that stands in the file twice counts once.
    used: columns that the caller reads himself, such as the split's: they are not said to be ignored.

    Raises DataError with file, line and column, or row (from 0) and column of the DataFrame;
    StudyError for a name that the contract does not have."""
    prismatic, coupling, names = tuple[bool, ...](), None, tuple[str, ...]()
    if isinstance(robot, str):
        robot = load_robot(robot)
    if isinstance(robot, Robot):
        prismatic, coupling, names = robot.prismatic, robot.coupling, read_joint_names(robot)
    else:
        prismatic = check_sliding("robot", robot, ROBOT_EXPECTED)
    mapping = {} if columns is None else columns
    whole = _load_contract_table(source, group, mapping, prismatic, positions, names)
    split = split_missed(whole) if positions else split_nothing(whole)
    waypoints, missed = read_waypoints(split, prismatic, coupling)
    table = convert_board_poses(convert_orientations(split.kept))
    content = _read_columns(table, prismatic, positions, used)
    keep, notes = np.ones(len(table), bool), list[Note]()
    if once:
        keep, notes = _find_distinct_rows(table, content)
    notes += note_odd_uncertainties(content.sigma, content.sigma_rotation)
    data = _select_rows(content, keep, split.rows, prismatic, coupling, waypoints)
    if content.order is not None:
        standstill = choose_standstill(prismatic)
        notes += note_equal_orders(
            data.order, data.readings, data.group, data.row, whole.where, standstill
        )
        check_clock(data.order, data.covariates.get("time_s"), data.group, data.row, whole.where)
    if positions and isinstance(robot, Robot):
        refuse_wide_positions(table, robot, data.position, data.group)
    units = _find_reading_units(table, prismatic)
    if coupling is not None:
        notes.append(Note("coupled-joints", coupling.describe_readings()))
    said = (*table.notes, *missed, *content.notes, *notes, *data.notes)
    where = replace(whole.where, labels=list_row_names(table, split.rows))
    unit = find_position_unit(table)
    return replace(data, notes=said, where=where, units=units, position_unit=unit)


def _load_contract_table(
    source: Source,
    group: int | None,
    mapping: Mapping[str, str],
    prismatic: Sequence[bool],
    positions: bool,
    joint_names: Sequence[str] = (),
) -> Table:
    """Load the table under the contract's names; refuse wrong mappings and foreign units."""
    check_mapping(mapping, prismatic)
    table = load_table(source, group)
    table, converted = convert_mapped(table, mapping, prismatic)
    rest = {name: own for name, own in mapping.items() if own not in converted}
    refuse_mapped_units(rest, prismatic, table)
    table = rename_columns(table, mapping)
    has_kinds = "kind" in table and "feature" in table
    known = list_contract_names(prismatic)
    if not has_kinds:
        known -= set(KIND_COLUMNS)
    proposal = None
    if not has_kinds:
        proposal = propose_columns(table, prismatic, joint_names, positions)
    if proposal is not None:
        raise proposal
    refuse_other_units(table, known, prismatic, has_kinds)
    return table


def _read_columns(
    table: Table, prismatic: Sequence[bool], positions: bool, used: Collection[str] = ()
) -> _Columns:
    """Read and check all columns of a table."""
    refuse_absent_columns(table, prismatic, positions)
    q = _read_joints(table, prismatic)
    kinds = read_kinds(table)
    position = read_coordinates(table, positions) if kinds is None else read_positions(table, kinds)
    table.require_rows("measured point")
    sigma, quaternion, sigma_rotation = _read_uncertainties(table, kinds)
    approach = _read_approach(table, len(prismatic))
    labels = {name: read_names(table, name) for name in LABEL_COLUMNS if name in table}
    order = read_numbers(table, "order") if "order" in table else None
    covariates, notes = read_covariates(table, prismatic, kinds is not None, used)
    if "configuration" in labels:
        _check_configurations(labels["configuration"], q, prismatic, table.where)
    return _Columns(
        q,
        position,
        kinds,
        sigma,
        quaternion,
        sigma_rotation,
        approach,
        labels,
        order,
        covariates,
        tuple(notes),
    )


def _select_rows(
    columns: _Columns,
    keep: Mask,
    places: NDArray[np.intp],
    prismatic: Sequence[bool],
    coupling: Coupling | None,
    waypoints: Waypoints | None,
) -> Measurements:
    """Build the measurements of some rows; `places` (m,): the rows of the file that all are."""
    rows = slice(None) if keep.all() else keep

    def select(values: Any) -> Any:
        return None if values is None else np.asarray(values)[rows]

    orientation = None
    if columns.quaternion is not None:
        rotation = from_quaternion(columns.quaternion[rows])
        orientation = Orientation(rotation, select(columns.sigma_rotation))
    labels = {name: select(names) for name, names in columns.labels.items()}
    return build_measurements(
        angles_of(coupling, columns.q[rows]),
        columns.position[rows],
        row=places[keep],
        **labels,
        order=select(columns.order),
        approach=select(columns.approach),
        covariates={name: values[rows] for name, values in columns.covariates.items()},
        sigma=select(columns.sigma),
        orientation=orientation,
        kinds=None if columns.kinds is None else columns.kinds.take(keep),
        prismatic=prismatic,
        coupling=coupling,
        waypoints=waypoints,
    )


# -- columns
# --------------------------------------------------------------------------------------------


def _read_joints(table: Table, prismatic: Sequence[bool]) -> Array:
    """Read joint readings (m, n); refuse degrees in radians, and joints that the robot lacks."""
    columns = []
    for j, slides in enumerate(prismatic, 1):
        q = read_quantity(table, f"q{j}", READING_UNITS[slides])
        if not slides and f"q{j}_rad" in table:
            refuse_degrees(table, j, q)
        columns.append(q)
    joint_count = len(prismatic)
    for name in table.columns:
        match = JOINT_COLUMN.fullmatch(name)
        if match and not 1 <= int(match[1]) <= joint_count:
            table_words = "the file" if table.where.is_file else "it"
            count = count_words(joint_count, "joint")
            raise table.where.refuse(
                f"{table_words} has a joint q{int(match[1])}, but the robot has {count}.",
                column=name,
                remedy="Check the robot's name in the study, or rename the column.",
            )
    return np.stack(columns, 1)


def _find_reading_units(table: Table, prismatic: Sequence[bool]) -> tuple[str, ...]:
    """Find the unit in which each joint's readings were given."""
    units = []
    for j, slides in enumerate(prismatic, 1):
        units.append(next(u for u in READING_UNITS[slides] if f"q{j}_{u}" in table))
    return tuple(units)


def _read_uncertainties(
    table: Table, kinds: KindColumns | None
) -> tuple[Array | None, Array | None, Array | None]:
    """Read (standard uncertainties [mm], quaternions, their standard uncertainties [rad])."""
    if kinds is not None:
        return read_uncertainties(table, kinds), *read_quaternions(table, kinds)
    return (
        read_column_set(table, UNCERTAINTY_COLUMNS, "not positive"),
        read_column_set(table, QUATERNION_COLUMNS, "not unit"),
        read_column_set(table, ROTATION_UNCERTAINTY_COLUMNS, "not positive"),
    )


def _read_approach(table: Table, joints: int) -> Array | None:
    """Read directions of approach (m, n), each -1, 0 or +1."""
    approach = read_column_set(table, [f"approach{j}" for j in range(1, joints + 1)])
    if approach is None:
        return None
    wrong = np.argwhere(~np.isin(approach, (-1.0, 0.0, 1.0)))
    if len(wrong):
        row, joint = wrong[0]
        raise table.where.refuse(
            "a direction of approach is -1, 0 or +1.",
            row=int(row),
            column=f"approach{joint + 1}",
            remedy="Correct the cell, or leave the approach columns out.",
        )
    return approach


def _check_configurations(
    names: list[str], q: Array, prismatic: Sequence[bool], where: Where
) -> None:
    """Refuse a configuration whose rows have other joint readings than an arm that stands still
    has, read again."""
    first_rows: dict[str, int] = {}
    first = np.array([first_rows.setdefault(name, row) for row, name in enumerate(names)])
    tolerance = choose_standstill(prismatic)
    difference = np.abs(q - q[first])
    is_moved = (difference > tolerance).any(1)
    moved = np.flatnonzero(is_moved)
    if len(moved):
        row = int(moved[0])
        earlier = where.name_row(int(first[row]))
        raise where.refuse(
            f'configuration "{names[row]}" has other joint readings on {earlier}.',
            row=row,
            column="configuration",
            remedy="Rows that share a configuration share its readings; give every configuration "
            "a number of its own, through all groups.",
        )


# -- rows that stand in a file twice
# --------------------------------------------------------------------------------------------


def _find_distinct_rows(table: Table, columns: _Columns) -> tuple[Mask, list[Note]]:
    """Find ((m,) rows that count, what is said of the others): a measurement that stands in the
    file twice is one."""
    notes = []
    repeated = find_duplicates(table.columns, len(table))
    if repeated.any():
        sentence = describe_duplicates(int(repeated.sum()))
        notes.append(Note("duplicate-rows", sentence))
    rows = np.flatnonzero(~repeated)
    values, attributes, repeats = _list_compared(columns)
    copied, example = find_copies(
        columns.q[rows], values[rows], [a[rows] for a in attributes], repeats[rows]
    )
    if example is not None:
        later, earlier = (table.where.name_row(int(rows[k])) for k in example)
        rows_hold = "1 row holds" if copied.sum() == 1 else f"{int(copied.sum())} rows hold"
        sentence = (
            f"{rows_hold} the readings and the position of an earlier row to the last digit, under "
            f"another number, time or name ({later} is {earlier} again): taken for copies and "
            "counted once."
        )
        notes.append(Note("copied-rows", sentence))
    distinct = ~repeated
    distinct[rows[copied]] = False
    return distinct, notes


def _list_compared(columns: _Columns) -> tuple[Array, list[Array], Array]:
    """List what identifies copies: the measured values (m, 3), other attributes (m,), and how many
    copies a repeat outweighs (see `find_copies`).

    Of kinds the value is what each row measures, zero where it measures nothing, and the
    attributes include what the row is of. Repeats of a single number agree easily. A row that
    measures nothing (a touch) is its readings: the same again to the last digit says nothing
    more."""
    attributes = list[Array]()
    if columns.quaternion is not None:
        attributes += list(columns.quaternion.T)
    if "target" in columns.labels:
        attributes.append(np.asarray(number_keys(columns.labels["target"])[0], float))
    for name in ("payload_kg", "temperature_C"):
        if name in columns.covariates:
            attributes.append(columns.covariates[name])
    kinds = columns.kinds
    if kinds is None:
        return columns.position, attributes, np.ones(len(columns.position))
    values = np.nan_to_num(columns.position)
    values[:, 0] += np.nan_to_num(kinds.length)
    begins = kinds.of("distance") & np.isnan(kinds.length)
    identity = (number_keys(kinds.kind)[0], number_keys(kinds.feature)[0], begins)
    attributes += [np.asarray(column, float) for column in identity]
    whole, touches = kinds.of("point"), kinds.of("ball-bar", "same-point", "plane")
    repeats = np.select([whole, touches], [1.0, 0.0], COPIES_PER_REPEAT)
    return values, attributes, repeats


def read_labels(source: Source, column: str) -> NDArray[np.object_]:
    """Read a text column (the split's) of every row of the file or DataFrame. Raises DataError."""
    table = load_table(source)
    if column not in table:
        raise table.where.refuse(
            f'the study\'s split column "{column}" is missing. {suggest(column, table.columns)}'
        )
    return np.array(read_names(table, column), dtype=object)
