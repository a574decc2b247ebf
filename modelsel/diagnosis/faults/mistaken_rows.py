"""Mistaken rows: rows far off that a simple slip explains, such as other units, a wrong sign, two
exchanged axes, each other's positions, or the position of the row before."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..._typing import Array, Index, Mask
from ...exceptions import DataError, NotEstimable, write_rounded
from ...fitting.design import residuals
from ...fitting.problem import Problem
from ...measurements.formats.row_places import Where
from ...measurements.measurements import Measurements
from ...setup.improvement import BAD_SHARE, MIN_IMPROVEMENT, describe_improvement
from ...setup.registration import register
from ...setup.simple_mistakes import DEGREE, SCALES, list_axis_changes
from .exchanged_rows import put_back_exchanged
from .outliers import MATCH_THRESHOLD, compute_lengths, estimate_scale

# how many times farther off than where it fits a corrected row must have been: chance does not come
# so near
MIN_RATIO = 20.0
MAX_ROUNDS = 8
# share of the rows up to which a slip concerns some of them
MAX_SLIPPED_SHARE = 0.5
# units that rows may have, in mm, and those that a file may say
ROW_UNITS = {unit.unit: unit.scale for unit in SCALES} | {"millimetres": 1.0}
STATED_UNITS = {"mm": "millimetres", "m": "metres", "in": "inches"}
# smallest scale [mm] of what the rows leave
MIN_SCALE_MM = 1e-6

Residuals = Callable[[Problem], Array]


@dataclass(frozen=True, eq=False)
class Slip:
    """A slip in words, what to do about it, and the data without it.

    `q` (m, n) and `position` (m, 3): readings and positions without the slip; `scale`: the factor
    of the positions where it concerns a unit."""

    words: str
    remedy: str
    q: Array
    position: Array
    scale: float = 1.0

    def correct(self, problem: Problem) -> Problem:
        """Correct every row of a problem."""
        data = replace(problem.data, q=self.q, position=self.position)
        return replace(problem, data=data)


@dataclass(frozen=True, eq=False)
class SlippedRows:
    """Rows (m,) that one slip explains, and the sentence on them."""

    rows: Mask
    sentence: str


def _generate_slips(problem: Problem) -> Iterator[Slip]:
    """Generate the slips that any row may have."""
    q = problem.data.q
    x = problem.data.position
    turns = ~np.array(problem.robot.prismatic)
    stated = STATED_UNITS[problem.data.position_unit]
    for name, scale in ROW_UNITS.items():
        if name != stated:
            factor = scale / ROW_UNITS[stated]
            yield Slip(
                words=f"in {name}, not {stated}",
                remedy=_describe_scaling(factor),
                q=q,
                position=x * factor,
                scale=factor,
            )
    for axis, other_axis, change in list_axis_changes():
        words = f"the wrong sign of {axis}"
        remedy = f"change the sign of {axis}"
        if other_axis:
            words = f"{axis} and {other_axis} exchanged"
            remedy = f"exchange {axis} and {other_axis}"
        yield Slip(words=f"given with {words}", remedy=remedy, q=q, position=x @ change.T)
    for factor, unit_name, other_unit in (
        (1 / DEGREE, "radians", "degrees"),
        (DEGREE, "degrees", "radians"),
    ):
        yield Slip(
            words=f"given with readings in {unit_name}, not {other_unit}",
            remedy="convert the readings",
            q=np.where(turns, q * factor, q),
            position=x,
        )


def _describe_scaling(factor: float) -> str:
    """Describe how positions come to the unit that the file says."""
    if factor > 1:
        return f"multiply x, y and z by {factor:.6g}"
    return f"divide x, y and z by {1 / factor:.6g}"


def _build_stale(problem: Problem, rows: Mask) -> Slip:
    """Build the slip of positions that were not measured anew.

    Every row of the mask has the readings of the row of its target that was measured before it in
    its group, and its own where there is none."""
    data = problem.data
    before = _find_rows_before(data)[rows]
    own = np.flatnonzero(rows)
    is_next = (data.row[before] + 1 == data.row[own]) | (before == own)
    which = "the row before"
    if not is_next.all():
        which = "the row of the same target that was measured before"
    return Slip(
        words=f"given with the position of {which}",
        remedy="measure them again",
        q=data.q[before],
        position=data.position[rows],
    )


def _build_exchanged(selected: Problem, left: Array, is_open: Mask, near: float) -> Slip:
    """Build the slip of positions that stand in each other's place, among open rows (mask) of some:
    `left` (m, c) is what these leave, `near` [mm] how near a position is that belongs to a row."""
    data = selected.data
    places = np.flatnonzero(is_open)
    position = data.position[places]
    predicted = position - left[places, :3]
    corrected = data.position.copy()
    corrected[places] = put_back_exchanged(position, predicted, near)
    return Slip(
        words="given with each other's positions",
        remedy="put every position beside its own readings",
        q=data.q,
        position=corrected,
    )


def _find_rows_before(data: Measurements) -> Index:
    """Find of every row (m,) the one of its group and target that was measured before it; itself
    where it is the first."""
    sequence = np.lexsort((data.row, data.order, data.target, data.group))
    earlier, later = sequence[:-1], sequence[1:]
    is_same = data.group[earlier] == data.group[later]
    is_same &= data.target[earlier] == data.target[later]
    before = np.arange(len(data))
    before[later[is_same]] = earlier[is_same]
    return before


def describe_slips(
    problem: Problem,
    left: Residuals,
    rows: Mask,
    usual: float | None = None,
    named: Mask | None = None,
) -> tuple[str, ...]:
    """Describe every slip that explains some of the `rows` (mask), as `explain_rows` finds them."""
    explained = explain_rows(problem, left, rows, usual, named)
    return tuple(each.sentence for each in explained)


def explain_rows(
    problem: Problem,
    left: Residuals,
    rows: Mask,
    usual: float | None = None,
    named: Mask | None = None,
) -> tuple[SlippedRows, ...]:
    """Explain some of the `rows` (mask) by slips.

    A sentence says how many rows, where, and how well they fit without the slip.

    `left`: computes residuals (m, c) of a problem under the model. A corrected row fits where it is
    as near as the other rows, or as the `usual` length [mm]. Rows that are `named` (mask) are left
    out."""
    data = problem.data
    is_point = _mask_points(data)
    regular = is_point & ~rows
    suspected = is_point & rows
    if named is not None:
        suspected = suspected & ~named
    if not suspected.any() or not (regular.any() or usual):
        return ()
    if usual is None:
        of_regular = left(problem.take(regular))
        scale = estimate_scale(compute_lengths(of_regular))
    else:
        scale = usual / np.sqrt(3)
    near = MATCH_THRESHOLD * max(scale, MIN_SCALE_MM)
    far = MIN_RATIO * near
    selected = problem.take(suspected)
    left_selected = left(selected)
    before = compute_lengths(left_selected)
    is_open = before > far
    is_told = np.zeros(len(before), bool)
    places = np.flatnonzero(suspected)
    found = []
    slips = [*_generate_slips(selected)]
    slips.append(_build_exchanged(selected, left_selected, is_open, near))
    slips.append(_build_stale(problem, suspected))
    for slip in slips:
        corrected = slip.correct(selected)
        after = compute_lengths(left(corrected))
        is_near = after < near
        explained = is_open & is_near
        if explained.any():
            # rows that have the slip where it changes little
            is_improved = after < before / MIN_IMPROVEMENT
            explained = ~is_told & is_improved & is_near
            sentence = _describe(slip, selected, explained, before, after)
            slipped = np.zeros(len(data), bool)
            slipped[places[explained]] = True
            found.append(SlippedRows(slipped, sentence))
            is_told |= explained
            is_open &= ~explained
    return tuple(found)


def _mask_points(data: Measurements) -> Mask:
    """Return (m,) which rows are points, not those of a gauge."""
    if data.gauges is None:
        return np.ones(len(data), bool)
    return data.gauges.of("point")


def _describe(slip: Slip, problem: Problem, rows: Mask, before: Array, after: Array) -> str:
    """Describe a slip of some rows (mask), with the lengths [mm] of all rows before and after."""
    where: Where = problem.data.where
    indices: Index = problem.data.row[rows]
    median_before = float(np.median(before[rows]))
    median_after = float(np.median(after[rows]))
    improvement = describe_improvement(median_before, median_after)
    subject = f"{len(indices)} rows are"
    they_fit = "they fit"
    them = "them"
    if len(indices) == 1:
        subject = "1 row is"
        they_fit = "it fits"
        them = "it"
    place = where.spans(indices)
    return (
        f"{subject} {slip.words} ({place}): corrected, {they_fit} {improvement} "
        f"({write_rounded(median_after, 2)} mm instead of {write_rounded(median_before)} mm, median); "
        f"{slip.remedy} there, or leave {them} out."
    )


def describe_slip_before_fit(
    problem: Problem, registered: bool, per_group: bool = False
) -> str | None:
    """Describe the slip of some rows that explains what a problem's points leave before a fit.

    The points are judged at the problem's placement and tools. None where they leave little, or no
    slip of less than half of the rows explains it.

    Where placement and tools were found from the rows (`registered`), they are found again with
    every guess."""
    gauges = problem.data.gauges
    selected = problem
    if gauges is not None:
        is_point = gauges.of("point")
        if not is_point.any():
            return None
        selected = problem.take(is_point)
    selected = selected.plain_points()
    before = compute_lengths(residuals(selected))
    mean_before = before.mean()
    if mean_before < BAD_SHARE * problem.reach_mm:
        return None
    guesses = []
    for slip in _generate_slips(selected):
        after, marked = _find_slipped_rows(selected, slip, registered, per_group)
        mean_after = after.mean()
        guesses.append((mean_after, after, marked, slip))
    mean_after, after, marked, slip = min(guesses, key=lambda guess: float(guess[0]))
    largest_left = mean_before / MIN_IMPROVEMENT
    if not 0 < marked.mean() < MAX_SLIPPED_SHARE:
        return None
    if mean_after > largest_left or not _comes_near(after, marked, problem.reach_mm):
        return None
    return _describe(slip, selected, marked, before, after)


def _comes_near(length: Array, marked: Mask, reach_mm: float) -> bool:
    """Whether corrected rows, by the lengths (m,) [mm] that all leave, come as near as the others,
    or to a small share of the reach."""
    others = float(np.median(length[~marked]))
    near = max(MATCH_THRESHOLD * others, BAD_SHARE * reach_mm)
    corrected = float(np.median(length[marked]))
    return corrected <= near


def _find_slipped_rows(
    problem: Problem, slip: Slip, registered: bool, per_group: bool
) -> tuple[Array, Mask]:
    """Find the rows that have a slip, until no row changes sides any more.

    Returns the lengths (m,) that every row leaves, and the mask of the slipped rows."""
    marked = _guess_from_lengths(problem, slip)
    current = _correct_rows(problem, slip, marked, registered, per_group)
    given = problem.data
    for _ in range(MAX_ROUNDS):
        data_as_given = replace(current.data, q=given.q, position=given.position)
        as_given = replace(current, data=data_as_given)
        left_as_given = residuals(as_given)
        plain = compute_lengths(left_as_given)
        all_corrected = slip.correct(current)
        left_corrected = residuals(all_corrected)
        corrected = compute_lengths(left_corrected)
        again = corrected < plain / 2
        if (again == marked).all():
            break
        marked = again
        current = _correct_rows(problem, slip, marked, registered, per_group)
    length = compute_lengths(residuals(current))
    return length, marked


def _guess_from_lengths(problem: Problem, slip: Slip) -> Mask:
    """Guess which rows have another unit.

    They are those whose distance from the tracker is usual with the slip's scale only."""
    length = np.linalg.norm(problem.data.position, axis=1)
    if slip.scale == 1.0:
        return np.zeros(len(length), bool)
    usual = max(float(np.median(length)), 1e-9)
    scaled = np.log(np.maximum(length * slip.scale, 1e-9) / usual)
    plain = np.log(np.maximum(length, 1e-9) / usual)
    return np.asarray((np.abs(scaled) < 1) & (np.abs(plain) > 1))


def _correct_rows(
    problem: Problem, slip: Slip, marked: Mask, registered: bool, per_group: bool
) -> Problem:
    """Correct the slip in the marked rows.

    Tracker and targets are found again where they were found before."""
    given = problem.data
    rows = marked[:, None]
    data = replace(
        given,
        q=np.where(rows, slip.q, given.q),
        position=np.where(rows, slip.position, given.position),
    )
    corrected = replace(problem, data=data)
    if not registered or not marked.any():
        return corrected
    every_row = np.ones(len(corrected), bool)
    try:
        return register(corrected, every_row, per_group)
    except (DataError, NotEstimable):
        return corrected
