"""Held-out rows that are no measurements of this arm: bad shots, which say nothing of a model.

A row that a model predicts badly is not one of them: what the parameters leave open there is allowed
for, and many rows far off are what the model does not know."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .._typing import Array, Index, Mask
from ..diagnosis.outliers import GROSS_THRESHOLD, MAX_OUTLIER_SHARE, find_far_rows
from ..fitting.design import compute_design, whitened
from ..fitting.least_squares import Fit
from ..fitting.problem import Problem
from ..selection.evaluation import Evaluation, Split


def exclude_held_out_outliers(split: Split, ladder: Sequence[Evaluation]) -> Split:
    """Mark the held-out rows that are outliers in every model of a ladder but the nominal one.

    The rule is fixed on the estimation rows: beyond GROSS robust standard deviations of their
    residuals, and of what the parameters leave open. None is marked where more than
    MAX_OUTLIER_SHARE of the rows would be, and more than one.
    """
    held_out = ~split.estimation
    far = held_out
    for evaluation in ladder[1:]:
        far = _find_far(split, evaluation, far)
    share = MAX_OUTLIER_SHARE * held_out.sum()
    most = max(share, 1.0)
    count = far.sum()
    if count > most:
        return split
    outlying = np.asarray(split.outlying | far)
    return replace(split, outlying=outlying)


def _find_far(split: Split, evaluation: Evaluation, looked_at: Mask) -> Mask:
    """Find the rows (m,) far off a model, of those that are looked at."""
    problem = split.problem
    used = split.used
    measured = problem.measured
    if measured is not None:
        measured = measured[used]
    residual = whitened(problem, evaluation.residual)
    reference = residual[used]
    far = find_far_rows(residual, reference, GROSS_THRESHOLD, measured)
    far = far & looked_at
    rows = np.flatnonzero(far)
    if rows.size == 0:
        return far
    open_there = _measure_open(problem, evaluation.fit, rows)
    spread = np.sqrt(1 + open_there)
    own = residual[rows]
    allowed = own / spread[:, None]
    far[rows] = find_far_rows(allowed, reference, GROSS_THRESHOLD, measured)
    return far


def _measure_open(problem: Problem, fitted: Fit, rows: Index) -> Array:
    """Measure (k,) the variance of a coordinate that the parameters leave open at rows, over the
    noise's."""
    there = problem.take(rows)
    point = fitted.at()
    X, _ = compute_design(there, fitted.terms, point)
    moved = X @ fitted.factor
    squares = np.square(moved)
    of_coordinates = squares.sum(2)
    variance: Array = of_coordinates.mean(1)
    return variance
