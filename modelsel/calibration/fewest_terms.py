"""The fewest terms that explain a difference of parameters: orthogonal matching pursuit with the
difference's covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._linalg import project_out
from .._typing import Array
from .mechanism_changes import SIGNIFICANCE

MIN_CHI2 = 9.0  # that a term must explain to be named
MAX_CHI2_LOSS = 2.0  # by how much less another term may explain and still do as well
MIN_FREE_NORM = 1e-6  # of a unit column beyond the chosen ones, to be another direction
# of the longest column: what is shorter is rounding, of a term that moves nothing that is tested
MIN_LENGTH = 1e-9


@dataclass(frozen=True)
class Step:
    """A chosen term, its change with standard error, and the terms that would do as well."""

    term: int
    change: float
    standard_error: float
    alike: list[int]


def select_fewest_terms(difference: Array, factor: Array, directions: Array) -> list[Step]:
    """Select terms one after the other until what they leave of a difference is chance.

    `difference` (k,) has the covariance factor factorᵀ; `directions` (terms, k) is what a unit of
    each term changes. Generalised least squares by orthogonal matching pursuit.
    """
    from scipy.linalg import qr, solve_triangular
    from scipy.special import chdtrc

    count = len(difference)
    # factor factorᵀ = L Lᵀ
    R = qr(factor.T, mode="r")[0]
    L = R[:count].T
    response = solve_triangular(L, difference, lower=True)
    columns = solve_triangular(L, directions.T, lower=True)
    lengths = np.linalg.norm(columns, axis=0)
    longest = lengths.max(initial=0.0)
    is_seen = lengths > MIN_LENGTH * longest
    columns = np.where(is_seen, columns, 0.0) / np.where(is_seen, lengths, 1.0)
    basis = np.zeros((count, 0))
    residual = response
    chosen = list[int]()
    alike = list[list[int]]()
    while len(chosen) < count:
        chi2 = float(residual @ residual)
        if chdtrc(count - len(chosen), chi2) >= SIGNIFICANCE:
            break
        free = project_out(columns, basis)
        norms = np.linalg.norm(free, axis=0)
        gains = _explained_chi2(free, norms, residual)
        best = int(np.argmax(gains))
        largest = gains[best]
        if largest < MIN_CHI2:
            break
        rivals = np.flatnonzero(gains > largest - MAX_CHI2_LOSS).tolist()
        alike.append([rival for rival in rivals if rival != best])
        chosen.append(best)
        direction = free[:, best] / norms[best]
        basis = np.column_stack([basis, direction])
        residual = response - basis @ (basis.T @ response)
    changes, errors = _solve_chosen(basis, columns[:, chosen], response)
    steps = []
    for k, term in enumerate(chosen):
        length = lengths[term]
        change = float(changes[k] / length)
        error = float(errors[k] / length)
        steps.append(Step(term, change, error, alike[k]))
    return steps


def _explained_chi2(free: Array, norms: Array, residual: Array) -> Array:
    """Return the χ² that each direction explains; -1 for one that the chosen ones span."""
    projections = free.T @ residual
    lengths = np.maximum(norms, MIN_FREE_NORM)
    explained = projections**2 / lengths**2
    is_free = norms > MIN_FREE_NORM
    return np.where(is_free, explained, -1.0)


def _solve_chosen(basis: Array, columns: Array, response: Array) -> tuple[Array, Array]:
    """Return the changes of the chosen terms and their standard errors."""
    R = basis.T @ columns
    projection = basis.T @ response
    changes = np.linalg.solve(R, projection)
    inverse = np.linalg.inv(R)
    errors = np.linalg.norm(inverse, axis=1)
    return np.asarray(changes), np.asarray(errors)
