"""Whether chains agree and how much they tell: split R-hat on ranks, integrated autocorrelation times.

A chain is (steps, walkers, d). Referee: arviz-stats (tests/test_sampling.py).
"""
from __future__ import annotations

import numpy as np

from .._typing import Array


def autocorrelation_time(chain: Array) -> Array:
    """(d,) integrated autocorrelation times in steps of the chain (window 5; Sokal 1997), infinite where it does not move.

    The walkers' autocovariances about the mean of them all are averaged before they are summed. emcee takes each walker's own
    mean and variance: fifty times long, such walkers look a quarter less correlated than they are."""
    n = len(chain)
    width = 1 << (2 * n - 1).bit_length()
    out = np.empty(chain.shape[2])
    for j in range(chain.shape[2]):
        power = np.square(np.abs(np.fft.rfft(chain[:, :, j] - chain[:, :, j].mean(), width, axis=0))).sum(1)
        covariance = np.fft.irfft(power, width)[:n]
        if covariance[0] <= 1e-300:
            out[j] = np.inf
            continue
        times = 2 * np.cumsum(covariance / covariance[0]) - 1
        window = np.arange(n) >= 5 * times
        out[j] = times[int(np.argmax(window)) if window.any() else n - 1]
    return out


def r_hat(chain: Array) -> Array:
    """(d,) rank-normalised split R-hat, the larger of bulk and folded (Vehtari, Gelman, Simpson, Carpenter & Bürkner 2021);
    the walkers' halves are the chains."""
    half = len(chain) // 2
    split = np.concatenate([chain[:half], chain[-half:]], axis=1)
    folded = np.abs(split - np.median(split, axis=(0, 1)))
    return np.asarray(np.maximum(_plain(_normal_scores(split)), _plain(_normal_scores(folded))))


def _normal_scores(chain: Array) -> Array:
    """Every draw replaced by the normal quantile of its rank among all (Blom 1958); ties share their mean rank."""
    from scipy.special import ndtri
    flat = chain.reshape(-1, chain.shape[2])
    out = np.empty_like(flat)
    for j, values in enumerate(flat.T):
        _, inverse, count = np.unique(values, return_inverse=True, return_counts=True)
        rank = np.cumsum(count) - (count - 1) / 2
        out[:, j] = ndtri((rank[inverse] - 0.375) / (len(flat) + 0.25))
    return out.reshape(chain.shape)


def _plain(chain: Array) -> Array:
    """Square root of the pooled variance over the mean variance within chains."""
    n = len(chain)
    within = chain.var(0, ddof=1).mean(0)
    between = n * chain.mean(0).var(0, ddof=1)
    return np.asarray(np.sqrt((between / within + n - 1) / n))
