"""Information criteria and evidence, as functions of the residual sum of squares `rss`, the number
of rows `n` and the rank `r` (methods.md A.3, A.5); `sigma` where the noise is known."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .._linalg import TINY
from .._typing import Array


def _deviance(rss: Array, n: int, sigma: float | None) -> Array:
    if sigma is None:
        # finite for a model that leaves nothing
        mean_square = np.maximum(rss / n, TINY)
        deviance = n * np.log(mean_square)
    else:
        deviance = rss / sigma**2
    return np.asarray(deviance)


def aic(rss: ArrayLike, n: int, rank: ArrayLike, sigma: float | None = None) -> Array:
    """Compute AIC: n ln(RSS/n) + 2(r+1); RSS/σ² + 2r with σ known. Akaike 1974."""
    rss = np.asarray(rss)
    rank = np.asarray(rank)
    estimated_scale = sigma is None
    parameters = rank + estimated_scale
    deviance = _deviance(rss, n, sigma)
    penalty = 2 * parameters
    return np.asarray(deviance + penalty)


def aicc(rss: ArrayLike, n: int, rank: ArrayLike, sigma: float | None = None) -> Array:
    """Compute AICc: AIC + 2K(K+1)/(n−K−1), K = r+1. Hurvich & Tsai 1989.

    Infinite ("saturated") where the rank leaves no room; equal to AIC with σ known."""
    plain = aic(rss, n, rank, sigma)
    if sigma is not None:
        return plain
    rank = np.asarray(rank)
    K = rank + 1
    room = n - K - 1.0
    unsaturated = room > 0
    room = np.where(unsaturated, room, 1)
    doubled = 2 * K
    numerator = doubled * (K + 1)
    correction = numerator / room
    extra = np.where(unsaturated, correction, np.inf)
    corrected = plain + extra
    return np.asarray(corrected)


def bic(
    rss: ArrayLike, n: int, rank: ArrayLike, sigma: float | None = None, count: int | None = None
) -> Array:
    """Compute BIC: n ln(RSS/n) + (r+1) ln count; RSS/σ² + r ln count with σ known. Schwarz 1978.

    `count`: independent units (configurations, where coordinates correlate); default n."""
    rss = np.asarray(rss)
    rank = np.asarray(rank)
    estimated_scale = sigma is None
    parameters = rank + estimated_scale
    deviance = _deviance(rss, n, sigma)
    units = count or n
    price = np.log(units)
    penalty = parameters * price
    value = deviance + penalty
    return np.asarray(value)


def gcv(rss: ArrayLike, n: int, rank: ArrayLike) -> Array:
    """Compute GCV: n RSS/(n−r)²; infinite where saturated. Golub, Heath & Wahba 1979."""
    rss = np.asarray(rss)
    rank = np.asarray(rank, float)
    room = n - rank
    unsaturated = room > 0
    divisor = np.where(unsaturated, room, 1)
    divisor = divisor**2
    value = n * rss / divisor
    return np.where(unsaturated, value, np.inf)


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
    criterion = bic(rss, n, rank, sigma)
    price = scan_price(chosen, groups)
    penalty = gamma * price
    penalised = criterion + penalty
    return np.asarray(penalised)


def scan_price(chosen: ArrayLike, groups: int) -> Array:
    """Compute 2 ln C(groups, chosen), the price of EBIC beyond BIC for choosing among the groups."""
    from scipy.special import gammaln

    chosen = np.asarray(chosen)
    left = groups - chosen
    log_count = gammaln(groups + 1)
    log_count = log_count - gammaln(chosen + 1)
    log_count = log_count - gammaln(left + 1)
    price = 2 * log_count
    return np.asarray(price)


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
    rss = np.asarray(rss)
    growth = np.log1p(n)
    if sigma is not None:
        gain = rss_base - rss
        shrinkage = n / (1 + n)
        double_variance = 2 * sigma**2
        explained = shrinkage * gain
        explained = explained / double_variance
        price = p / 2 * growth
        evidence = explained - price
        return np.asarray(evidence)
    # 1 where both leave nothing
    unexplained = (rss + TINY) / (rss_base + TINY)
    freedom = n - rank_base
    room = freedom - p
    price = room / 2 * growth
    half_freedom = freedom / 2
    misfit = n * unexplained
    misfit = np.log1p(misfit)
    evidence = price - half_freedom * misfit
    return np.asarray(evidence)


def normalise_weights(criterion: ArrayLike) -> Array:
    """Compute exp(−Δ/2), normalised: Akaike weights, or posterior weights from BIC.

    Infinite values get no weight; where none is finite, all weights are alike."""
    from scipy.special import softmax

    values = np.asarray(criterion, float)
    count = len(values)
    finite = np.isfinite(values)
    if not finite.any():
        equal = 1 / max(count, 1)
        return np.full(count, equal)
    weights = np.zeros(count)
    scores = -values[finite] / 2
    weights[finite] = softmax(scores)
    return weights
