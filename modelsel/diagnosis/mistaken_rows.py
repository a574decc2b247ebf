"""Rows far off that a simple slip explains: other units, a sign, two axes that changed places, a
position of the row before."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .._typing import Array, Index
from ..exceptions import DataError, NotEstimable
from ..fitting.design import residuals
from ..fitting.problem import Problem
from ..measurements.table import Where
from ..setup.other_robots import describe_improvement
from ..setup.registration import register
from ..setup.simple_mistakes import DEGREE, SCALES, list_axis_changes
from .outliers import MATCH, estimate_scale

# times as near as a row comes by a slip, a row has to be off: chance does not come so near
MIN_RATIO = 20.0
Residuals = Callable[[Problem], Array]
BAD = 3e-3  # of the reach: a mean residual from which slips are looked for before any fit,
FACTOR = 4.0  # and are said where without them the positions fit so much better
ROUNDS = 8


@dataclass(frozen=True, eq=False)
class Slip:
    """What is wrong in words, what to do about it, the readings (m, n) and positions (m, 3) as they
    would be without; `scale` of the positions where it is a unit's."""

    words: str
    remedy: str
    q: Array
    position: Array
    scale: float = 1.0


def _slips(problem: Problem) -> Iterator[Slip]:
    q, x, turns = problem.data.q, problem.data.position, ~np.array(problem.robot.prismatic)
    yield from (
        Slip(f"in {u.unit}, not millimetres", u.remedy, q, x * u.scale, u.scale) for u in SCALES
    )
    for axis, other, B in list_axis_changes():
        words, remedy = (
            (f"{axis} and {other} in each other's place", f"let {axis} and {other} change places")
            if other
            else (f"the wrong sign of {axis}", f"change the sign of {axis}")
        )
        yield Slip(f"given with {words}", remedy, q, x @ B.T)
    for factor, unit, others in (
        (1 / DEGREE, "radians", "degrees"),
        (DEGREE, "degrees", "radians"),
    ):
        words = f"given with readings in {unit}, not {others}"
        yield Slip(words, "convert the readings", np.where(turns, q * factor, q), x)


def describe_slips(
    problem: Problem,
    left: Residuals,
    rows: NDArray[np.bool_],
    usual: float | None = None,
    named: NDArray[np.bool_] | None = None,
) -> tuple[str, ...]:
    """A sentence for every slip that explains some of the `rows` (mask): how many, where, and how
    well they fit without. `left`: residuals (m, c) of a problem under the model; near is what the
    other rows leave, or some times the `usual` length [mm]. Rows that are `named` (mask) are said
    already."""
    data = problem.data
    points = np.ones(len(data), bool) if data.gauges is None else data.gauges.of("point")
    calm, rows = points & ~rows, points & rows & (True if named is None else ~named)
    if not rows.any() or not (calm.any() or usual):
        return ()
    near = MATCH * max(
        estimate_scale(_length(left(problem.take(calm)))) if usual is None else usual / np.sqrt(3),
        1e-6,
    )
    some = problem.take(rows)
    before = _length(left(some))
    still, out = before > MIN_RATIO * near, list[str]()
    for slip in (*_slips(some), _stale(problem, rows)):
        changed = replace(some, data=replace(some.data, q=slip.q, position=slip.position))
        after = _length(left(changed))
        good = still & (after < near)
        if good.any():
            medians = float(np.median(before[good])), float(np.median(after[good]))
            out.append(_said(slip, some.data.where, some.data.row[good], *medians))
            still = still & ~good
    return tuple(out)


def _said(slip: Slip, where: Where, rows: Index, before: float, after: float) -> str:
    is_, fit, them = ("is", "it fits", "it") if len(rows) == 1 else ("are", "they fit", "them")
    return (
        f"{len(rows)} row{'s' * (len(rows) > 1)} {is_} {slip.words} ({where.spans(rows)}): corrected, {fit} "
        f"{describe_improvement(before, after)} ({after:.2g} mm in place of {before:.3g} mm, median); "
        f"{slip.remedy} there, or leave {them} out."
    )


def describe_slip_before_fit(
    problem: Problem, registered: bool, per_group: bool = False
) -> str | None:
    """A sentence on the slip of some rows that explains what a problem's points leave at its
    placement and tools; None where they leave little, or no slip of less than half of the rows
    explains it. Where placement and tools were found from the rows (`registered`), they are found
    again with every guess."""
    points = (
        np.ones(len(problem), bool)
        if problem.data.gauges is None
        else problem.data.gauges.of("point")
    )
    if not points.any():
        return None
    some = problem.take(points).plain_points()
    given = _length(residuals(some))
    if given.mean() < BAD * problem.reach_mm:
        return None
    tried = [(*_settled(some, slip, registered, per_group), slip) for slip in _slips(some)]
    after, marked, slip = min(tried, key=lambda each: float(each[0].mean()))
    if not marked.any() or marked.mean() >= 0.5 or after.mean() > given.mean() / FACTOR:
        return None
    return _said(
        slip,
        some.data.where,
        some.data.row[marked],
        float(np.median(given[marked])),
        float(np.median(after[marked])),
    )


def _settled(
    problem: Problem, slip: Slip, registered: bool, per_group: bool
) -> tuple[Array, NDArray[np.bool_]]:
    """(what every row leaves, which rows have the slip) once no row changes sides any more."""
    length = np.linalg.norm(problem.data.position, axis=1)
    usual = float(np.median(length))
    marked = (np.abs(np.log(np.maximum(length * slip.scale, 1e-9) / max(usual, 1e-9))) < 1) & (
        slip.scale != 1.0
    )
    marked &= np.abs(np.log(np.maximum(length, 1e-9) / max(usual, 1e-9))) > 1
    at = _with(problem, slip, marked, registered, per_group)
    for _ in range(ROUNDS):
        plain, other = (
            _length(residuals(replace(at, data=replace(at.data, q=q, position=x))))
            for q, x in ((problem.data.q, problem.data.position), (slip.q, slip.position))
        )
        again = other < plain / 2
        if (again == marked).all():
            break
        marked = again
        at = _with(problem, slip, marked, registered, per_group)
    return _length(residuals(at)), marked


def _with(
    problem: Problem, slip: Slip, marked: NDArray[np.bool_], registered: bool, per_group: bool
) -> Problem:
    """The problem without the slip in the marked rows, tracker and targets found again where they
    were found before."""
    rows = marked[:, None]
    at = replace(
        problem,
        data=replace(
            problem.data,
            q=np.where(rows, slip.q, problem.data.q),
            position=np.where(rows, slip.position, problem.data.position),
        ),
    )
    try:
        return (
            register(at, np.ones(len(at), bool), per_group) if registered and marked.any() else at
        )
    except (DataError, NotEstimable):
        return at


def _stale(problem: Problem, rows: NDArray[np.bool_]) -> Slip:
    """Of every row the readings of the one before: its position was not taken anew."""
    q = np.roll(problem.data.q, 1, axis=0)
    return Slip(
        "given with the position of the row before",
        "measure them again",
        q[rows],
        problem.data.position[rows],
    )


def _length(residual: Array) -> Array:
    return np.asarray(np.linalg.norm(residual[:, :3], axis=1))
