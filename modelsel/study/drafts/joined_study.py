"""A study from two files: the points that an instrument measured, and a log of joint readings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ...exceptions import DataError, write_rounded
from ...measurements.formats.file_form import FileForm
from ...measurements.formats.full_names import split_full_names
from ...measurements.formats.table import DataFile, Table, load_table
from ...measurements.pairing.join_sentences import describe_join
from ...measurements.pairing.joined_waypoints import add_waypoints
from ...measurements.pairing.joining import (
    WAYS,
    Join,
    find_joins,
    find_reflectors,
    find_repeated_reading,
    join_tables,
    refuse_join,
    refuse_swapped,
)
from ...measurements.quantities.columns import convert_to_numbers
from ...measurements.quantities.point_times import (
    find_common_seconds,
    find_times,
    list_clock_columns,
)
from ...measurements.recognition.headerless_columns import name_columns
from ...robot.kinematics import Robot
from ...setup.other_robots import MAX_REACH_SHARE
from .clock_search import advise_on_clocks, check_clocks
from .new_study import StudyDraft, draft_study
from .nominal_misfit import CLEAR_FACTOR, measure_misfit

# seconds that the times of a point and of its readings may differ
MAX_GAP_S = 0.5


def draft_joined_study(
    points: DataFile,
    log: DataFile,
    robot: Robot,
    given: Mapping[str, str],
    way: str | None = None,
    max_gap: float = MAX_GAP_S,
    clock_offset: float = 0.0,
) -> StudyDraft:
    """Join points with joint readings and read the columns of both; `way`: by name, time or order,
    else the one that fits;
    `clock_offset`: seconds by which the log's clock is ahead. Raises DataError where none fits, or two that differ do."""
    measured = _load_named(points, robot)
    readings = _load_named(log, robot)
    swapped = refuse_swapped(measured, readings)
    if swapped is not None:
        raise swapped

    def draft_join(join: Join) -> StudyDraft:
        return _draft_join(measured, readings, join, robot, given)

    joins, reasons = find_joins(measured, readings, max_gap, clock_offset)
    wanted = WAYS if way is None else (way,)
    joins = {each: join for each, join in joins.items() if each in wanted}
    if way is None and set(joins) == {"order"}:
        _refuse_repeated_names(measured, readings)
    if not joins:
        advice = ""
        if "time" in wanted:
            advice = advise_on_clocks(measured, readings, robot, draft_join, max_gap)
        raise refuse_join(measured, readings, reasons, wanted, advice)
    drafts = {}
    for each, join in _drop_equal(joins).items():
        drafts[each] = draft_join(join)
    doubt = check_clocks(measured, readings, drafts, draft_join, max_gap, clock_offset)
    chosen, reason = _choose_way(drafts, joins, measured)
    draft = drafts[chosen]
    for sentence in (*describe_join(measured, readings, joins[chosen], max_gap), doubt, reason):
        if sentence:
            draft = draft.remark(sentence)
    times = find_times(measured)
    is_timed = find_common_seconds(measured, readings) is not None
    if times is not None and is_timed and "time_s" not in measured:
        draft = draft.remark(f'"{times.column}" of the points is time_s, from the first point on.')
    return draft


def _refuse_repeated_names(points: Table, log: Table) -> None:
    """Refuse to join row by row where names would join, did some not stand twice. Raises
    DataError."""
    repeated = find_repeated_reading(points, log)
    if repeated is None:
        return
    raise DataError(
        f"the points have the names of {log.where.file}, but cannot be joined by them: {repeated}.",
        file=points.where.file,
        remedy="Give every row of readings a name of its own; or say --join order, if the rows are in "
        "the same order.",
    )


def map_later_columns(
    points: DataFile, log: DataFile, robot: Robot, form: FileForm, columns: Mapping[str, str]
) -> dict[str, str]:
    """Map the columns of two files of the form of a study's: those that the user maps, `columns`,
    then the others that they have under the names of the study's files."""
    measured = _load_named(points, robot)
    readings = _load_named(log, robot)
    given = dict(columns)
    for wanted, name in form.joined.items():
        is_there = name in measured or name in readings
        taken = given.values()
        if wanted in given or name in taken:
            continue
        if is_there:
            given[wanted] = name
    return given


