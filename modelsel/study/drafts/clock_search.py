"""Whether the clocks of an instrument's points and of a joint log differ, as the nominal arm tells, and
what is said of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from ..._typing import Array
from ...exceptions import DataError, ModelselError, write_rounded
from ...measurements.campaign.row_order import choose_standstill
from ...measurements.formats.table import Table
from ...measurements.pairing.clock_offset import find_clock_offset
from ...measurements.pairing.joining import Join, find_joins
from ...measurements.pairing.nearest_times import Clocks, find_nearest_times, read_clocks
from ...measurements.quantities.columns import UNITS, convert_to_numbers
from ...measurements.quantities.contract_columns import list_contract_names
from ...measurements.quantities.other_units import convert_mapped
from ...robot.kinematics import Robot
from ...setup.clock_fit import MIN_POINTS, ClockFit, fit_clock_offset
from ...setup.other_robots import MAX_REACH_SHARE
from .new_study import StudyDraft
from .nominal_misfit import CLEAR_FACTOR, measure_misfit

UNEXPLAINED = (
    "The files were joined by time. Where the two clocks differ, points have the readings of other "
    "moments: check both clocks, and say --clock-offset."
)
NOT_FOUND = "No offset was found at which the nominal arm fits."
NOT_LOOKED_FOR = (
    "An offset at which the nominal arm fits was not looked for, since the joint log's readings and the "
    f"positions and times of {MIN_POINTS} points are needed for that."
)

# share of the points with the readings of an arm in motion from which that is said; up to which it is
# no campaign in motion
MIN_MOVING = 0.05
MAX_MOVING = 0.9
# reads the columns of two tables that are joined so
Drafter: TypeAlias = Callable[[Join], StudyDraft]


@dataclass(frozen=True)
class OtherClock:
    """An offset of the log's clock at which the nominal arm fits, to `misfit` mm."""

    fit: ClockFit
    misfit: float

    @property
    def remedy(self) -> str:
        """Say how well the nominal arm fits then, the option, and which offsets do as well."""
        fit = self.fit
        misfit = write_rounded(self.misfit)
        way = "ahead of" if fit.seconds > 0 else "behind"
        return (
            f"With the joint log's clock {abs(fit.seconds):.6g} s {way} the instrument's, the nominal "
            f"arm fits to {misfit} mm: say --clock-offset {fit.seconds:.6g} "
            f"({fit.least:.6g} to {fit.most:.6g} s fit alike)."
        )


def measure_draft(draft: StudyDraft) -> float:
    """Compute how far the positions of a draft are from the nominal arm [mm]; infinite where that
    cannot be told."""
    try:
        misfit = measure_misfit(draft.robot, draft.read())
    except ModelselError:
        return float("inf")
    return float("inf") if misfit is None else misfit


def propose_offset(
    points: Table, log: Table, robot: Robot, draft_join: Drafter, max_gap: float
) -> OtherClock | str:
    """Propose an offset of the log's clock for two tables that have times: that at which the nominal
    arm fits their rows; where there is none what is said of that."""
    timed = _read_timed(points, log, draft_join)
    if timed is None:
        return NOT_LOOKED_FOR
    fit = fit_clock_offset(robot, timed.clocks, timed.position, timed.q, max_gap)
    if fit is None:
        return NOT_FOUND
    try:
        joins, _ = find_joins(points, log, max_gap, fit.seconds)
        if "time" not in joins:
            return NOT_FOUND
        joined = draft_join(joins["time"])
    except ModelselError:
        return NOT_FOUND
    misfit = measure_draft(joined)
    if not misfit <= MAX_REACH_SHARE * robot.reach:
        return NOT_FOUND
    return OtherClock(fit, misfit)


def advise_on_clocks(
    points: Table, log: Table, robot: Robot, draft_join: Drafter, max_gap: float
) -> str:
    """Say at which offset of the log's clock the nominal arm fits two files that nothing joins; empty
    where the gaps between their times tell an offset already, or none fits."""
    clocks = read_clocks(points, log)
    if isinstance(clocks, str):
        return ""
    if find_clock_offset(clocks.points, clocks.log, max_gap) is not None:
        return ""
    other = propose_offset(points, log, robot, draft_join, max_gap)
    return "" if isinstance(other, str) else other.remedy


