"""What could at best be known: the power of one who tests the true mechanism alone, and how well it
can be named.

methods.md A.6 (the exact max-test) and A.7 (the physical limit).
"""

from __future__ import annotations

import numpy as np
from hidden_arm import Effect, State, geometry, off
from scipy.special import betaincc, fdtri, ncfdtr, ndtr

from modelsel.diagnosis.inference.scan import Scan

CERTAIN = 60.0


def smallest_p(seen: Scan, share: np.ndarray) -> np.ndarray:
    """(B,) smallest p-value over all candidates of their shares (G, B) of the residual: Beta(k/2,
    (freedom - k)/2)."""
    sizes = seen.sizes
    return np.min(
        [
            betaincc(k / 2, (seen.freedom - k) / 2, np.clip(share[sizes == k].max(0), 0, 1))
            for k in np.unique(sizes)
            if 0 < k < seen.freedom
        ],
        axis=0,
    )


def critical_p(
    seen: Scan, rng: np.random.Generator, draws: int = 499, level: float = 0.05
) -> float:
    """The scan's own family-wise critical value: the exact max-test's smallest single p-value at
    the level."""
    u = rng.standard_normal((seen.columns.rows, draws))
    u -= seen.Q @ (seen.Q.T @ u)
    return float(
        np.quantile(
            smallest_p(seen, seen.strength(seen.columns.dot(u))[0] / np.square(u).sum(0)), level
        )
    )


def power(
    effect: Effect, state: State, others: np.ndarray, noise: float, p_critical: float
) -> tuple[float, float]:
    """(power, delta) of the F test of a true mechanism alone, `others` (3 m, ·) known besides the
    geometry; delta: norm of what is left of it, in units of the noise."""
    J = state.arm.screws(state.q)
    P = np.linalg.qr(np.hstack([geometry(J), others]))[0]
    columns = effect.columns(state, J)
    own = off(P, columns)
    rank = int(np.linalg.matrix_rank(own / effect.scale(columns), tol=1e-4))
    delta = float(np.linalg.norm(own @ effect.sizes) / noise)
    free = len(own) - P.shape[1] - rank
    return (detection(delta, rank, free, p_critical) if rank else 0.0), delta


def detection(delta: float, rank: int, free: int, p_critical: float) -> float:
    """Power of an F test of `rank` columns at noncentrality delta²."""
    if delta > CERTAIN:  # where scipy's noncentral F gives up
        return 1.0
    return float(1 - ncfdtr(rank, free, delta**2, fdtri(rank, free, 1 - p_critical)))


def naming_limit(delta: float, rho: float) -> float:
    """Rate at which anyone could name the right one of two causes with residual correlation rho."""
    a, b = delta * np.sqrt((1 - rho) / 2), delta * np.sqrt((1 + rho) / 2)
    return float(ndtr(a) * ndtr(b) + ndtr(-a) * ndtr(-b))


def held_by(displacement: np.ndarray, seen: Scan) -> np.ndarray:
    """(G,) share of the norm of a displacement (3 m,), configuration by configuration, that every
    candidate holds beyond the base: of the tool's own columns, to know which explanations stand
    near each other; nothing is judged by it."""
    d = off(seen.Q, displacement.reshape(-1, 3).T.ravel())
    return np.sqrt(seen.strength(seen.see(d).column)[0][:, 0]) / np.linalg.norm(d)