def _load_named(file: DataFile, robot: Robot) -> Table:
    """Load a file, with names for its columns where it has no header."""
    source = replace(file, headerless=True)
    table = load_table(source)
    table.require_rows("measured point")
    named = name_columns(table, robot.n)
    return split_full_names(named)


def _draft_join(
    points: Table, log: Table, join: Join, robot: Robot, given: Mapping[str, str]
) -> StudyDraft:
    """Read the columns of two tables joined one way; rows that share their readings and stand apart
    are of several reflectors."""
    matched = join_tables(points, log, join)
    reflectors = find_reflectors(matched, np.sort(join.log))
    whole = add_waypoints(matched, points, log, join)
    used = _list_joining_columns(points, log, join) - {*given.values(), "time_s"}
    columns = {name: cells for name, cells in whole.columns.items() if name not in used}
    joined = replace(whole, columns=columns)
    if reflectors is None or "target" in given or "target" in joined:
        return draft_study(joined, robot, given)
    draft = draft_study(joined, robot, {**given, "target": reflectors})
    return draft.remark(f'"{reflectors}" tells the reflectors of one configuration apart.')


def _list_joining_columns(points: Table, log: Table, join: Join) -> set[str]:
    """List the columns of numbers that the join has used, which are no causes: the names in the
    log, and the times that `time_s` is made of."""
    used = set[str]()
    if join.key and join.key not in points:
        names = log.columns[join.key]
        values = convert_to_numbers(names)
        is_number = np.isfinite(values)
        if is_number.all():
            used.add(join.key)
    is_timed = find_common_seconds(points, log) is not None
    is_there = "time_s" in points or "time_s" in log
    if is_timed and not is_there:
        for table in (points, log):
            clocks = list_clock_columns(table)
            used.update(clocks)
    return used


def _drop_equal(joins: Mapping[str, Join]) -> dict[str, Join]:
    """Drop ways that join the rows as one before does, and one by times of which some are not given as
    far as another joins its rows alike; names go before everything else."""
    if "name" in joins:
        return {"name": joins["name"]}
    kept: dict[str, Join] = {}
    for way, join in joins.items():
        others = kept.values()
        is_new = not any(join.is_like(other) for other in others)
        all_others = [other for other in joins.values() if other is not join]
        is_part = join.blank and any(map(join.is_within, all_others))
        if is_new and not is_part:
            kept[way] = join
    return kept


def _choose_way(
    drafts: Mapping[str, StudyDraft], joins: Mapping[str, Join], points: Table
) -> tuple[str, str]:
    """Choose the way by which the nominal arm fits clearly better, and say why. Raises DataError
    where the arm leaves it open."""
    ways = list(drafts)
    if len(ways) == 1:
        return ways[0], ""
    misfits = {}
    for way, draft in drafts.items():
        misfit = measure_misfit(draft.robot, draft.read())
        misfits[way] = float("inf") if misfit is None else misfit
    best, second = sorted(ways, key=lambda way: misfits[way])[:2]
    is_good = misfits[best] <= MAX_REACH_SHARE * drafts[best].robot.reach
    if is_good and misfits[second] >= CLEAR_FACTOR * misfits[best]:
        other = (
            f"{write_rounded(misfits[second])} mm" if np.isfinite(misfits[second]) else "not at all"
        )
        return best, (
            f"Joined by {best}, the nominal arm fits to {write_rounded(misfits[best])} mm; by {second}: {other}."
        )
    listed = "; or ".join(f"{joins[way].words} ({write_rounded(misfits[way])} mm)" for way in ways)
    raise DataError(
        f"the files can be joined in two ways that differ, and the nominal arm fits neither clearly "
        f"better: {listed}.",
        file=points.where.file,
        remedy=f"Say which: --join {' or --join '.join(ways)}.",
    )
