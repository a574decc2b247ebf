"""Posture bootstrap: standard errors that assume neither a common noise nor independent rows.

The postures are a design, not a sample: they stay, and the residuals of a posture, of all its
targets and repeats, change sign together (wild cluster bootstrap; Cameron, Gelbach & Miller 2008).
Each posture's residuals are first divided by what its leverage takes from them, (I − H_kk)^(−1/2)
(Bell & McCaffrey 2002), so that equal noise gives the analytic errors back. Linear about the
optimum."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from .._typing import Array, Index
from ..fitting.least_squares import Fit
from ..selection.cross_validation import FoldedData
from ..selection.moments import Coordinates

REPLICATES = 999
# units from which the sum of their scores with random signs is normal, and none is kept: what
# remains of a kurtosis of 100 in a unit is then 0.005
MANY_UNITS = 20_000
# signs that are drawn at once
MAX_SIGNS = 4_000_000
# eigenvalue of I − H_kk below which a direction rests on the posture alone: its residual is zero
MIN_FREEDOM = 1e-6


@dataclass(frozen=True, eq=False)
class Bootstrap:
    """Bootstrap of p parameters.

    errors: (p,) standard errors, zero where a parameter is not estimable.
    draws: (REPLICATES, p) departures from the estimates.
    units: (p,) how many units each parameter rests on.
    grouped: whether the units are groups, not postures.
    """

    errors: Array
    draws: Array = field(repr=False)
    units: Array
    grouped: bool = False

    def p_value(self, fitted: Fit, terms: Sequence[int]) -> float:
        """Compute how often signs alone move some coefficients as far as they are estimated, by the
        distance of least squares."""
        columns = list(terms)
        factor = fitted.factor[columns]
        estimates = fitted.theta
        every = np.vstack([estimates, self.draws])
        theta = every[:, columns]
        covariance = factor @ factor.T
        scaled = np.linalg.solve(covariance, theta.T)
        scaled = scaled.T
        distance = np.einsum("ri,ri->r", theta, scaled)
        # the first row is the fit itself
        own = distance[0]
        as_far = distance >= own
        share = as_far.mean()
        return float(share)


def run_bootstrap(parts: Iterable[FoldedData], fitted: Fit, rng: np.random.Generator) -> Bootstrap:
    """Bootstrap all parameters of a fit.

    `parts`: the training problem at the optimum, a fold per unit, some units at a time
    (`fold_by_unit`). Shrunk coefficients are drawn from their prior, as if each were one more
    configuration, so that their errors compare with those of the posterior."""
    own = Coordinates.of(fitted)
    kept = list(own.kept)
    count = own.rank
    factor = own.factor
    beta = factor @ own.projection
    scores = []
    units_in_all = 0
    gram = np.zeros((count, count))
    variance = np.zeros(count)
    squared = np.zeros(count)
    for part in parts:
        Q, residual = _correct_leverage(part, kept, beta, factor)
        score = np.einsum("kar,ka->kr", Q, residual)
        gram += score.T @ score
        units_in_all += len(score)
        if units_in_all <= MANY_UNITS:
            scores.append(score)
        # (K, r) of a parameter's variance that each unit brings
        influence = np.square(Q @ factor.T)
        by_unit = influence.sum(1)
        squares = np.square(by_unit)
        variance = variance + by_unit.sum(0)
        squared = squared + squares.sum(0)
    if units_in_all > MANY_UNITS:
        steps = rng.standard_normal((REPLICATES, count)) @ _compute_root(gram)
    else:
        every_score = np.concatenate(scores)
        steps = _draw_steps(every_score, rng)
    if len(own.prior):
        normal = rng.standard_normal((REPLICATES, count))
        root = _compute_root(own.prior.T @ own.prior)
        noise = fitted.sigma * normal
        steps = steps + noise @ root
    parameters = len(fitted.theta)
    draws = np.zeros((REPLICATES, parameters))
    draws[:, kept] = steps @ factor.T
    units = np.ones(parameters)
    units[kept] = np.square(variance) / squared
    squares = np.square(draws)
    errors = np.sqrt(squares.mean(0))
    return Bootstrap(errors, draws, units)


def _draw_steps(scores: Array, rng: np.random.Generator) -> Array:
    """Draw sums (REPLICATES, r) of the units' scores (K, r) with random signs."""
    units = len(scores)
    at_once = MAX_SIGNS // units
    count = max(1, at_once)
    steps = []
    for start in range(0, REPLICATES, count):
        left = REPLICATES - start
        replicates = min(count, left)
        signs = draw_signs(rng, replicates, units)
        steps.append(signs @ scores)
    return np.concatenate(steps)


def _compute_root(gram: Array) -> Array:
    """Compute the symmetric root (r, r) of products (r, r): invariant to rotations of the rows among
    themselves, which have the same meaning and must give the same draws."""
    value, vector = np.linalg.eigh(gram)
    # rounding may make an eigenvalue negative
    value = np.maximum(value, 0.0)
    length = np.sqrt(value)
    scaled = vector * length
    root = scaled @ vector.T
    return np.asarray(root)


def _correct_leverage(
    folded: FoldedData, kept: Sequence[int], beta: Array, factor: Array
) -> tuple[Array, Array]:
    """Give back what the units' leverage took from their residuals: (Q (K, h, r), residuals (K,
    h))."""
    blocks = folded.blocks
    X = blocks[:, :, kept]
    y = blocks[:, :, -1]
    Q = X @ factor
    residual = y - X @ beta
    height = X.shape[1]
    leverage = Q @ Q.transpose(0, 2, 1)
    identity = np.eye(height)
    values, vectors = np.linalg.eigh(identity - leverage)
    free = values > MIN_FREEDOM
    values = np.maximum(values, MIN_FREEDOM)
    inverse_root = 1 / np.sqrt(values)
    root = np.where(free, inverse_root, 0.0)
    corrected = np.einsum("kab,kb,kcb,kc->ka", vectors, root, vectors, residual)
    return Q, corrected


def draw_signs(rng: np.random.Generator, replicates: int, units: int) -> Array:
    """Draw signs (replicates, units) of −1 and +1."""
    size = (replicates, units)
    heads = rng.integers(0, 2, size)
    signs = 2.0 * heads - 1.0
    return np.asarray(signs)


def draw_half_samples(rng: np.random.Generator, count: int, units: int) -> Index:
    """Draw half-samples (count, units // 2) without replacement, in complementary pairs (Shah &
    Samworth 2013)."""
    half = units // 2
    pairs = -(-count // 2)
    samples = []
    for _ in range(pairs):
        order = rng.permutation(units)
        former = order[:half]
        latter = order[half : 2 * half]
        samples.append(former)
        samples.append(latter)
    every = np.array(samples, dtype=np.intp)
    return every[:count]
