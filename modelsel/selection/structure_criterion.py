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
    residual = fitted.residuals(weighed).T.copy()
    square = float(np.square(weighed.whitening.apply(residual)).sum())
    square = max(square, measure_rounding(weighed) ** 2)
    N = weighed.coordinates
    estimated = sum(part.known is None for part in errors.shared)
    used = fitted.rows - fitted.freedom + estimated
    likelihood = N * np.log(square / N) + weighed.whitening.log_determinant()
    return float(likelihood + used * np.log(N) - 2 * log_prior)
