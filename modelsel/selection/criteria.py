"""Information criteria and evidence, as functions of the residual sum of squares `rss`, the number
of rows `n` and the rank `r` (methods.md A.3, A.5); `sigma` where the noise is known."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .._typing import Array


def _deviance(rss: Array, n: int, sigma: float | None) -> Array:
    return np.asarray(n * np.log(rss / n) if sigma is None else rss / sigma**2)


def aic(rss: ArrayLike, n: int, rank: ArrayLike, sigma: float | None = None) -> Array:
    """Compute AIC: n ln(RSS/n) + 2(r+1); RSS/σ² + 2r with σ known. Akaike 1974."""
    parameters = np.asarray(rank) + (sigma is None)
    return np.asarray(_deviance(np.asarray(rss), n, sigma) + 2 * parameters)


def aicc(rss: ArrayLike, n: int, rank: ArrayLike, sigma: float | None = None) -> Array:
    """Compute AICc: AIC + 2K(K+1)/(n−K−1), K = r+1. Hurvich & Tsai 1989.

    Infinite ("saturated") where the rank leaves no room; equal to AIC with σ known."""
    K = np.asarray(rank) + 1
    room = n - K - 1.0
    extra = np.where(room > 0, 2 * K * (K + 1) / np.where(room > 0, room, 1), np.inf)
    plain = aic(rss, n, rank, sigma)
    return np.asarray(plain + extra) if sigma is None else plain


def bic(
    rss: ArrayLike, n: int, rank: ArrayLike, sigma: float | None = None, count: int | None = None
) -> Array:
    """Compute BIC: n ln(RSS/n) + (r+1) ln count; RSS/σ² + r ln count with σ known. Schwarz 1978.

    `count`: independent units (configurations, where coordinates correlate); default n."""
    parameters = np.asarray(rank) + (sigma is None)
    return np.asarray(_deviance(np.asarray(rss), n, sigma) + parameters * np.log(count or n))


def gcv(rss: ArrayLike, n: int, rank: ArrayLike) -> Array:
    """Compute GCV: n RSS/(n−r)²; infinite where saturated. Golub, Heath & Wahba 1979."""
    room = n - np.asarray(rank, float)
    value = n * np.asarray(rss) / np.where(room > 0, room, 1) ** 2
    return np.where(room > 0, value, np.inf)


def ebic(
    rss: ArrayLike,
    n: int,
    rank: ArrayLike,
    chosen: ArrayLike,
    groups: int,
    gamma: float = 1.0,
    sigma: float | None = None,
) -> Array:
    """Compute EBIC: BIC + 2γ ln C(groups, chosen). Chen & Chen 2008."""
    return np.asarray(bic(rss, n, rank, sigma) + gamma * scan_price(chosen, groups))


def scan_price(chosen: ArrayLike, groups: int) -> Array:
    """Compute 2 ln C(groups, chosen), the price of EBIC beyond BIC for choosing among the groups."""
    from scipy.special import gammaln

    s = np.asarray(chosen)
    log_count = gammaln(groups + 1) - gammaln(s + 1) - gammaln(groups - s + 1)
    return np.asarray(2 * log_count)


def log_evidence(
    rss: ArrayLike,
    rss_base: float,
    n: int,
    rank_base: int,
    extra: ArrayLike,
    sigma: float | None = None,
) -> Array:
    """Compute the ln Bayes factor against the base, with a unit-information g-prior (g = n) on the
    extra columns; σ integrated out, or known. Zellner 1986; Liang et al. 2008."""
    p = np.asarray(extra)
    if sigma is not None:
        explained = n / (1 + n) * (rss_base - np.asarray(rss)) / (2 * sigma**2)
        return np.asarray(explained - p / 2 * np.log1p(n))
    unexplained = np.asarray(rss) / rss_base
    freedom = n - rank_base
    price = (freedom - p) / 2 * np.log1p(n)
    return np.asarray(price - freedom / 2 * np.log1p(n * unexplained))


def normalise_weights(criterion: ArrayLike) -> Array:
    """Compute exp(−Δ/2), normalised: Akaike weights, or posterior weights from BIC.

    Infinite values get no weight; where none is finite, all weights are alike."""
    from scipy.special import softmax

    values = np.asarray(criterion, float)
    finite = np.isfinite(values)
    if not finite.any():
        return np.full(len(values), 1 / max(len(values), 1))
    weights = np.zeros(len(values))
    weights[finite] = softmax(-values[finite] / 2)
    return weights
