"""Plain linear least squares by the program's own reducer, rank decision and solve, for certified regressions.

What re-linearisation does for a fit on the chain, refinement by the residuals does here.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from modelsel.matrix.identify import identify, solve
from modelsel.matrix.reduce import reduce
from modelsel.words.rigid import Array

REFINEMENTS = 4


@dataclass(frozen=True, eq=False)
class Regression:
    """Plain linear least squares: estimate and standard errors (p,), residual standard deviation, rank."""

    estimate: Array
    standard_errors: Array
    sigma: float
    rank: int


def regress(matrix: Array, response: Array) -> Regression:
    """Rank-revealing least squares of a plain matrix (N, p): the same reducer and solve, then refined by its own residuals
    in extended precision, as long as the gradient Xᵀr falls (corrected seminormal equations; Björck 1987)."""
    reduction = reduce(matrix, response)
    found = identify(reduction)
    kept = list(found.kept)
    first, inner, _ = solve(reduction, kept)
    wide, target = matrix[:, kept].astype(np.longdouble), response.astype(np.longdouble)
    scale = np.linalg.norm(matrix[:, kept], axis=0)
    R = reduction.select(kept).R[:-1, :-1] / scale

    def gradient(beta: NDArray[np.longdouble]) -> Array:
        return np.asarray(np.asarray(wide.T @ (target - wide @ beta), dtype=float) / scale)

    beta = first.astype(np.longdouble)
    slope = gradient(beta)
    for _ in range(REFINEMENTS):
        for step in (solve_triangular(R, solve_triangular(R, slope, trans="T")) / scale,
                     solve(reduce(matrix, np.asarray(target - wide @ beta, float)), kept)[0]):
            trial = beta + step
            if np.linalg.norm(gradient(trial)) < np.linalg.norm(slope):
                beta, slope = trial, gradient(trial)
    rss = float(np.square(target - wide @ beta).sum())
    sigma = float(np.sqrt(rss / (len(response) - found.rank)))
    estimate, errors = np.zeros(matrix.shape[1]), np.zeros(matrix.shape[1])
    estimate[kept] = beta
    errors[kept] = np.sqrt((inner ** 2).sum(1)) * sigma
    return Regression(estimate, errors, sigma, found.rank)
