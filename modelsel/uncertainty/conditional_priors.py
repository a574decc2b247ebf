"""Prior of the coefficients that a sampled constant affects, and their distribution at every value
of the constant.

At some values such coefficients cannot be estimated at all: a step before the first configuration
moves nothing. Flat priors would make their posterior improper there, so they get the normal prior
of the scan (`diagnosis.inference.evidence`): covariance v · S⁻¹, S the information about them beyond all other
coefficients, here averaged over the constant's range; v/s² as the data find it most probable, over
the same ratios. Given the constant, the coefficients are normal up to the chain's curvature;
walkers live in units of that distribution, so that a walker may change the constant alone and take
its coefficients with it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from .._linalg import project_out
from .._typing import Array, Index
from ..diagnosis.inference.evidence import RATIOS
from ..fitting.design import compute_design
from ..fitting.linearisation import Linearisation
from ..fitting.problem import Problem
from ..mechanisms.terms import Screw, Term
from ..robot.rigid import AXES
from .nuisance import GRID, Constant

# walkers that are transformed together
BATCH = 20_000


@dataclass(frozen=True, eq=False)
class ConditionalPrior:
    """Distribution of the k coefficients that a constant affects, at GRID values over its range.

    affected: (k,) their positions among the sampled coefficients.
    plain: (o,) positions of the coefficients that no constant affects.
    mean: (GRID, k) where the plain coefficients are at the optimum.
    slope: (GRID, k, o) minus the change of the mean per unit of the plain ones.
    root: (GRID, k, k) upper root of the covariance, in units of the noise.
    prior: (k, k); prior · affected ~ N(0, 1) times the noise.
    ratio: the prior's variance over that of the estimate at a typical value.
    """

    constant: Constant
    affected: Index
    plain: Index
    mean: Array = field(repr=False)
    slope: Array = field(repr=False)
    root: Array = field(repr=False)
    prior: Array = field(repr=False)
    ratio: float

    def place(self, points: Array, value: Array, origin: Array, scale: float) -> None:
        """Convert the affected coefficients of points (W, d) to natural units, in place.

        The plain ones, counted from `origin` (o,), and the constant's values (W,) are natural
        already; `scale` is the noise."""
        for start in range(0, len(points), BATCH):
            part = slice(start, start + BATCH)
            batch = points[part]
            below, share = self.constant.interpolate(value[part])
            mean = _interpolate(self.mean, below, share[:, None])
            slope = _interpolate(self.slope, below, share[:, None, None])
            root = _interpolate(self.root, below, share[:, None, None])
            shift = np.einsum("wko,wo->wk", slope, batch[:, self.plain] - origin)
            spread = scale * np.einsum("wkl,wl->wk", root, batch[:, self.affected])
            batch[:, self.affected] = mean - shift + spread

    @cached_property
    def _diagonal(self) -> Array:
        matrices = self.root
        return np.diagonal(matrices, 0, 1, 2)

    def log_volume(self, value: Array) -> Array:
        """Compute the logarithm (W,) of the determinant of that change of units, up to a constant,
        at values (W,) of the inner constant."""
        constant = self.constant
        below, share = constant.interpolate(value)
        diagonal = _interpolate(self._diagonal, below, share[:, None])
        logarithm = np.log(diagonal)
        log_det = logarithm.sum(1)
        return np.asarray(log_det)

    def log_prior(self, points: Array, log_scale: Array) -> Array:
        """Compute the log prior (W,) of the affected coefficients of natural points (W, d), up to a
        constant; `log_scale` (W,) of the noise."""
        affected = self.affected
        count = len(affected)
        coefficients = points[:, affected]
        scaled = coefficients @ self.prior.T
        squares = np.square(scaled)
        cost = squares.sum(1)
        doubled = -2 * log_scale
        precision = np.exp(doubled)
        half_cost = 0.5 * cost
        log_prior = -count * log_scale
        log_prior = log_prior - half_cost * precision
        return np.asarray(log_prior)


def _interpolate(table: Array, below: Index, share: Array) -> Array:
    """Interpolate a table (GRID, ...) between the grid points `below` and the next ones."""
    above = below + 1
    lower = 1 - share
    value = table[below] * lower
    step = table[above] * share
    value = value + step
    return np.asarray(value)


def build_conditionals(
    problem: Problem,
    at: Linearisation,
    sampled: Sequence[int],
    constants: Sequence[Constant],
    Q: Array,
    tangent: tuple[Array, Array],
    freedom: float,
) -> tuple[ConditionalPrior, ...]:
    """Build the conditional prior of every constant that affects a sampled coefficient.

    at: the optimum, as (terms, theta).
    sampled: term indices of the sampled coefficients.
    Q: (N, r) basis of the coefficients that are integrated out.
    tangent: all columns (N, p) and the residual (N,) at the optimum, with the rows of a prior below
        the data's.
    freedom: degrees of freedom of that fit."""
    X, residual = tangent
    place = {k: i for i, k in enumerate(sampled)}
    affected = [sorted({place[k] for _, k, _ in c.tables if k in place}) for c in constants]
    every = set().union(*affected)
    plain = [i for i in range(len(sampled)) if i not in every]
    conditionals = []
    for constant, positions in zip(constants, affected, strict=True):
        if not positions:
            continue
        index = [sampled[i] for i in positions]
        others = [k for i, k in enumerate(sampled) if i not in positions]
        held = X[:, index]
        # columns at every value of the constant, and the response to them
        beyond = project_out(held, Q)
        changes = _changes(problem, at, constant, index, len(X))
        grid = np.stack([beyond + project_out(change, Q) for change in changes])
        response = project_out(residual, Q) + beyond @ at.theta[index]
        rest = project_out(X[:, others], Q)
        basis = np.linalg.qr(rest)[0] if others else rest
        columns = np.concatenate([grid, beyond[None]])
        prior, ratio = _fit_prior(columns, response, basis, freedom + len(positions))
        gram = np.einsum("gnk,gnl->gkl", grid, grid) + prior.T @ prior
        known = project_out(X[:, [sampled[i] for i in plain]], Q)
        conditionals.append(
            ConditionalPrior(
                constant,
                np.array(positions, dtype=np.intp),
                np.array(plain, dtype=np.intp),
                np.linalg.solve(gram, (response @ grid)[:, :, None])[:, :, 0],
                np.linalg.solve(gram, grid.transpose(0, 2, 1) @ known),
                np.linalg.inv(np.linalg.cholesky(gram)).transpose(0, 2, 1),
                prior,
                ratio,
            )
        )
    return tuple(conditionals)


def _changes(
    problem: Problem, at: Linearisation, constant: Constant, index: Sequence[int], rows: int
) -> Iterator[Array]:
    """Yield, at every grid point, how the columns (rows, k) of the terms `index` depart from the
    model's."""
    tables = [table for table in constant.tables if table[1] in index]
    places = sorted({place for place, _, _ in tables})
    # a term per place with a constant cause
    terms = []
    for frame, axis in places:
        number = frame + 1
        direction = AXES[axis]
        screw = Screw(number, direction)
        term = Term(direction, (screw,))
        terms.append(term)
    # (places, c, m) columns of a unit cause
    design, _ = compute_design(problem, terms, at)
    unit = design.transpose(2, 1, 0)
    columns = len(index)
    for n in range(GRID):
        change = np.zeros((rows, columns))
        for place, k, table in tables:
            i = places.index(place)
            j = index.index(k)
            cause = table[n]
            by_unit_cause = unit[i]
            product = by_unit_cause * cause
            product = product.reshape(-1)
            column = problem.select_measured(product)
            measured = len(column)
            change[:measured, j] += column
        yield change


