"""The moment of a step where some rows are bad shots: a row far off pulls a step towards itself.

Every moment is judged by all rows, each by its residual up to a bound (as Huber's and Talwar's
estimators do): a bad shot costs as much under every moment, and so does every good row that a wrong
moment puts on the other side of the step. The sizes of the step are fitted without the bad shots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._typing import Array, Mask
from ..fitting.design import compute_design
from ..fitting.least_squares import Fit
from ..fitting.problem import Problem
from ..mechanisms.terms import Mechanism
from .outliers import (
    GROSS_THRESHOLD,
    MAX_OUTLIER_SHARE,
    compute_lengths,
    estimate_scale,
    find_gross_outliers,
)

# times that rows are judged by the best moment, and moments without the rows that are far off
ROUNDS = 5


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows as the model without the step has them: its columns (m, c, p), its residual (m, c)."""

    problem: Problem
    fitted: Fit
    columns: Array
    residual: Array

    def measure(self, steps: Sequence[Mechanism], inside: Mask) -> Array:
        """Measure how far all rows are off (k, m) with each of some steps, fitted to those `inside`."""
        base = self._flatten(self.columns, inside)
        wanted = self.residual[inside].ravel()
        Q, R = np.linalg.qr(base)
        sizes = []
        for step in steps:
            columns, _ = compute_design(self.problem, step.terms, self.fitted.at())
            own = self._flatten(columns, inside)
            beyond = own - Q @ (Q.T @ own)
            theta = np.linalg.lstsq(beyond, wanted, rcond=None)[0]
            rest = wanted - own @ theta
            change = np.linalg.solve(R, Q.T @ rest)
            left = self.residual - columns @ theta - self.columns @ change
            lengths = compute_lengths(left)
            sizes.append(lengths)
        return np.array(sizes)

    def find_far(self, size: Array, scale: float) -> Mask:
        """Find the rows whose residuals (m,) are far beyond a scale of one coordinate; none where
        they are too many for bad shots."""
        limit = GROSS_THRESHOLD * scale
        far = np.asarray(size > limit)
        share = far.mean()
        if share > MAX_OUTLIER_SHARE:
            return np.zeros_like(far)
        return far

    def scale(self, size: Array) -> float:
        """Estimate the robust standard deviation of one coordinate from residuals (m,)."""
        measured = self.problem.measured
        return estimate_scale(size, measured)

    def _flatten(self, columns: Array, inside: Mask) -> Array:
        width = columns.shape[2]
        chosen = columns[inside]
        return chosen.reshape(-1, width)


def choose_beside_outliers(
    problem: Problem, fitted: Fit, steps: Sequence[Mechanism], best: int
) -> int:
    """Choose which of some steps explains the rows beside a fitted model, some of which may be bad
    shots; `best` fits all rows best, and is right where none is far off.

    Rows that are far off without a step may be those that it moves, and with the one that fits all rows
    best those that pulled it to the wrong place: both are tried."""
    X, residual = compute_design(problem, fitted.terms, fitted.at())
    kept = list(fitted.representatives)
    rows = _Rows(problem, fitted, X[:, :, kept], residual)
    every = np.ones(len(problem), bool)
    (size,) = rows.measure([steps[best]], every)
    with_step = rows.find_far(size, rows.scale(size))
    without = find_gross_outliers(problem, fitted)
    settled = [(best, size)]
    starts = [far for far in (with_step, without) if far.any()]
    settled += [_settle(rows, steps, far) for far in starts]
    scale = min(rows.scale(size) for _, size in settled)
    costs = [_bound_cost(size, scale) for _, size in settled]
    place = int(np.argmin(costs))
    chosen, _ = settled[place]
    return chosen


def _settle(rows: _Rows, steps: Sequence[Mechanism], far: Mask) -> tuple[int, Array]:
    """Choose a step without the rows that are far off, and those with it, until they stay the same;
    return its number with the residuals (m,) of all rows."""
    for _ in range(ROUNDS):
        sizes = rows.measure(steps, ~far)
        scale = min(map(rows.scale, sizes))
        costs = [_bound_cost(size, scale) for size in sizes]
        best = int(np.argmin(costs))
        again = rows.find_far(sizes[best], scale)
        is_same = again == far
        if is_same.all():
            break
        far = again
    return best, sizes[best]


def _bound_cost(size: Array, scale: float) -> float:
    """Sum up the squares of residuals (m,), each up to that of a row that is just not far off."""
    limit = GROSS_THRESHOLD * scale
    bounded = np.minimum(size, limit)
    squares = np.square(bounded)
    cost = squares.sum()
    return float(cost)
