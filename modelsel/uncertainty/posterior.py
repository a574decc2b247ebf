"""The posterior in closed form: draws relinearised at the optimum, importance weights from the
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

DRAWS = (400, 4000)  # fewest and most
WORK = 1_000_000  # draws x configurations to stay within
CURVED = 20_000  # rows on which the chain's curvature is felt out


@dataclass(frozen=True, eq=False)
class Posterior:
    """Student-t at the optimum: theta (p,), `factor` (p, r) with covariance σ² factor factorᵀ,
    least cost Q₀ and ν."""

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
        """(p,) scale of the marginal t of every parameter; nought where it is not estimable."""
        return np.asarray(np.sqrt(np.square(self.factor).sum(1)) * self.scale)

    def quantile(self, probability: Array | float) -> Array:
        """(p,) of the marginals; (p, k) for k probabilities."""
        from scipy.special import stdtrit

        t = stdtrit(self.freedom, np.asarray(probability))
        theta = self.theta[(slice(None), *[None] * np.ndim(t))]
        return np.asarray(theta + np.multiply.outer(self.spread, t))

    def scale_quantile(self, probability: Array | float) -> Array:
        """Quantiles of the noise scale, in whitened units."""
        from scipy.special import chdtri

        return np.asarray(np.sqrt(self.cost / chdtri(self.freedom, np.asarray(probability))))

    def draw(self, rng: np.random.Generator, count: int) -> Draws:
        """Independent draws; all weights alike."""
        sigma = np.sqrt(self.cost / rng.chisquare(self.freedom, count))
        normal = rng.standard_normal((count, self.factor.shape[1]))
        return Draws(
            self.theta + sigma[:, None] * (normal @ self.factor.T), sigma, np.full(count, 1 / count)
        )


@dataclass(frozen=True, eq=False)
class Draws:
    """theta (n, p), sigma (n,) in whitened units, weights (n,) that sum to one."""

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
        return np.asarray(np.sqrt(np.maximum(self.weight @ np.square(self.theta - mean), 0.0)))


def linear_posterior(fitted: Fit) -> Posterior:
    """Of a fit at its optimum."""
    cost = fitted.rss + float(np.square(fitted.root @ fitted.theta).sum())
    return Posterior(
        fitted.theta, fitted.factor, cost, fitted.rows - (fitted.found.rank - fitted.by_prior)
    )


def weight_draws(problem: Problem, fitted: Fit, draws: Draws) -> Draws:
    """The draws with importance weights: the exact chain's posterior over the linear one, on the
    fit's own problem. How far the chain departs from its tangent is worked out on at most CURVED
    rows, evenly spread, that stand for all: thinning can only make the weights less even. The prior
    is in both, and alike."""
    some = (
        problem
        if len(problem) <= CURVED
        else problem.take(np.linspace(0, len(problem) - 1, CURVED).astype(np.intp))
    )
    ensemble, cost = Ensemble(some, fitted.terms), np.empty(len(draws.theta))
    step = max(1, WORK // (10 * len(some)))
    for start in range(0, len(cost), step):
        part = slice(start, start + step)
        cost[part] = np.square(ensemble.residuals(draws.theta[part])).sum((1, 2))
    R = reduce_problem(some, fitted.terms, fitted.at(), fitted.found.kept).R
    linear = np.square(R[:, -1] - (draws.theta - fitted.theta) @ R[:, :-1].T).sum(1)
    log_weight = (linear - cost) / (2 * np.square(draws.sigma)) * (len(problem) / len(some))
    weight = np.exp(log_weight - log_weight.max())
    return Draws(draws.theta, draws.sigma, np.asarray(weight / weight.sum()))


def choose_draw_count(problem: Problem) -> int:
    """How many draws a problem of this size gets: bounded work, whatever its size."""
    return int(np.clip(WORK // len(problem), *DRAWS))


@dataclass(frozen=True)
class Importance:
    """How good the posterior linear about the optimum is, in numbers and words."""

    draws: int
    effective: float
    sentence: str


def summarise_importance(draws: Draws) -> Importance:
    """Of weighted draws."""
    count, effective = len(draws.weight), draws.effective
    share = effective / count
    if share > 0.9:
        what = "the exact chain's posterior is the linear one"
    elif share > 0.3:
        what = "the chain's curvature is felt, and the weights account for it"
    else:
        what = "the chain is too curved for the linear posterior; believe the sampled one"
    return Importance(
        count, effective, f"Of {count:,} closed-form draws {effective:,.0f} are effective: {what}."
    )
