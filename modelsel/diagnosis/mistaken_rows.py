"""Mistaken rows: rows far off that a simple slip explains, such as other units, a wrong sign, two
exchanged axes, or the position of the row before."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from .._typing import Array, Index, Mask
from ..exceptions import DataError, NotEstimable
from ..fitting.design import residuals
from ..fitting.problem import Problem
from ..measurements.table import Where
from ..setup.other_robots import describe_improvement
from ..setup.registration import register
from ..setup.simple_mistakes import DEGREE, SCALES, list_axis_changes
from .outliers import compute_lengths, estimate_scale

# robust standard deviations within which a corrected row fits, and how many times farther off it
# must have been: chance does not come so near
MATCH_THRESHOLD = 8.0
MIN_RATIO = 20.0
# mean residual, as a share of the reach, from which slips are looked for before any fit, and the
# factor by which a correction must reduce it
BAD_SHARE = 3e-3
MIN_IMPROVEMENT = 4.0
MAX_ROUNDS = 8
# share of the rows up to which a slip concerns some of them
MAX_SLIPPED_SHARE = 0.5
# smallest scale [mm] of what the rows leave
MIN_SCALE_MM = 1e-6

Residuals = Callable[[Problem], Array]


@dataclass(frozen=True, eq=False)
class Slip:
    """A slip in words, what to do about it, and the readings (m, n) and positions (m, 3) without it;
    `scale`: the factor of the positions where it concerns a unit."""

    words: str
    remedy: str
    q: Array
    position: Array
    scale: float = 1.0

    def correct(self, problem: Problem) -> Problem:
        """Correct every row of a problem."""
        return replace(problem, data=replace(problem.data, q=self.q, position=self.position))


def _generate_slips(problem: Problem) -> Iterator[Slip]:
    """Generate the slips that any row may have."""
    q, x = problem.data.q, problem.data.position
    turns = ~np.array(problem.robot.prismatic)
    for unit in SCALES:
        words = f"in {unit.unit}, not millimetres"
        yield Slip(words, unit.remedy, q, x * unit.scale, unit.scale)
    for axis, other, change in list_axis_changes():
        if other:
            words, remedy = f"{axis} and {other} exchanged", f"exchange {axis} and {other}"
        else:
            words, remedy = f"the wrong sign of {axis}", f"change the sign of {axis}"
        yield Slip(f"given with {words}", remedy, q, x @ change.T)
    for factor, unit_name, other in (
        (1 / DEGREE, "radians", "degrees"),
        (DEGREE, "degrees", "radians"),
    ):
        words = f"given with readings in {unit_name}, not {other}"
        yield Slip(words, "convert the readings", np.where(turns, q * factor, q), x)


def _build_stale(problem: Problem, rows: Mask) -> Slip:
    """Build the slip of positions that were not measured anew: every row has the readings of the one
    before."""
    q = np.roll(problem.data.q, 1, axis=0)
    words, remedy = "given with the position of the row before", "measure them again"
    return Slip(words, remedy, q[rows], problem.data.position[rows])


def describe_slips(
    problem: Problem,
    left: Residuals,
    rows: Mask,
    usual: float | None = None,
    named: Mask | None = None,
) -> tuple[str, ...]:
    """Describe every slip that explains some of the `rows` (mask): how many, where, and how well
    they fit without it.

    `left`: computes residuals (m, c) of a problem under the model. A corrected row fits where it is
    as near as the other rows, or as the `usual` length [mm]. Rows that are `named` (mask) are left
    out."""
    data = problem.data
    is_point = np.ones(len(data), bool) if data.gauges is None else data.gauges.of("point")
    regular, rows = is_point & ~rows, is_point & rows
    if named is not None:
        rows = rows & ~named
    if not rows.any() or not (regular.any() or usual):
        return ()
    if usual is None:
        scale = estimate_scale(compute_lengths(left(problem.take(regular))))
    else:
        scale = usual / np.sqrt(3)
    near = MATCH_THRESHOLD * max(scale, MIN_SCALE_MM)
    selected = problem.take(rows)
    before = compute_lengths(left(selected))
    is_open, sentences = before > MIN_RATIO * near, list[str]()
    for slip in (*_generate_slips(selected), _build_stale(problem, rows)):
        after = compute_lengths(left(slip.correct(selected)))
        explained = is_open & (after < near)
        if explained.any():
            sentences.append(_describe(slip, selected, explained, before, after))
            is_open = is_open & ~explained
    return tuple(sentences)


def _describe(slip: Slip, problem: Problem, rows: Mask, before: Array, after: Array) -> str:
    """Describe a slip of some rows (mask), with the lengths [mm] of all rows before and after."""
    where: Where = problem.data.where
    indices: Index = problem.data.row[rows]
    median_before, median_after = float(np.median(before[rows])), float(np.median(after[rows]))
    is_one = len(indices) == 1
    subject = "1 row is" if is_one else f"{len(indices)} rows are"
    improvement = describe_improvement(median_before, median_after)
    return (
        f"{subject} {slip.words} ({where.spans(indices)}): corrected, "
        f"{'it fits' if is_one else 'they fit'} {improvement} ({median_after:.2g} mm instead of "
        f"{median_before:.3g} mm, median); {slip.remedy} there, or leave "
        f"{'it' if is_one else 'them'} out."
    )


def describe_slip_before_fit(
    problem: Problem, registered: bool, per_group: bool = False
) -> str | None:
    """Describe the slip of some rows that explains what a problem's points leave at its placement
    and tools; None where they leave little, or no slip of less than half of the rows explains it.

    Where placement and tools were found from the rows (`registered`), they are found again with
    every guess."""
    gauges = problem.data.gauges
    points = np.ones(len(problem), bool) if gauges is None else gauges.of("point")
    if not points.any():
        return None
    selected = problem.take(points).plain_points()
    before = compute_lengths(residuals(selected))
    if before.mean() < BAD_SHARE * problem.reach_mm:
        return None
    guesses = [
        (*_find_slipped_rows(selected, slip, registered, per_group), slip)
        for slip in _generate_slips(selected)
    ]
    after, marked, slip = min(guesses, key=lambda guess: float(guess[0].mean()))
    concerns_some = 0 < marked.mean() < MAX_SLIPPED_SHARE
    if not concerns_some or after.mean() > before.mean() / MIN_IMPROVEMENT:
        return None
    return _describe(slip, selected, marked, before, after)


def _find_slipped_rows(
    problem: Problem, slip: Slip, registered: bool, per_group: bool
) -> tuple[Array, Mask]:
    """Find the rows that have a slip, until no row changes sides any more: (lengths (m,) that every
    row leaves, mask of the slipped rows)."""
    marked = _guess_from_lengths(problem, slip)
    current = _correct_rows(problem, slip, marked, registered, per_group)
    given = problem.data
    for _ in range(MAX_ROUNDS):
        as_given = replace(current, data=replace(current.data, q=given.q, position=given.position))
        plain = compute_lengths(residuals(as_given))
        corrected = compute_lengths(residuals(slip.correct(current)))
        again = corrected < plain / 2
        if (again == marked).all():
            break
        marked = again
        current = _correct_rows(problem, slip, marked, registered, per_group)
    return compute_lengths(residuals(current)), marked


def _guess_from_lengths(problem: Problem, slip: Slip) -> Mask:
    """Guess which rows have another unit: those whose distance from the tracker is usual with the
    slip's scale only."""
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
    """Correct the slip in the marked rows, and find tracker and targets again where they were found
    before."""
    data, rows = problem.data, marked[:, None]
    q = np.where(rows, slip.q, data.q)
    position = np.where(rows, slip.position, data.position)
    corrected = replace(problem, data=replace(data, q=q, position=position))
    if not registered or not marked.any():
        return corrected
    try:
        return register(corrected, np.ones(len(corrected), bool), per_group)
    except (DataError, NotEstimable):
        return corrected
