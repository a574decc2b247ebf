"""What a study tries by columns of its own, which no file has: a payload elsewhere, late rows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..._typing import Array
from ...fitting.least_squares import Fit
from ...fitting.problem import Problem


def widen_rows(problem: Problem, columns: Mapping[str, Array]) -> Problem:
    """Add columns (m,) by name to what a problem's rows measure, as covariates."""
    data = problem.data
    every = {**data.covariates, **columns}
    wider = replace(data, covariates=every)
    return replace(problem, data=wider)


def measure_left(problem: Problem, fitted: Fit) -> float:
    """Measure the rms length [mm] of what a fit leaves of the positions."""
    residual = fitted.residuals(problem)
    squares = np.square(residual[:, :3])
    lengths = squares.sum(1)
    return float(np.sqrt(lengths.mean()))
