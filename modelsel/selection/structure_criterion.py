"""The criterion that effects and the parts of the errors are chosen by together."""

from __future__ import annotations

import numpy as np

from .._typing import Mask
from ..fitting.design import measure_rounding
from ..fitting.error_structure import ErrorStructure
from ..fitting.least_squares import Fit
from ..fitting.problem import Problem


def compute_criterion(
    problem: Problem, training: Mask, fitted: Fit, errors: ErrorStructure, log_prior: float
) -> float:
    """Compute the Bayesian information criterion of a fitted model with the parts of its errors.

    `training`: mask (m,) of its rows; `log_prior`: logarithm of the prior probability of the effects
    that it names."""
    weighed = errors.whiten(problem).take(training)
    N = weighed.coordinates
    estimated = sum(part.known is None for part in errors.shared)
    used = fitted.rows - fitted.freedom + estimated
    likelihood = _compute_deviance(weighed, fitted)
    return float(likelihood + used * np.log(N) - 2 * log_prior)


def compute_trimmed_criterion(
    problem: Problem,
    training: Mask,
    outlying: Mask,
    fitted: Fit,
    errors: ErrorStructure,
    log_prior: float,
    threshold: float,
) -> float:
    """Compute the same criterion of a model that was fitted without some outliers, so that those with
    other outliers compare.

    `outlying`: mask (m,) of the outliers, each of which costs as much as a row would that is
    `threshold` standard deviations of one coordinate off: its residuals are trimmed there."""
    criterion = compute_criterion(problem, training, fitted, errors, log_prior)
    if not outlying.any():
        return criterion
    whitened = errors.whiten(problem)
    weighed = whitened.take(training)
    deviance = _compute_deviance(weighed, fitted)
    each = deviance / weighed.coordinates
    left_out = problem.take(outlying)
    square = threshold**2
    squares = len(left_out) * square
    # the squares of the others add up to their number
    beyond = left_out.coordinates * (each - 1)
    return criterion + beyond + squares


def _compute_deviance(weighed: Problem, fitted: Fit) -> float:
    """Compute minus twice the largest log likelihood of normal errors of any size, without its
    constants."""
    residual = fitted.residuals(weighed).T.copy()
    square = float(np.square(weighed.whitening.apply(residual)).sum())
    square = max(square, measure_rounding(weighed) ** 2)
    N = weighed.coordinates
    likelihood = N * np.log(square / N) + weighed.whitening.log_determinant()
    return float(likelihood)
