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
from ..fitting.identifiability import solve
from ..fitting.least_squares import Fit
from ..fitting.reduction import Reduction
from ..selection.cross_validation import FoldedData

REPLICATES = 999
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
        theta = np.vstack([fitted.theta, self.draws])[:, columns]
        scaled = np.linalg.solve(factor @ factor.T, theta.T).T
        distance = np.einsum("ri,ri->r", theta, scaled)
        return float((distance >= distance[0]).mean())


def run_bootstrap(parts: Iterable[FoldedData], fitted: Fit, rng: np.random.Generator) -> Bootstrap:
    """Bootstrap all parameters of a fit.

    `parts`: the training problem at the optimum, a fold per unit, some units at a time
    (`fold_by_unit`). Shrunk coefficients are drawn from their prior, as if each were one more
    configuration, so that their errors compare with those of the posterior."""
    kept = list(fitted.found.kept)
    total = fitted.reduction
    if fitted.prior is not None:
        total = Reduction(total.add(fitted.prior).R, total.rows)
    beta, factor, _ = solve(total, kept)
    scores = []
    variance = np.zeros(len(kept))
    squared = np.zeros(len(kept))
    for part in parts:
        Q, residual = _correct_leverage(part, kept, beta, factor)
        scores.append(np.einsum("kar,ka->kr", Q, residual))
        # (K, r) of a parameter's variance that each unit brings
        by_unit = np.square(Q @ factor.T).sum(1)
        variance = variance + by_unit.sum(0)
        squared = squared + np.square(by_unit).sum(0)
    steps = _draw_steps(np.concatenate(scores), rng)
    if fitted.prior is not None and len(fitted.prior):
        normal = rng.standard_normal((REPLICATES, len(kept)))
        steps = steps + fitted.sigma * normal @ _symmetric_root(fitted.prior[:, kept] @ factor)
    draws = np.zeros((REPLICATES, len(fitted.theta)))
    draws[:, kept] = steps @ factor.T
    units = np.ones(len(fitted.theta))
    units[kept] = np.square(variance) / squared
    return Bootstrap(np.sqrt(np.square(draws).mean(0)), draws, units)


def _draw_steps(scores: Array, rng: np.random.Generator) -> Array:
    """Sums (REPLICATES, r) of the units' scores (K, r) with random signs."""
    count = max(1, MAX_SIGNS // len(scores))
    steps = []
    for start in range(0, REPLICATES, count):
        signs = draw_signs(rng, min(count, REPLICATES - start), len(scores))
        steps.append(signs @ scores)
    return np.concatenate(steps)


def _symmetric_root(rows: Array) -> Array:
    """Symmetric root (r, r) of rowsᵀ rows: invariant to rotations of a prior's rows among
    themselves, which have the same meaning and must give the same draws."""
    value, vector = np.linalg.eigh(rows.T @ rows)
    return np.asarray((vector * np.sqrt(np.maximum(value, 0.0))) @ vector.T)


def _correct_leverage(
    folded: FoldedData, kept: Sequence[int], beta: Array, factor: Array
) -> tuple[Array, Array]:
    """Give back what the units' leverage took from their residuals: (Q (K, h, r), residuals (K,
    h))."""
    X = folded.blocks[:, :, kept]
    Q = X @ factor
    residual = folded.blocks[:, :, -1] - X @ beta
    values, vectors = np.linalg.eigh(np.eye(X.shape[1]) - Q @ Q.transpose(0, 2, 1))
    inverse_root = 1 / np.sqrt(np.maximum(values, MIN_FREEDOM))
    root = np.where(values > MIN_FREEDOM, inverse_root, 0.0)
    return Q, np.einsum("kab,kb,kcb,kc->ka", vectors, root, vectors, residual)


def draw_signs(rng: np.random.Generator, replicates: int, units: int) -> Array:
    """Draw signs (replicates, units) of −1 and +1."""
    return np.asarray(2.0 * rng.integers(0, 2, (replicates, units)) - 1.0)


def draw_half_samples(rng: np.random.Generator, count: int, units: int) -> Index:
    """Draw half-samples (count, units // 2) without replacement, in complementary pairs (Shah &
    Samworth 2013)."""
    half = units // 2
    samples = []
    for _ in range(-(-count // 2)):
        order = rng.permutation(units)
        samples += [order[:half], order[half : 2 * half]]
    return np.array(samples, dtype=np.intp)[:count]
