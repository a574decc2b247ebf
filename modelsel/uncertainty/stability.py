"""Stability of a mechanism: in how many half-samples of the postures it stays significant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._typing import Array, Index
from ..fitting.identifiability import solve
from ..fitting.least_squares import Fit
from ..fitting.prior import with_prior
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
    kept = fitted.found.kept
    reduction = fitted.reduction
    rest = [k for k in kept if k not in terms]
    spent = 0.0
    if rest:
        full = with_prior(reduction, fitted.root, fitted.theta)
        _, factor, _ = solve(full, rest)
        columns = reduction.R[:-1, rest]
        influence = np.square(columns @ factor)
        spent = influence.sum()
    used = fitted.rows - fitted.freedom
    determined = used - spent
    return float(determined)


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
    sizes = []
    for group in groups:
        determined = count_determined(fitted, group)
        size = max(determined, MIN_DETERMINED)
        sizes.append(size)
    count_of_groups = len(groups)
    hits = np.zeros(count_of_groups)
    judged = 0
    units = len(folded.blocks)
    for half in draw_half_samples(rng, count, units):
        solution = samples.solve(half)
        if solution is None:
            continue
        judged += 1
        for g, position in enumerate(positions):
            if not len(position):
                continue
            size = sizes[g]
            f = solution.f_value(position, size)
            p = fdtrc(size, solution.freedom, f)
            hits[g] += p < LEVEL
    if not judged:
        return [None] * count_of_groups
    stability: list[float | None] = []
    for hit, position in zip(hits, positions, strict=True):
        share = None
        if len(position):
            share = float(hit / judged)
        stability.append(share)
    return stability


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
        beta = self.beta[position]
        block = np.ix_(position, position)
        covariance = self.covariance
        covariance = covariance[block]
        scaled = np.linalg.solve(covariance, beta)
        increase = beta @ scaled
        mean = increase / size
        f = mean / self.variance
        return float(f)


class _HalfSamples:
    """Least squares of half-samples, columns scaled to unit length."""

    def __init__(self, folded: FoldedData, fitted: Fit):
        kept = list(fitted.found.kept)
        theta = fitted.theta[kept]
        blocks = folded.blocks
        residual = blocks[:, :, -1]
        columns = blocks[:, :, kept]
        response = residual + columns @ theta
        prior = fitted.root
        prior = prior[:, kept]
        length = np.linalg.norm(columns, axis=(0, 1))
        prior_length = np.linalg.norm(prior, axis=0)
        # the prior's rows count as rows of the data
        scale = np.hypot(length, prior_length)
        root = prior / scale
        precision = root.T @ root
        self.fitted = fitted
        self.kept = kept
        self.rows = folded.rows
        self.columns = columns
        self.scale = scale
        self.response = response
        self.precision = precision

    def positions(self, terms: Sequence[int]) -> Index:
        """Return the positions of some terms among the columns; none for shrunk terms."""
        for k in terms:
            term = self.fitted.terms[k]
            if spline(term) is not None:
                return np.zeros(0, dtype=np.intp)
        places = []
        for k in terms:
            place = self.kept.index(k)
            places.append(place)
        return np.array(places, dtype=np.intp)

    def solve(self, half: Index) -> _HalfSolution | None:
        """Solve a half-sample; None where it does not determine the model."""
        count = len(self.kept)
        columns = self.columns[half]
        columns = columns.reshape(-1, count)
        A = columns / self.scale
        b = self.response[half]
        b = b.ravel()
        gram = A.T @ A
        information = gram + self.precision
        try:
            covariance = np.linalg.inv(information)
        except np.linalg.LinAlgError:
            return None
        beta = covariance @ (A.T @ b)
        used = np.einsum("ij,ji->", covariance, gram)
        rows = int(self.rows[half].sum())
        freedom = rows - used
        departure = covariance @ information - np.eye(count)
        error = np.abs(departure)
        error = error.max()
        if freedom < 1 or error > MAX_INVERSE_ERROR:
            return None
        residual = b - A @ beta
        squares = np.square(residual)
        square_sum = float(squares.sum())
        variance = square_sum / freedom
        return _HalfSolution(beta, covariance, variance, freedom)
