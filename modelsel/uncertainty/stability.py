"""Stability of a mechanism: in how many half-samples of the postures it stays significant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._typing import Array, Index
from ..fitting.identifiability import solve
from ..fitting.least_squares import Fit, with_prior
from ..fitting.splines import spline
from ..selection.cross_validation import FoldedData
from .bootstrap import draw_half_samples

# half-samples in which significance is judged again
HALVES = 100
# p below which a mechanism is significant
LEVEL = 0.05
# parameters that the data add, below which the prior of usual sizes determines a mechanism
MIN_DETERMINED = 0.5
# largest error of an inverse information for which a half-sample is judged
MAX_INVERSE_ERROR = 1e-6


def count_determined(fitted: Fit, terms: Sequence[int]) -> float:
    """Count the parameters that some fitted terms add to the others.

    Those that a prior holds count by what the data determine of them: the trace of the hat matrix
    that goes with them."""
    rest = [k for k in fitted.found.kept if k not in terms]
    spent = 0.0
    if rest:
        full = with_prior(fitted.reduction, fitted.root, fitted.theta)
        factor = solve(full, rest)[1]
        spent = np.square(fitted.reduction.R[:-1, rest] @ factor).sum()
    return float(fitted.rows - fitted.freedom - spent)


def measure_stability(
    folded: FoldedData,
    fitted: Fit,
    groups: Sequence[Sequence[int]],
    rng: np.random.Generator,
    count: int = HALVES,
) -> list[float | None]:
    """Measure the share of half-samples of the postures in which each group of terms stays
    significant (nested F, p below 0.05); None for shrunk terms.

    The names are taken as given: the search is not repeated in the halves."""
    from scipy.special import fdtrc

    samples = _HalfSamples(folded, fitted)
    positions = [samples.positions(group) for group in groups]
    sizes = [max(count_determined(fitted, group), MIN_DETERMINED) for group in groups]
    hits = np.zeros(len(groups))
    judged = 0
    for half in draw_half_samples(rng, count, len(folded.blocks)):
        solution = samples.solve(half)
        if solution is None:
            continue
        judged += 1
        for g, position in enumerate(positions):
            if len(position):
                f = solution.f_value(position, sizes[g])
                hits[g] += fdtrc(sizes[g], solution.freedom, f) < LEVEL
    if not judged:
        return [None] * len(groups)
    shares = hits / judged
    return [float(s) if len(i) else None for s, i in zip(shares, positions, strict=True)]


@dataclass(frozen=True, eq=False)
class _HalfSolution:
    """Least squares of a half-sample: estimates (r,) and unscaled covariance (r, r) of scaled
    columns, residual variance and its degrees of freedom."""

    beta: Array
    covariance: Array
    variance: float
    freedom: float

    def f_value(self, position: Index, size: float) -> float:
        """Compute the nested F of some columns that count as `size` parameters."""
        covariance = self.covariance[np.ix_(position, position)]
        increase = self.beta[position] @ np.linalg.solve(covariance, self.beta[position])
        return float(increase / size / self.variance)


class _HalfSamples:
    """Least squares of half-samples, columns scaled to unit length."""

    def __init__(self, folded: FoldedData, fitted: Fit):
        self.fitted = fitted
        self.kept = list(fitted.found.kept)
        self.rows = folded.rows
        columns = folded.blocks[:, :, self.kept]
        prior = fitted.root[:, self.kept]
        length = np.linalg.norm(columns, axis=(0, 1))
        scale = np.hypot(length, np.linalg.norm(prior, axis=0))
        self.columns = columns
        self.scale = scale
        self.response = folded.blocks[:, :, -1] + columns @ fitted.theta[self.kept]
        root = prior / scale
        self.precision = root.T @ root

    def positions(self, terms: Sequence[int]) -> Index:
        """Positions of some terms among the columns; none for shrunk terms."""
        if any(spline(self.fitted.terms[k]) is not None for k in terms):
            return np.zeros(0, dtype=np.intp)
        return np.array([self.kept.index(k) for k in terms], dtype=np.intp)

    def solve(self, half: Index) -> _HalfSolution | None:
        """Solve a half-sample; None where it does not determine the model."""
        A = self.columns[half].reshape(-1, len(self.kept)) / self.scale
        b = self.response[half].ravel()
        gram = A.T @ A
        information = gram + self.precision
        try:
            covariance = np.linalg.inv(information)
        except np.linalg.LinAlgError:
            return None
        beta = covariance @ (A.T @ b)
        freedom = int(self.rows[half].sum()) - np.einsum("ij,ji->", covariance, gram)
        error = np.abs(covariance @ information - np.eye(len(self.kept))).max()
        if freedom < 1 or error > MAX_INVERSE_ERROR:
            return None
        variance = float(np.square(b - A @ beta).sum()) / freedom
        return _HalfSolution(beta, covariance, variance, freedom)
