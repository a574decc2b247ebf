"""Posterior in closed form, linear about the optimum, and importance weights of its draws from the
exact chain.

Flat prior on the coefficients (a normal one, in units of the noise, on those that are shrunk or
that the data hardly determine) and 1/σ on the noise scale. With cost Q(θ) = |ρ(θ)|² + θᵀΛθ of the
whitened residual ρ, linearised at its minimum θ̂ where it is Q₀,
    σ² | y ~ Q₀ / χ²_ν,   θ | σ, y ~ N(θ̂, σ² (JᵀJ + Λ)⁻¹),   ν = rows − coefficients that no prior holds
(Gelman et al. 2013, 14.2), so each θ is a t with ν degrees of freedom. A draw's weight is the exact
posterior over this one; the effective number of draws, (Σw)²/Σw², says how good the linear
posterior is."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .._linalg import TINY
from .._typing import Array
from ..fitting.batch import Ensemble
from ..fitting.least_squares import Fit
from ..fitting.problem import Problem
from ..fitting.reduction import reduce_problem

# fewest and most draws
DRAWS = (400, 4000)
# draws x configurations to stay within
MAX_WORK = 1_000_000
# rows on which the departure of the chain from its tangent is evaluated
MAX_ROWS = 20_000
# share of effective draws above which the linear posterior is exact, and useful
EXACT_SHARE, USEFUL_SHARE = 0.9, 0.3


@dataclass(frozen=True, eq=False)
class Posterior:
    """Multivariate t about the optimum.

    theta: (p,) estimates.
    factor: (p, r); σ² factor factorᵀ is the covariance.
    cost: least cost Q₀.
    freedom: degrees of freedom ν.
    """

    theta: Array
    factor: Array = field(repr=False)
    cost: float
    freedom: float

    @property
    def scale(self) -> float:
        """The noise scale, in whitened units: the square root of Q₀/ν."""
        variance = self.cost / self.freedom
        scale = np.sqrt(variance)
        return float(scale)

    @property
    def spread(self) -> Array:
        """(p,) scale of the marginal t of every parameter; zero where it is not estimable."""
        squares = np.square(self.factor)
        square_sum = squares.sum(1)
        length = np.sqrt(square_sum)
        spread = length * self.scale
        return np.asarray(spread)

    def quantile(self, probability: Array | float) -> Array:
        """Compute quantiles (p,) of the marginals; (p, k) for k probabilities."""
        from scipy.special import stdtrit

        probabilities = np.asarray(probability)
        t = stdtrit(self.freedom, probabilities)
        more_axes = [1] * np.ndim(t)
        theta = self.theta.reshape(-1, *more_axes)
        departure = np.multiply.outer(self.spread, t)
        quantiles = theta + departure
        return np.asarray(quantiles)

    def scale_quantile(self, probability: Array | float) -> Array:
        """Compute quantiles of the noise scale, in whitened units."""
        from scipy.special import chdtri

        probabilities = np.asarray(probability)
        chi_square = chdtri(self.freedom, probabilities)
        variance = self.cost / chi_square
        scale = np.sqrt(variance)
        return np.asarray(scale)

    def draw(self, rng: np.random.Generator, count: int) -> Draws:
        """Draw independently, with equal weights."""
        _, rank = self.factor.shape
        chi_square = rng.chisquare(self.freedom, count)
        variance = self.cost / chi_square
        sigma = np.sqrt(variance)
        normal = rng.standard_normal((count, rank))
        step = normal @ self.factor.T
        scale = sigma[:, None]
        step = scale * step
        theta = self.theta + step
        share = 1 / count
        weight = np.full(count, share)
        return Draws(theta, sigma, weight)


@dataclass(frozen=True, eq=False)
class Draws:
    """Weighted draws: theta (n, p), sigma (n,) in whitened units, weights (n,) that sum to one."""

    theta: Array
    sigma: Array
    weight: Array

    @property
    def effective(self) -> float:
        """Effective number of independent draws (Kish 1965)."""
        squares = np.square(self.weight)
        number = 1 / squares.sum()
        return float(number)

    @property
    def spread(self) -> Array:
        """(p,) weighted standard deviation of every parameter."""
        weight = self.weight
        mean = weight @ self.theta
        departure = self.theta - mean
        squares = np.square(departure)
        variance = weight @ squares
        variance = np.maximum(variance, 0.0)
        spread = np.sqrt(variance)
        return np.asarray(spread)


def linear_posterior(fitted: Fit) -> Posterior:
    """Compute the posterior of a fit, linear about its optimum."""
    scaled = fitted.root @ fitted.theta
    squares = np.square(scaled)
    prior_cost = float(squares.sum())
    cost = fitted.rss + prior_cost
    by_data = fitted.found.rank - fitted.by_prior
    freedom = fitted.rows - by_data
    return Posterior(fitted.theta, fitted.factor, cost, freedom)


def weight_draws(problem: Problem, fitted: Fit, draws: Draws, max_rows: int = MAX_ROWS) -> Draws:
    """Weight draws by the exact chain's posterior over the linear one, on the fit's own problem.

    The departure of the chain from its tangent is evaluated on at most `max_rows` rows, evenly
    spread, that stand for all: thinning can only make the weights less even. The prior is in both,
    and alike."""
    theta = draws.theta
    rows = len(problem)
    part = problem
    if rows > max_rows:
        places = np.linspace(0, rows - 1, max_rows)
        index = places.astype(np.intp)
        part = problem.take(index)
    exact = _exact_cost(part, fitted, theta)
    at = fitted.at()
    kept = fitted.found.kept
    reduction = reduce_problem(part, fitted.terms, at, kept)
    response = reduction.R[:, -1]
    columns = reduction.R[:, :-1]
    step = theta - fitted.theta
    residual = response - step @ columns.T
    squares = np.square(residual)
    linear = squares.sum(1)
    rows_each = rows / len(part)
    double_variance = np.maximum(2 * np.square(draws.sigma), TINY)
    log_weight = (linear - exact) / double_variance
    log_weight = log_weight * rows_each
    largest = log_weight.max()
    weight = np.exp(log_weight - largest)
    share = weight / weight.sum()
    return Draws(theta, draws.sigma, np.asarray(share))


def _exact_cost(problem: Problem, fitted: Fit, theta: Array) -> Array:
    """Compute sums of squared whitened residuals (n,) of the exact chain at coefficients (n, p)."""
    ensemble = Ensemble(problem, fitted.terms)
    draws = len(theta)
    cost = np.empty(draws)
    rows = len(problem)
    work = 10 * rows
    at_once = MAX_WORK // work
    count = max(1, at_once)
    for start in range(0, draws, count):
        stop = start + count
        part = slice(start, stop)
        residual = ensemble.residuals(theta[part])
        squares = np.square(residual)
        cost[part] = squares.sum((1, 2))
    return cost


def choose_draw_count(problem: Problem) -> int:
    """Choose the number of draws so that the work is bounded, whatever the problem's size."""
    fewest, most = DRAWS
    count = MAX_WORK // len(problem)
    count = min(count, most)
    return max(count, fewest)


@dataclass(frozen=True)
class Importance:
    """Quality of the posterior that is linear about the optimum, in numbers and words."""

    draws: int
    effective: float
    sentence: str


def summarise_importance(draws: Draws, is_sampled: bool = True) -> Importance:
    """Summarise weighted draws: their effective number, and what it says of the linear posterior.

    is_sampled: whether there is a sampled posterior to believe instead, of a converged chain."""
    count = len(draws.weight)
    effective = draws.effective
    share = effective / count
    if share > EXACT_SHARE:
        verdict = "the posterior of the exact chain is that of the linear model"
    elif share > USEFUL_SHARE:
        verdict = "the chain's curvature matters, and the weights account for it"
    elif is_sampled:
        verdict = "the chain is too curved for the linear posterior; believe the sampled one"
    else:
        verdict = "the chain is too curved for the linear posterior: its intervals are rough"
    sentence = f"Of {count:,} closed-form draws {effective:,.0f} are effective: {verdict}."
    return Importance(count, effective, sentence)
