"""Held-out rows that are no measurements of this arm: bad shots, which say nothing of a model.

A row that a model predicts badly is not one of them: what the parameters leave open there is allowed
for, and many rows far off are what the model does not know."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..._typing import Array, Index, Mask
from ...diagnosis.faults.mistaken_rows import explain_rows
from ...diagnosis.faults.outliers import GROSS_THRESHOLD, MAX_OUTLIER_SHARE, find_far_rows
from ...fitting.design import compute_design, whitened
from ...fitting.error_structure import ErrorStructure
from ...fitting.least_squares import Fit
from ...fitting.problem import Problem
from ...selection.evaluation import Evaluation, Split

# errors of which rows share none
ALONE = ErrorStructure()


def exclude_held_out_outliers(
    split: Split, ladder: Sequence[Evaluation], errors: ErrorStructure = ALONE
) -> Split:
    """Mark the held-out rows that are outliers in every model of a ladder but the nominal one.

    The rule is fixed on the estimation rows: beyond GROSS robust standard deviations of their
    residuals, and of what the parameters leave open. Rows are judged by themselves, by what the
    instrument has in their directions: among `errors` that rows share, a bad shot would make its
    neighbours bad. Where more than MAX_OUTLIER_SHARE of the rows would be marked, and more than one,
    beside those that a slip explains, these alone are.
    """
    held_out = ~split.estimation
    far = held_out & ~split.outlying
    own = errors.of_instrument()
    stated = split.problem.as_stated()
    alone = own.whiten(stated)
    by_itself = replace(split, problem=alone)
    for evaluation in ladder[1:]:
        far = _find_far(by_itself, evaluation, far)
    share = MAX_OUTLIER_SHARE * held_out.sum()
    most = max(share, 1.0)
    slipped = _find_slipped(split, ladder[-1], far)
    unexplained = far & ~slipped
    count = unexplained.sum()
    if count > most:
        far = slipped
    if not far.any():
        return split
    outlying = np.asarray(split.outlying | far)
    return replace(split, outlying=outlying)


def _find_slipped(split: Split, evaluation: Evaluation, far: Mask) -> Mask:
    """Find the rows (m,) that a slip explains, of those `far` off: no matter of chance."""
    slipped = np.zeros(len(far), bool)
    suspected = far | split.outliers
    for each in explain_rows(split.problem, evaluation.fit.residuals, suspected):
        slipped |= each.rows
    return slipped & far


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
