"""Whether chains agree and how much they tell: split R-hat on ranks, integrated autocorrelation
times.

A chain is (steps, walkers, d). Referee: arviz-stats (tests/test_sampling.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .._typing import Array


def autocorrelation_time(chain: Array) -> Array:
    """(d,) integrated autocorrelation times in steps of the chain (window 5; Sokal 1997), infinite
    where it does not move.

    The walkers' autocovariances about the mean of them all are averaged before they are summed.
    emcee takes each walker's own mean and variance: fifty times long, such walkers look a quarter
    less correlated than they are."""
    n = len(chain)
    width = 1 << (2 * n - 1).bit_length()
    out = np.empty(chain.shape[2])
    for j in range(chain.shape[2]):
        power = np.square(
            np.abs(np.fft.rfft(chain[:, :, j] - chain[:, :, j].mean(), width, axis=0))
        ).sum(1)
        covariance = np.fft.irfft(power, width)[:n]
        if covariance[0] <= 1e-300:
            out[j] = np.inf
            continue
        times = 2 * np.cumsum(covariance / covariance[0]) - 1
        window = np.arange(n) >= 5 * times
        out[j] = times[int(np.argmax(window)) if window.any() else n - 1]
    return out


def r_hat(chain: Array) -> Array:
    """(d,) rank-normalised split R-hat, the larger of bulk and folded (Vehtari, Gelman, Simpson,
    Carpenter & Bürkner 2021); the walkers' halves are the chains."""
    half = len(chain) // 2
    split = np.concatenate([chain[:half], chain[-half:]], axis=1)
    folded = np.abs(split - np.median(split, axis=(0, 1)))
    return np.asarray(np.maximum(_plain(_normal_scores(split)), _plain(_normal_scores(folded))))


def _normal_scores(chain: Array) -> Array:
    """Every draw replaced by the normal quantile of its rank among all (Blom 1958); ties share
    their mean rank."""
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


# The moves of the ensemble: differential evolution from emcee, snooker, put right, and constants
# drawn afresh.

GAMMA = 1.7  # ter Braak & Vrugt 2008: 1.2 to 2.2


def build_moves(ranges: Sequence[tuple[int, float, float]] = ()) -> list[tuple[Any, float]]:
    """emcee's DEMove 0.8 and the snooker below 0.2; where there are constants, of which the
    `ranges` say (position, lowest, highest), a third of all moves instead draws one of them anew
    over its range: far modes are reached in one step.

    The DESnookerMove of emcee 3.1.6 weighs a proposal by half of (d − 1) ln |x*−z|/|x−z| and steps
    by √|x−z| too far (github.com/dfm/emcee/pull/531): its intervals are some 8 % narrow in eleven
    dimensions (benchmarks/calibration.py)."""
    import emcee

    class Snooker(emcee.moves.RedBlueMove):  # type: ignore[misc]
        """x* = x + γ · (z1 − z2) projected on the line from z to x; all walkers at once."""

        def get_proposal(
            self, sample: Array, complement: list[Array], random: Any
        ) -> tuple[Array, Array]:
            others = np.concatenate(complement)
            pick = np.argsort(random.rand(len(sample), len(others)), axis=1)[:, :3]
            z, first, second = others[pick].transpose(1, 0, 2)
            return propose_snooker(sample, z, first - second)

    class Afresh(emcee.moves.RedBlueMove):  # type: ignore[misc]
        """One constant of each walker drawn anew, evenly over its range."""

        def get_proposal(
            self, sample: Array, complement: list[Array], random: Any
        ) -> tuple[Array, Array]:
            position, low, high = (np.array(part) for part in zip(*ranges, strict=True))
            which = random.randint(len(position), size=len(sample))
            proposal = sample.copy()
            proposal[np.arange(len(sample)), position[which]] = random.uniform(
                low[which], high[which]
            )
            return proposal, np.zeros(len(sample))

    plain = [(emcee.moves.DEMove(), 0.8), (Snooker(), 0.2)]
    return [*plain, (Afresh(), 0.5)] if ranges else plain


def propose_snooker(x: Array, z: Array, difference: Array) -> tuple[Array, Array]:
    """(proposals (W, d), ln of (|x*−z|/|x−z|)^(d−1)) of walkers x along their lines to z (ter Braak
    & Vrugt 2008, eq. 4)."""
    line = x - z
    before = np.linalg.norm(line, axis=1)
    u = line / before[:, None]
    proposal = x + GAMMA * np.einsum("wd,wd->w", u, difference)[:, None] * u
    after = np.linalg.norm(proposal - z, axis=1)
    return proposal, (x.shape[1] - 1.0) * np.log(after / before)
