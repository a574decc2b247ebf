"""Moves of the ensemble sampler, and diagnostics of its chains: split R-hat on ranks, integrated
autocorrelation times.

A chain is (steps, walkers, d). Both diagnostics are the package's own, checked against arviz-stats
(tests/test_sampling.py): emcee's autocorrelation time underestimates on short chains, and arviz
would be a dependency for one formula."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .._linalg import TINY
from .._typing import Array

# step of the snooker; ter Braak & Vrugt 2008: 1.2 to 2.2
GAMMA = 1.7
# the window of an autocorrelation time is this many times as long (Sokal 1997)
WINDOW = 5


def autocorrelation_time(chain: Array) -> Array:
    """Compute integrated autocorrelation times (d,) in steps of the chain (Sokal 1997); infinite
    where it does not move.

    The walkers' autocovariances about the mean of them all are averaged before they are summed.
    emcee takes each walker's own mean and variance: in a chain of fifty times, such walkers look a
    quarter less correlated than they are."""
    times = np.empty(chain.shape[2])
    for j in range(len(times)):
        covariance = _autocovariance(chain[:, :, j])
        if covariance[0] <= TINY:
            times[j] = np.inf
            continue
        cumulated = 2 * np.cumsum(covariance / covariance[0]) - 1
        beyond = np.arange(len(chain)) >= WINDOW * cumulated
        window = int(np.argmax(beyond)) if beyond.any() else len(chain) - 1
        times[j] = cumulated[window]
    return times


def _autocovariance(series: Array) -> Array:
    """Autocovariance (n,) of series (n, walkers) about their common mean, up to a factor, by the
    power spectrum of the zero-padded series."""
    n = len(series)
    width = 1 << (2 * n - 1).bit_length()
    spectrum = np.fft.rfft(series - series.mean(), width, axis=0)
    power = np.square(np.abs(spectrum)).sum(1)
    return np.asarray(np.fft.irfft(power, width)[:n])


def r_hat(chain: Array) -> Array:
    """Compute rank-normalised split R-hat (d,), the larger of bulk and folded (Vehtari, Gelman,
    Simpson, Carpenter & Bürkner 2021); the walkers' halves are the chains."""
    half = len(chain) // 2
    split = np.concatenate([chain[:half], chain[-half:]], axis=1)
    folded = np.abs(split - np.median(split, axis=(0, 1)))
    bulk = _plain_r_hat(_normal_scores(split))
    tail = _plain_r_hat(_normal_scores(folded))
    return np.asarray(np.maximum(bulk, tail))


def _normal_scores(chain: Array) -> Array:
    """Every draw replaced by the normal quantile of its rank among all (Blom 1958); ties share
    their mean rank."""
    from scipy.special import ndtri

    flat = chain.reshape(-1, chain.shape[2])
    scores = np.empty_like(flat)
    for j, values in enumerate(flat.T):
        _, inverse, count = np.unique(values, return_inverse=True, return_counts=True)
        rank = np.cumsum(count) - (count - 1) / 2
        scores[:, j] = ndtri((rank[inverse] - 0.375) / (len(flat) + 0.25))
    return scores.reshape(chain.shape)


def _plain_r_hat(chain: Array) -> Array:
    """Square root (d,) of the pooled variance over the mean variance within chains."""
    n = len(chain)
    within = chain.var(0, ddof=1).mean(0)
    between = n * chain.mean(0).var(0, ddof=1)
    return np.asarray(np.sqrt((between / within + n - 1) / n))


def build_moves(ranges: Sequence[tuple[int, float, float]] = ()) -> list[tuple[Any, float]]:
    """Build emcee's moves with their weights: differential evolution 0.8, snooker 0.2.

    ranges: (position, lowest, highest) of every inner constant; where there are any, a third of all
    moves instead draws one of them anew over its range: far modes are reached in one step.

    The DESnookerMove of emcee 3.1.6 weighs a proposal by half of (d − 1) ln |x*−z|/|x−z| and steps
    by √|x−z| too far (github.com/dfm/emcee/pull/531): its intervals are some 8 % narrow in eleven
    dimensions (benchmarks/calibration.py). The one used here is corrected."""
    import emcee

    class Snooker(emcee.moves.RedBlueMove):  # type: ignore[misc]
        """Snooker update of all walkers at once (`propose_snooker`)."""

        def get_proposal(
            self, sample: Array, complement: list[Array], random: Any
        ) -> tuple[Array, Array]:
            others = np.concatenate(complement)
            pick = np.argsort(random.rand(len(sample), len(others)), axis=1)[:, :3]
            z, first, second = others[pick].transpose(1, 0, 2)
            return propose_snooker(sample, z, first - second)

    class Redraw(emcee.moves.RedBlueMove):  # type: ignore[misc]
        """One constant of each walker drawn anew, uniformly over its range."""

        def get_proposal(
            self, sample: Array, complement: list[Array], random: Any
        ) -> tuple[Array, Array]:
            position, low, high = (np.array(part) for part in zip(*ranges, strict=True))
            which = random.randint(len(position), size=len(sample))
            proposal = sample.copy()
            drawn = random.uniform(low[which], high[which])
            proposal[np.arange(len(sample)), position[which]] = drawn
            return proposal, np.zeros(len(sample))

    moves = [(emcee.moves.DEMove(), 0.8), (Snooker(), 0.2)]
    if ranges:
        moves.append((Redraw(), 0.5))
    return moves


def propose_snooker(x: Array, z: Array, difference: Array) -> tuple[Array, Array]:
    """Propose x* = x + γ · (z1 − z2) projected on the line from z to x (ter Braak & Vrugt 2008, eq.
    4).

    x, z, difference: (W, d) walkers, others, and z1 − z2. Returns the proposals (W, d) and the
    logarithm (W,) of (|x*−z|/|x−z|)^(d−1)."""
    line = x - z
    before = np.linalg.norm(line, axis=1)
    direction = line / before[:, None]
    length = GAMMA * np.einsum("wd,wd->w", direction, difference)
    proposal = x + length[:, None] * direction
    after = np.linalg.norm(proposal - z, axis=1)
    return proposal, (x.shape[1] - 1.0) * np.log(after / before)
