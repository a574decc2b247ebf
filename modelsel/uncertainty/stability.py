"""Stability of a mechanism: in how many half-samples of the postures it stays significant."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .._linalg import TINY, invert_triangle
from .._typing import Array, Index
from ..fitting.least_squares import Fit
from ..fitting.problem import Problem
from ..fitting.splines import spline
from ..selection.moments import Coordinates, rows_by_unit
from .bootstrap import draw_half_samples

# half-samples in which significance is judged again
HALVES = 100
# p below which a mechanism is significant
LEVEL = 0.05
# parameters that the data add, below which the prior of usual sizes determines a mechanism
MIN_DETERMINED = 0.5
# what a half-sample tells of a direction, over what all rows tell, below which it does not
# determine the model
MIN_INFORMATION = 1e-9


def count_determined(fitted: Fit, terms: Sequence[int]) -> float:
    """Count the parameters that some fitted terms add to the others.

    Those that a prior holds count by what the data determine of them: the trace of the hat matrix
    that goes with them."""
    directions, _ = np.linalg.qr(fitted.factor[list(terms)].T)
    held = fitted.root @ fitted.factor @ directions
    count = len(terms) - np.square(held).sum()
    return float(count)


def measure_stability(
    problem: Problem,
    unit: Index,
    fitted: Fit,
    groups: Sequence[Sequence[int]],
    rng: np.random.Generator,
    count: int = HALVES,
) -> list[float | None]:
    """Measure the share of half-samples of the units (m,) in which each group of terms stays
    significant (nested F, p below 0.05); None for shrunk terms.

    `problem`: the rows that were fitted. The names are taken as given: the search is not repeated
    in the halves."""
    from scipy.special import fdtrc

    judged = [[] if _has_spline(fitted, group) else list(group) for group in groups]
    sizes = [max(count_determined(fitted, group), MIN_DETERMINED) for group in judged]
    units = int(unit.max()) + 1
    halves = draw_half_samples(rng, count, units)
    solver = _HalfSolver(fitted, Coordinates.of(fitted), judged)
    products = _sum_halves(*rows_by_unit(problem, fitted, solver.coordinates, unit), halves)
    measured = problem.counted(unit, units)
    solutions = 0
    hits = np.zeros(len(groups))
    for half, product in zip(halves, products, strict=True):
        solution = solver.solve(product, int(measured[half].sum()))
        if solution is None:
            continue
        solutions += 1
        for g, size in enumerate(sizes):
            p = fdtrc(size, solution.freedom, solution.f_value(g, size))
            hits[g] += p < LEVEL
    shares = hits / max(solutions, 1)
    known = [solutions > 0 and bool(group) for group in judged]
    return [
        float(share) if is_known else None for share, is_known in zip(shares, known, strict=True)
    ]


def _has_spline(fitted: Fit, terms: Sequence[int]) -> bool:
    """Whether some terms are shrunk."""
    return any(spline(fitted.terms[k]) is not None for k in terms)


def _sum_halves(rows: Array, unit_of: Index, halves: Index) -> Iterator[Array]:
    """Yield the products (r+1, r+1) of the rows (N, r+1) of every half-sample.

    Halves come in complementary pairs: the second has all units but the first's, and but the one
    that an odd number leaves over."""
    total = rows.T @ rows
    units = int(unit_of[-1]) + 1
    for pair in range(0, len(halves), 2):
        member = np.zeros(units, bool)
        member[halves[pair]] = True
        inside = rows[member[unit_of]]
        former = inside.T @ inside
        yield former
        if pair + 1 < len(halves):
            member[halves[pair + 1]] = True
            left_over = rows[~member[unit_of]]
            yield total - former - left_over.T @ left_over


@dataclass(frozen=True, eq=False)
class _HalfSolution:
    """Least squares of a half-sample: for every group its estimates (s,) and their unscaled
    covariance (s, s), the residual variance and its degrees of freedom."""

    groups: Sequence[tuple[Array, Array]]
    variance: float
    freedom: float

    def f_value(self, group: int, size: float) -> float:
        """Compute the nested F of a group of terms that counts as `size` parameters."""
        beta, covariance = self.groups[group]
        scaled = np.linalg.solve(covariance, beta)
        increase = beta @ scaled
        mean = increase / size
        # 0 for terms that change nothing, also where nothing is left
        variance = max(self.variance, TINY)
        f = mean / variance
        return float(f)


@dataclass(frozen=True, eq=False)
class _HalfSolver:
    """Least squares of half-samples, linear about a fit, for some groups of its terms."""

    fitted: Fit
    coordinates: Coordinates
    groups: Sequence[Sequence[int]]

    @cached_property
    def prior_gram(self) -> Array:
        """Products (r, r) of the prior's rows."""
        prior = self.coordinates.prior
        return np.asarray(prior.T @ prior)

    @cached_property
    def directions(self) -> Array:
        """Rows (t, r) of the fit's factor of all groups' terms, group after group."""
        terms = [k for group in self.groups for k in group]
        return self.fitted.factor[terms]

    def solve(self, products: Array, rows: int) -> _HalfSolution | None:
        """Solve a half-sample of the given products (r+1, r+1) of [Q | e]; None where it does not
        determine the model."""
        own = self.coordinates
        gram = products[:-1, :-1]
        score = products[:-1, -1]
        try:
            L = np.asarray(np.linalg.cholesky(gram + self.prior_gram), dtype=np.float64)
        except np.linalg.LinAlgError:
            return None
        if np.square(np.diagonal(L)).min() < MIN_INFORMATION:
            return None
        root = invert_triangle(L)
        inverse = root.T @ root
        by_prior = float(np.vdot(inverse, self.prior_gram))
        freedom = rows - own.rank + by_prior
        if freedom < 1:
            return None
        change = inverse @ (score + own.prior.T @ own.prior_left)
        square_sum = products[-1, -1] + change @ (gram @ change - 2 * score)
        theta = self.fitted.theta + self.fitted.factor @ (own.projection + change)
        covariance = self.directions @ inverse @ self.directions.T
        estimates = []
        start = 0
        for group in self.groups:
            own_terms = slice(start, start + len(group))
            estimates.append((theta[list(group)], covariance[own_terms, own_terms]))
            start = own_terms.stop
        return _HalfSolution(estimates, float(square_sum) / freedom, freedom)
