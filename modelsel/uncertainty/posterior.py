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
        return float(np.sqrt(self.cost / self.freedom))

    @property
    def spread(self) -> Array:
        """(p,) scale of the marginal t of every parameter; zero where it is not estimable."""
        length = np.sqrt(np.square(self.factor).sum(1))
        return np.asarray(length * self.scale)

    def quantile(self, probability: Array | float) -> Array:
        """Compute quantiles (p,) of the marginals; (p, k) for k probabilities."""
        from scipy.special import stdtrit

        t = stdtrit(self.freedom, np.asarray(probability))
        theta = self.theta.reshape(-1, *[1] * np.ndim(t))
        return np.asarray(theta + np.multiply.outer(self.spread, t))

    def scale_quantile(self, probability: Array | float) -> Array:
        """Compute quantiles of the noise scale, in whitened units."""
        from scipy.special import chdtri

        chi_square = chdtri(self.freedom, np.asarray(probability))
        return np.asarray(np.sqrt(self.cost / chi_square))

    def draw(self, rng: np.random.Generator, count: int) -> Draws:
        """Draw independently, with equal weights."""
        sigma = np.sqrt(self.cost / rng.chisquare(self.freedom, count))
        normal = rng.standard_normal((count, self.factor.shape[1]))
        theta = self.theta + sigma[:, None] * (normal @ self.factor.T)
        return Draws(theta, sigma, np.full(count, 1 / count))


@dataclass(frozen=True, eq=False)
class Draws:
    """Weighted draws: theta (n, p), sigma (n,) in whitened units, weights (n,) that sum to one."""

    theta: Array
    sigma: Array
    weight: Array

    @property
    def effective(self) -> float:
        """Effective number of independent draws (Kish 1965)."""
        return float(1 / np.square(self.weight).sum())

    @property
    def spread(self) -> Array:
        """(p,) weighted standard deviation of every parameter."""
        mean = self.weight @ self.theta
        variance = self.weight @ np.square(self.theta - mean)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def linear_posterior(fitted: Fit) -> Posterior:
    """Compute the posterior of a fit, linear about its optimum."""
    cost = fitted.rss + float(np.square(fitted.root @ fitted.theta).sum())
    freedom = fitted.rows - (fitted.found.rank - fitted.by_prior)
    return Posterior(fitted.theta, fitted.factor, cost, freedom)


def weight_draws(problem: Problem, fitted: Fit, draws: Draws, max_rows: int = MAX_ROWS) -> Draws:
    """Weight draws by the exact chain's posterior over the linear one, on the fit's own problem.

    The departure of the chain from its tangent is evaluated on at most `max_rows` rows, evenly
    spread, that stand for all: thinning can only make the weights less even. The prior is in both,
    and alike."""
    part = problem
    if len(problem) > max_rows:
        part = problem.take(np.linspace(0, len(problem) - 1, max_rows).astype(np.intp))
    exact = _exact_cost(part, fitted, draws.theta)
    R = reduce_problem(part, fitted.terms, fitted.at(), fitted.found.kept).R
    step = draws.theta - fitted.theta
    linear = np.square(R[:, -1] - step @ R[:, :-1].T).sum(1)
    rows_each = len(problem) / len(part)
    log_weight = (linear - exact) / (2 * np.square(draws.sigma)) * rows_each
    weight = np.exp(log_weight - log_weight.max())
    return Draws(draws.theta, draws.sigma, np.asarray(weight / weight.sum()))


def _exact_cost(problem: Problem, fitted: Fit, theta: Array) -> Array:
    """Sums of squared whitened residuals (n,) of the exact chain at coefficients (n, p)."""
    ensemble = Ensemble(problem, fitted.terms)
    cost = np.empty(len(theta))
    count = max(1, MAX_WORK // (10 * len(problem)))
    for start in range(0, len(cost), count):
        part = slice(start, start + count)
        cost[part] = np.square(ensemble.residuals(theta[part])).sum((1, 2))
    return cost


def choose_draw_count(problem: Problem) -> int:
    """Choose the number of draws so that the work is bounded, whatever the problem's size."""
    return int(np.clip(MAX_WORK // len(problem), *DRAWS))


@dataclass(frozen=True)
class Importance:
    """Quality of the posterior that is linear about the optimum, in numbers and words."""

    draws: int
    effective: float
    sentence: str


def summarise_importance(draws: Draws) -> Importance:
    """Summarise weighted draws: their effective number, and what it says of the linear posterior."""
    count = len(draws.weight)
    effective = draws.effective
    share = effective / count
    if share > EXACT_SHARE:
        verdict = "the exact chain's posterior is the linear one"
    elif share > USEFUL_SHARE:
        verdict = "the chain's curvature matters, and the weights account for it"
    else:
        verdict = "the chain is too curved for the linear posterior; believe the sampled one"
    sentence = f"Of {count:,} closed-form draws {effective:,.0f} are effective: {verdict}."
    return Importance(count, effective, sentence)
