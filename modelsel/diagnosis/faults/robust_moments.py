"""The moment of a step where some rows are bad shots: a row far off pulls a step towards itself.

Every moment is judged by all rows, each by its residual up to a bound (as Huber's and Talwar's
estimators do): a bad shot costs as much under every moment, and so does every good row that a wrong
moment puts on the other side of the step. The sizes of the step are fitted without the bad shots."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..._linalg import TINY
from ..._typing import Array, Index, Mask
from ...fitting.component_noise import POSITION
from ...fitting.least_squares import Fit
from ...fitting.problem import Problem
from ...fitting.reduction import independent
from ..columns.candidate_columns import Columns, flatten_measured, stack_design
from ..search.views import OWN_SHARE
from .outliers import GROSS_THRESHOLD, MAX_OUTLIER_SHARE, estimate_scale, find_gross_outliers

# times that rows are judged by the best moment, and moments without the rows that are far off
ROUNDS = 5


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows as the model without the step has them: at each of N measured coordinates its columns
    (N, p) and its residual (N,). `steps`: the columns of every step; `row` (N,): the row of every
    coordinate; `is_position` (N,): whether it is one of a position."""

    problem: Problem
    steps: Columns
    base: Array
    residual: Array
    row: Index
    is_position: Mask

    def measure(self, steps: Iterable[int], inside: Mask) -> Array:
        """Measure how far all rows are off (k, m) with each of some steps, fitted to those `inside`.

        Columns of the model that these rows do not determine stay as they are."""
        known = inside[self.row]
        triangle = np.asarray(np.linalg.qr(self.base[known], mode="r"))
        determined, _ = independent(triangle)
        base = self.base[:, determined]
        Q, R = np.linalg.qr(base[known])
        wanted = self.residual[known]
        of_base = Q.T @ wanted
        seen = np.zeros((len(known), len(determined) + 1))
        seen[known, :-1] = Q
        seen[known, -1] = wanted - Q @ of_base
        products = self.steps.dot(seen)
        sizes = []
        for step in steps:
            columns = self.steps.expand(step).T
            own = products[self.steps.slices[step]]
            along = own[:, :-1]
            gram = self.steps.take_gram(step)
            outside = columns[~known]
            beyond = gram - outside.T @ outside - along @ along.T
            theta = _solve_determined(gram, beyond, own[:, -1])
            change = np.linalg.solve(R, of_base - theta @ along)
            left = self.residual - columns @ theta - base @ change
            lengths = self._measure_lengths(left)
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

    def _measure_lengths(self, left: Array) -> Array:
        """Measure the lengths (m,) of the positional part of what is left (N,) of all rows."""
        count = len(self.problem)
        squares = np.square(left)
        counted = squares * self.is_position
        row = self.row
        sums = np.bincount(row, counted, count)
        lengths: Array = np.sqrt(sums)
        return lengths


def choose_beside_outliers(problem: Problem, fitted: Fit, steps: Columns, best: int) -> int:
    """Choose which of some steps explains the rows beside a fitted model, some of which may be bad
    shots; `best` fits all rows best, and is right where none is far off. `steps`: their columns at
    these rows, linearised at the fitted model.

    Rows that are far off without a step may be those that it moves, and with the one that fits all rows
    best those that pulled it to the wrong place: both are tried."""
    columns, residual = stack_design(problem, fitted.terms, fitted.at())
    kept = list(fitted.representatives)
    row, is_position = _number_coordinates(problem)
    rows = _Rows(problem, steps, columns[:, kept], residual, row, is_position)
    every = np.ones(len(problem), bool)
    (size,) = rows.measure([best], every)
    with_step = rows.find_far(size, rows.scale(size))
    without = find_gross_outliers(problem, fitted)
    settled = [(best, size)]
    starts = [far for far in (with_step, without) if far.any()]
    settled += [_settle(rows, far) for far in starts]
    scale = min(rows.scale(size) for _, size in settled)
    costs = [_bound_cost(size, scale) for _, size in settled]
    place = int(np.argmin(costs))
    chosen, _ = settled[place]
    return chosen


def _settle(rows: _Rows, far: Mask) -> tuple[int, Array]:
    """Choose a step without the rows that are far off, and those with it, until they stay the same;
    return its number with the residuals (m,) of all rows."""
    every = range(rows.steps.groups)
    for _ in range(ROUNDS):
        sizes = rows.measure(every, ~far)
        scale = min(map(rows.scale, sizes))
        costs = [_bound_cost(size, scale) for size in sizes]
        best = int(np.argmin(costs))
        size = sizes[best]
        again = rows.find_far(size, scale)
        is_same = again == far
        if is_same.all():
            break
        far = again
    return best, size


def _number_coordinates(problem: Problem) -> tuple[Index, Mask]:
    """Number the row (N,) of every measured coordinate, and tell whether it is one of a position."""
    count = problem.components
    components = np.arange(count)
    every_row = np.arange(len(problem))
    numbered = []
    for rows in problem.blocks():
        own = every_row[rows]
        grids = np.meshgrid(own, components)
        both = np.stack(grids)
        flat = flatten_measured(problem, rows, both)
        numbered.append(flat)
    row, component = np.concatenate(numbered, axis=1)
    is_position = component < POSITION.stop
    return row, is_position


def _solve_determined(gram: Array, beyond: Array, products: Array) -> Array:
    """Solve for the sizes (k,) of a step from the Gram matrices (k, k) of its columns, in all rows and
    `beyond` the model in those that count, and from their products (k,) with the residual; zero for
    what these rows do not determine."""
    squares = np.diagonal(gram)
    positive = np.maximum(squares, TINY)
    length = np.sqrt(positive)
    pairs = np.outer(length, length)
    of_unit = beyond / pairs
    values, vectors = np.linalg.eigh(of_unit)
    least = OWN_SHARE**2
    counts = values > least
    kept = values[counts]
    own = vectors[:, counts]
    wanted = products / length
    along = own.T @ wanted
    sizes = along / kept
    turned = own @ sizes
    theta: Array = turned / length
    return theta


def _bound_cost(size: Array, scale: float) -> float:
    """Sum up the squares of residuals (m,), each up to that of a row that is just not far off."""
    limit = GROSS_THRESHOLD * scale
    bounded = np.minimum(size, limit)
    squares = np.square(bounded)
    cost = squares.sum()
    return float(cost)
