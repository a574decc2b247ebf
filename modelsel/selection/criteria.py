"""Information criteria and evidence as plain functions of rss, rows and rank (methods.md A.3,
A.5)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .._typing import Array


def _deviance(rss: Array, n: int, sigma: float | None) -> Array:
    return np.asarray(n * np.log(rss / n) if sigma is None else rss / sigma**2)


def aic(rss: ArrayLike, n: int, rank: ArrayLike, sigma: float | None = None) -> Array:
    """n ln(RSS/n) + 2(r+1); RSS/σ² + 2r with σ known. Akaike 1974."""
    return np.asarray(
        _deviance(np.asarray(rss), n, sigma) + 2 * (np.asarray(rank) + (sigma is None))
    )


def aicc(rss: ArrayLike, n: int, rank: ArrayLike, sigma: float | None = None) -> Array:
    """AIC + 2K(K+1)/(n−K−1), K = r+1; infinite ("saturated") where the rank leaves no room. Hurvich
    & Tsai 1989."""
    K = np.asarray(rank) + 1
    room = n - K - 1.0
    extra = np.where(room > 0, 2 * K * (K + 1) / np.where(room > 0, room, 1), np.inf)
    return np.asarray(aic(rss, n, rank, sigma) + (extra if sigma is None else 0))


def bic(
    rss: ArrayLike, n: int, rank: ArrayLike, sigma: float | None = None, count: int | None = None
) -> Array:
    """n ln(RSS/n) + (r+1) ln count; count: independent units (configurations where coordinates
    correlate). Schwarz 1978."""
    return np.asarray(
        _deviance(np.asarray(rss), n, sigma)
        + (np.asarray(rank) + (sigma is None)) * np.log(count or n)
    )


def gcv(rss: ArrayLike, n: int, rank: ArrayLike) -> Array:
    """n RSS/(n−r)²; infinite where saturated. Golub, Heath & Wahba 1979."""
    room = n - np.asarray(rank, float)
    return np.asarray(
        np.where(room > 0, n * np.asarray(rss) / np.where(room > 0, room, 1) ** 2, np.inf)
    )


def ebic(
    rss: ArrayLike,
    n: int,
    rank: ArrayLike,
    chosen: ArrayLike,
    groups: int,
    gamma: float = 1.0,
    sigma: float | None = None,
) -> Array:
    """BIC + 2γ ln C(groups, chosen). Chen & Chen 2008."""
    return np.asarray(bic(rss, n, rank, sigma) + gamma * scan_price(chosen, groups))


def scan_price(chosen: ArrayLike, groups: int) -> Array:
    """2 ln C(groups, chosen): what EBIC charges beyond BIC for having chosen among so many
    groups."""
    from scipy.special import gammaln

    s = np.asarray(chosen)
    return np.asarray(2 * (gammaln(groups + 1) - gammaln(s + 1) - gammaln(groups - s + 1)))


def log_evidence(
    rss: ArrayLike,
    rss_base: float,
    n: int,
    rank_base: int,
    extra: ArrayLike,
    sigma: float | None = None,
) -> Array:
    """ln Bayes factor against the base, unit-information g-prior (g = n) on the extra columns; σ
    integrated out, or known. Zellner 1986; Liang 2008."""
    p = np.asarray(extra)
    if sigma is not None:
        return np.asarray(
            n / (1 + n) * (rss_base - np.asarray(rss)) / (2 * sigma**2) - p / 2 * np.log1p(n)
        )
    unexplained = np.asarray(rss) / rss_base
    return np.asarray(
        (n - rank_base - p) / 2 * np.log1p(n) - (n - rank_base) / 2 * np.log1p(n * unexplained)
    )


def normalise_weights(criterion: ArrayLike) -> Array:
    """exp(−Δ/2), normalised: Akaike weights, or posterior weights from BIC."""
    values = np.asarray(criterion, float)
    finite = np.isfinite(values)
    if not finite.any():
        return np.full(len(values), 1 / max(len(values), 1))
    out = np.where(finite, np.exp(-np.where(finite, values - values[finite].min(), 0) / 2), 0)
    return np.asarray(out / out.sum())
