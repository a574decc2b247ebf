"""Faults of the data: rows that were exchanged, a tracker that was bumped, joints read too early, or
at other times than positions.

Exchanged rows are found among the gross outliers, where a position fits the prediction of another
outlying row. A bumped tracker and joints that were read too early, or at other times, act as screws: they are
candidates of naming, registered under `fault:` names."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..._typing import Array, Index, Mask
from ...fitting.least_squares import Fit
from ...fitting.problem import Problem
from ...mechanisms.terms import Mechanism
from ..candidates.fault_kinds import FaultKind, find_fault_kind
from ..inference.simulation_counts import FAULT_DRAWS
from .exchanged_rows import MOST_ROWS, match_rows
from .outliers import MATCH_THRESHOLD, estimate_scale

# largest p-value, and least posterior probability, at which a fault is reported
MAX_P = 0.05
MIN_PROBABILITY = 0.95
# degrees of freedom of a good position about its prediction (Student t)
TAIL_FREEDOM = 4
# rows one after the other whose positions belong equally far along, from which they are shifted
MIN_SHIFTED = 3


# what a fault of exchanged rows says
EXCHANGES = {
    FaultKind.SWAPPED_REFLECTORS: (
        "the reflectors of these rows are swapped: each position fits the other target"
    ),
    FaultKind.ROW_ORDER: (
        "these rows stand in the wrong order: each position fits another row's joint readings"
    ),
}


@dataclass(frozen=True, eq=False)
class Fault:
    """A fault of single rows, with a sentence that describes it.

    `rows`: the rows of the file that it concerns (0-based); `p`: the p-value under chance;
    `probability`: its posterior probability against unrelated gross errors."""

    kind: FaultKind
    rows: Index
    sentence: str
    p: float
    probability: float

    @property
    def name(self) -> str:
        """The name of its kind."""
        return self.kind.value


def find_concerned_rows(mechanism: Mechanism, problem: Problem) -> Index:
    """Find the rows of the file (0-based) that a mechanism's fault concerns.

    A bump concerns the rows that follow it, any other fault all rows."""
    if find_fault_kind(mechanism) is not FaultKind.TRACKER_BUMPED:
        return problem.data.row
    moved = problem.cause(mechanism.terms[0].screws[0].cause)
    return np.asarray(problem.data.row[np.broadcast_to(moved, (len(problem),)) > 0])


@dataclass(frozen=True, eq=False)
class _Outlying:
    """Outlying rows of a problem, and what other outlying row each may belong to.

    `index` (k,): the rows; `measured` and `residual` (k, 3) [mm]; `partner` (k,): the other
    outlying row whose prediction is nearest; `fits` (k,): whether it is near enough; `scale` [mm]:
    that of the good rows; `everywhere` (m, 3) [mm]: the predictions of all rows."""

    index: Index
    measured: Array
    residual: Array
    partner: Index
    fits: Mask
    scale: float
    everywhere: Array

    @property
    def predicted(self) -> Array:
        """(k, 3) predicted positions [mm]."""
        return np.asarray(self.measured - self.residual)

    @property
    def size(self) -> Array:
        """(k,) lengths of the residuals [mm]."""
        return np.asarray(np.linalg.norm(self.residual, axis=1))


def find_misplaced_rows(
    problem: Problem, outlying: Mask, fitted: Fit, rng: np.random.Generator
) -> tuple[Fault, ...]:
    """Find outlying rows (mask) whose positions fit each other's joint readings or targets.

    Rows of one configuration are swapped reflectors, others a wrong order of rows. A fault is
    reported where chance (the same distances in random directions) rarely fits as many rows, and
    the posterior probability is high."""
    rows = _collect_outlying(problem, outlying, fitted)
    if rows is None or rows.fits.sum() < 2:
        return ()
    p = _compute_chance(rows, rng)
    if p > MAX_P:
        return ()
    return tuple(_generate_faults(problem, rows, p))


def _collect_outlying(problem: Problem, outlying: Mask, fitted: Fit) -> _Outlying | None:
    gauges = problem.data.gauges
    is_point = np.ones(len(outlying), bool)
    if gauges is not None:
        is_point = gauges.of("point")
    index = np.flatnonzero(outlying & is_point)
    if not 2 <= len(index) <= MOST_ROWS:
        return None
    residual = fitted.residuals(problem)[:, :3]
    regular = residual[~outlying & is_point]
    size = np.linalg.norm(regular, axis=1)
    scale = estimate_scale(size)
    near = MATCH_THRESHOLD * scale
    measured = problem.data.position[index]
    predicted = measured - residual[index]
    partner, fits = match_rows(measured, predicted, near)
    return _Outlying(
        index=index,
        measured=measured,
        residual=residual[index],
        partner=partner,
        fits=fits,
        scale=scale,
        everywhere=problem.data.position - residual,
    )


def _compute_chance(rows: _Outlying, rng: np.random.Generator) -> float:
    """Compute how often residuals of the same lengths in random directions fit as many rows."""
    direction = rng.standard_normal((FAULT_DRAWS, len(rows.index), 3))
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    near, predicted = MATCH_THRESHOLD * rows.scale, rows.predicted
    drawn = predicted + direction * rows.size[:, None]
    matches = np.array([match_rows(one, predicted, near)[1].sum() for one in drawn])
    return float((1 + (matches >= rows.fits.sum()).sum()) / (FAULT_DRAWS + 1))


def _generate_faults(problem: Problem, rows: _Outlying, p: float) -> Iterator[Fault]:
    data = problem.data
    configuration = data.configuration[rows.index]
    same_configuration = configuration == configuration[rows.partner]
    log_ratio = _compute_log_ratio(rows, problem.reach_mm)
    for kind, words in EXCHANGES.items():
        is_swap = kind is FaultKind.SWAPPED_REFLECTORS
        concerned = rows.fits & (same_configuration == is_swap)
        probability = _compute_probability(log_ratio, concerned)
        if concerned.sum() < 2 or probability < MIN_PROBABILITY:
            continue
        runs = [] if is_swap else _find_shifted_runs(rows, concerned)
        shifted = [row for run in runs for row in run.rows]
        others = np.setdiff1d(rows.index[concerned], shifted)
        told = [_describe_run(problem, run) for run in runs]
        if len(others):
            told.append(f"{words} ({data.where.listed(data.row[others])})")
        every = np.union1d(others, shifted).astype(np.intp)
        yield Fault(
            kind=kind,
            rows=data.row[every],
            sentence=f"A fault of the data: {'; '.join(told)}.",
            p=p,
            probability=probability,
        )


@dataclass(frozen=True, eq=False)
class _ShiftedRun:
    """Rows of a problem one after the other (k,) whose positions belong to the joint readings of the
    row so many further down, `by`, or up, where it is negative."""

    rows: list[int]
    by: int


def _find_shifted_runs(rows: _Outlying, concerned: Mask) -> list[_ShiftedRun]:
    """Find the runs of exchanged rows, `concerned` (k,), whose positions all belong equally far along,
    with the outlying rows at their ends whose own row is none of the outlying ones."""
    own = rows.index[concerned]
    by = rows.index[rows.partner[concerned]] - own
    is_break = (np.diff(own) != 1) | (np.diff(by) != 0)
    places = np.flatnonzero(is_break) + 1
    runs = []
    for run in np.split(np.arange(len(own)), places):
        if len(run) < MIN_SHIFTED:
            continue
        shift = int(by[run[0]])
        members = own[run].tolist()
        before = _extend(rows, members[0], -1, shift)
        after = _extend(rows, members[-1], 1, shift)
        runs.append(_ShiftedRun([*reversed(before), *members, *after], shift))
    return runs


def _extend(rows: _Outlying, end: int, step: int, by: int) -> list[int]:
    """List the outlying rows beyond the end of a run whose positions belong as far along as its."""
    near = MATCH_THRESHOLD * rows.scale
    measured = dict(zip(rows.index.tolist(), rows.measured, strict=True))
    beyond = []
    row = end + step
    while row in measured and 0 <= row + by < len(rows.everywhere):
        apart = np.linalg.norm(measured[row] - rows.everywhere[row + by])
        if apart >= near:
            break
        beyond.append(row)
        row += step
    return beyond


def _describe_run(problem: Problem, run: _ShiftedRun) -> str:
    """Describe a block of rows whose positions are shifted against the joint readings."""
    data = problem.data
    where = data.where.spans(data.row[run.rows])
    size = abs(run.by)
    direction = "after" if run.by > 0 else "before"
    row = f"the row {direction}"
    shifted = "one row"
    if size > 1:
        row = f"the row {size} rows {direction}"
        shifted = f"{size} rows"
    return (
        f"positions and joint readings are shifted against each other by {shifted} ({where}): each "
        f"position fits the readings of {row}"
    )


def _compute_log_ratio(rows: _Outlying, reach: float) -> Array:
    """Compute (k,) log density ratios of positions: exchanged rows over gross errors.

    An exchanged position belongs to another outlying row; a gross error may be anywhere.

    If it belongs to another row: a Student t of TAIL_FREEDOM degrees of freedom and the good rows'
    scale about the prediction of that row, one of k - 1 equally likely. If it is any gross error:
    a uniform direction, and a length whose logarithm is uniform from where rows count as outlying
    to the arm's `reach` [mm]."""
    from scipy.special import gammaln

    scale, smallest = rows.scale, MATCH_THRESHOLD * rows.scale
    apart = np.linalg.norm(rows.measured - rows.predicted[rows.partner], axis=1)
    length = np.maximum(rows.size, smallest)
    log_t = (
        gammaln((TAIL_FREEDOM + 3) / 2)
        - gammaln(TAIL_FREEDOM / 2)
        - 1.5 * np.log(TAIL_FREEDOM * np.pi)
        - 3 * np.log(scale)
        - (TAIL_FREEDOM + 3) / 2 * np.log1p(np.square(apart / scale) / TAIL_FREEDOM)
    )
    log_exchanged = log_t - np.log(len(apart) - 1)
    log_range = np.log(max(reach / smallest, np.e))
    log_gross = -np.log(4 * np.pi * log_range) - 3 * np.log(length)
    return np.asarray(log_exchanged - log_gross)


def _compute_probability(log_ratio: Array, concerned: Mask) -> float:
    """Compute the posterior probability that the `concerned` rows (k,) were exchanged.

    Prior: an exchange has probability 1/2, and then every outlying row takes part with probability
    1/2. Bayes factor: the product over the rows of (1 + ratio) / 2, with ratio 0 for a row that is
    not concerned."""
    from scipy.special import expit

    log_ratio_concerned = np.where(concerned, log_ratio, -np.inf)
    log_factors = np.logaddexp(0.0, log_ratio_concerned) - np.log(2)
    log_odds = log_factors.sum()
    return float(expit(log_odds))