def _fit_prior(grid: Array, response: Array, others: Array, freedom: float) -> tuple[Array, float]:
    """Fit the prior's variance by the evidence, summed over the values of the constant.

    grid: (G, N, k) columns at all values; response: (N,); others: (N, o) basis of the other
    coefficients. Returns the upper root (k, k) of the prior's precision in units of the noise, and
    the ratio v/s²."""
    projected = others.T @ grid
    alone = grid - others @ projected
    rest = project_out(response, others)
    gram = np.einsum("gnk,gnl->gkl", alone, alone)
    cross = rest @ alone
    products = cross[:, :, None]
    # squared length of the response beyond the other coefficients
    total = rest @ rest
    typical = gram.mean(0)
    half_freedom = 0.5 * freedom
    most = 1 - 1e-12
    largest = -np.inf
    best = 0.0
    for ratio in map(float, RATIOS):
        precision = typical / ratio
        posterior = gram + precision
        solution = np.linalg.solve(posterior, products)
        solution = solution[:, :, 0]
        explained = np.einsum("gk,gk->g", cross, solution)
        share = explained / float(total)
        share = np.minimum(share, most)
        left = np.log1p(-share)
        _, log_prior = np.linalg.slogdet(precision)
        _, log_posterior = np.linalg.slogdet(posterior)
        shrinkage = log_prior - log_posterior
        half = 0.5 * shrinkage
        misfit = half_freedom * left
        evidence = half - misfit
        summed = np.logaddexp.reduce(evidence)
        summed = float(summed)
        if (summed, ratio) > (largest, best):
            largest = summed
            best = ratio
    scaled = typical / best
    factor = np.linalg.cholesky(scaled)
    return factor.T, best