def check_clocks(
    points: Table,
    log: Table,
    drafts: Mapping[str, StudyDraft],
    draft_join: Drafter,
    max_gap: float,
    clock_offset: float,
) -> str:
    """Check files that were joined by time, where the nominal arm fits them by no way, or some points
    have the readings of an arm in motion; return what is to be said. Raises DataError where the arm
    fits with another offset of the clocks alone."""
    if "time" not in drafts:
        return ""
    robot = drafts["time"].robot
    misfits = {way: measure_draft(draft) for way, draft in drafts.items()}
    least = min(misfits.values())
    is_far = MAX_REACH_SHARE * robot.reach < least < np.inf
    if not is_far and misfits["time"] > least:
        return ""
    said = ""
    if not is_far:
        said = _describe_moving(points, log, drafts["time"], max_gap, clock_offset)
        if not said:
            return ""
    other = propose_offset(points, log, robot, draft_join, max_gap)
    if not is_far:
        return said + _add_remedy(other, clock_offset)
    if isinstance(other, str):
        return f"{UNEXPLAINED} {other}"
    if least < CLEAR_FACTOR * other.misfit:
        return f"{UNEXPLAINED} {NOT_FOUND}"
    raise DataError(
        "joined by time as the clocks are, the nominal arm fits the points to "
        f"{write_rounded(misfits['time'])} mm: the clocks of the two files differ.",
        file=points.where.file,
        remedy=other.remedy,
    )


def _add_remedy(other: OtherClock | str, clock_offset: float) -> str:
    """Return the remedy to add where the arm fits with an offset of the clocks that differs from the
    present one."""
    if isinstance(other, str):
        return ""
    fit = other.fit
    if fit.least <= clock_offset <= fit.most:
        return ""
    remedy = other.remedy
    return f" {remedy}"


def _describe_moving(
    points: Table, log: Table, draft: StudyDraft, max_gap: float, clock_offset: float
) -> str:
    """Say how many points have the readings of an arm in motion; nothing where hardly any has, or
    nearly all have, as of a campaign in motion."""
    clocks = read_clocks(points, log, clock_offset)
    robot = draft.robot
    q = _read_columns(log, draft, [f"q{j}_" for j in range(1, robot.n + 1)])
    if isinstance(clocks, str) or q is None:
        return ""
    q = q[clocks.log_rows]
    order = np.argsort(clocks.log, kind="stable")
    times = clocks.log[order]
    place = find_nearest_times(times, clocks.points)
    is_near = np.abs(times[place] - clocks.points) <= max_gap
    before = np.maximum(place - 1, 0)
    after = np.minimum(place + 1, len(times) - 1)
    is_dense = times[after] - times[before] <= 2 * max_gap
    travel = np.abs(q[order[after]] - q[order[before]])
    moves = (travel > choose_standstill(robot.prismatic)).any(axis=1)
    moving = int((is_near & is_dense & moves).sum())
    count = int(is_near.sum())
    if not MIN_MOVING * count < moving < MAX_MOVING * count:
        return ""
    return (
        f"{moving:,} of {count:,} points have the readings of an arm in motion: if it stood when they "
        "were measured, the clocks differ."
    )


@dataclass(frozen=True, eq=False)
class _Timed:
    """The times of two files, positions (m, 3) [mm] of the points and readings q (n, joints) of the log
    that have one."""

    clocks: Clocks
    position: Array
    q: Array


def _read_timed(points: Table, log: Table, draft_join: Drafter) -> _Timed | None:
    """Read what tells an offset of the clocks; None where something of it is lacking, or too few
    points have it."""
    count = min(len(points), len(log))
    any_rows = np.arange(count)
    try:
        draft = draft_join(Join("order", any_rows, any_rows, ""))
    except ModelselError:
        return None
    clocks = read_clocks(points, log)
    joints = range(1, draft.robot.n + 1)
    names = [f"q{j}_" for j in joints]
    q = _read_columns(log, draft, names)
    position = _read_columns(points, draft, ["x_", "y_", "z_"])
    if isinstance(clocks, str):
        return None
    if q is None or position is None:
        return None
    timed = position[clocks.point_rows]
    is_measured = np.isfinite(timed).all(axis=1)
    if is_measured.sum() < MIN_POINTS:
        return None
    measured = replace(
        clocks, points=clocks.points[is_measured], point_rows=clocks.point_rows[is_measured]
    )
    return _Timed(measured, timed[is_measured], q[clocks.log_rows])


def _read_columns(table: Table, draft: StudyDraft, beginnings: Sequence[str]) -> Array | None:
    """Read columns (m, k) by the beginnings of their contract's names, in rad or mm, as a draft has
    them, or as they are called so already; nan where a cell is no number, None where the table lacks
    one."""
    mapped = draft.columns
    prismatic = draft.robot.prismatic
    own = {name: given for name, given in mapped.items() if given in table}
    known = list_contract_names(prismatic) - {*mapped, *mapped.values()}
    own |= {name: name for name in table.columns if name in known}
    converted, _ = convert_mapped(table, own, prismatic)
    values = []
    for beginning in beginnings:
        name = next((each for each in own if each.startswith(beginning)), None)
        if name is None:
            return None
        cells = convert_to_numbers(converted.columns[own[name]])
        size = UNITS[name.removeprefix(beginning)]
        values.append(cells * size)
    return np.stack(values, 1)
