"""The posture bootstrap: standard errors that believe in no common noise and no independent rows,
from whole postures.

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
SIGNS = 4_000_000  # drawn at once
LEAST = (
    1e-6  # of a direction that a configuration alone decides: its residual is nought and stays so
)


@dataclass(frozen=True, eq=False)
class Bootstrap:
    """Standard errors (p,), nought where a parameter is not estimable, the draws (REPLICATES, p)
    that they are of, how many units (p,) each rests on, and whether these are groups, else
    postures."""

    errors: Array
    draws: Array = field(repr=False)
    units: Array
    grouped: bool = False

    def p_value(self, fitted: Fit, some: Sequence[int]) -> float:
        """How often signs alone move some coefficients as far as they are estimated, by least
        squares' own measure of far."""
        factor, theta = (
            fitted.factor[list(some)],
            np.vstack([fitted.theta, self.draws])[:, list(some)],
        )
        far = np.einsum("ri,ri->r", theta, np.linalg.solve(factor @ factor.T, theta.T).T)
        return float((far >= far[0]).mean())


def run_bootstrap(parts: Iterable[FoldedData], fitted: Fit, rng: np.random.Generator) -> Bootstrap:
    """Of every parameter.

    `parts`: the training problem at the optimum, a fold per unit, some at a time (`by_unit`). Shrunk
    coefficients are drawn from their prior, as if each were one more configuration, so that their
    errors compare with those of the posterior."""
    kept = list(fitted.found.kept)
    prior, total = fitted.prior, fitted.reduction
    if prior is not None:
        total = Reduction(total.add(prior).R, total.rows)
    beta, factor, _ = solve(total, kept)
    found, share, squared = [], np.zeros(len(kept)), np.zeros(len(kept))
    for part in parts:
        Q, residual = _made_good(part, kept, beta, factor)
        found.append(np.einsum("kar,ka->kr", Q, residual))
        own = np.square(Q @ factor.T).sum(
            1
        )  # (K, r) of a parameter's variance that each unit brings
        share, squared = share + own.sum(0), squared + np.square(own).sum(0)
    scores = np.concatenate(found)
    step = max(1, SIGNS // len(scores))
    moved = np.concatenate(
        [
            draw_signs(rng, min(step, REPLICATES - start), len(scores)) @ scores
            for start in range(0, REPLICATES, step)
        ]
    )
    if prior is not None and len(prior):
        moved = moved + fitted.sigma * rng.standard_normal((REPLICATES, len(kept))) @ _root(
            prior[:, kept] @ factor
        )
    draws, rests = np.zeros((REPLICATES, len(fitted.theta))), np.ones(len(fitted.theta))
    draws[:, kept] = moved @ factor.T
    rests[kept] = np.square(share) / squared
    return Bootstrap(np.sqrt(np.square(draws).mean(0)), draws, rests)


def _root(rows: Array) -> Array:
    """(r, r) symmetric root of rowsᵀ rows: of a prior's rows any turn among themselves says the
    same, and must draw the same."""
    value, vector = np.linalg.eigh(rows.T @ rows)
    return np.asarray((vector * np.sqrt(np.maximum(value, 0.0))) @ vector.T)


def _made_good(
    folded: FoldedData, kept: Sequence[int], beta: Array, factor: Array
) -> tuple[Array, Array]:
    """(Q (K, h, r), residuals (K, h)) of some configurations, what their leverage took from the
    residuals given back."""
    X, y = folded.blocks[:, :, kept], folded.blocks[:, :, -1]
    Q, e = X @ factor, y - X @ beta
    values, vectors = np.linalg.eigh(np.eye(X.shape[1]) - Q @ Q.transpose(0, 2, 1))
    root = np.where(values > LEAST, 1 / np.sqrt(np.maximum(values, LEAST)), 0.0)
    return Q, np.einsum("kab,kb,kcb,kc->ka", vectors, root, vectors, e)


def draw_signs(rng: np.random.Generator, replicates: int, units: int) -> Array:
    """(replicates, units) of −1 and +1."""
    return np.asarray(2.0 * rng.integers(0, 2, (replicates, units)) - 1.0)


def draw_half_samples(rng: np.random.Generator, count: int, units: int) -> Index:
    """(count, units // 2) half-samples without replacement, in complementary pairs (Shah & Samworth
    2013)."""
    half = units // 2
    orders = [rng.permutation(units) for _ in range(-(-count // 2))]
    return np.array(
        [part for order in orders for part in (order[:half], order[half : 2 * half])], dtype=np.intp
    )[:count]
