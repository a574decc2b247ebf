"""Moves of the ensemble sampler, and diagnostics of its chains: split R-hat on ranks, integrated
autocorrelation times.

A chain is (steps, walkers, d). Both diagnostics are the package's own, checked against arviz-stats
(tests/uncertainty/test_sampling.py): emcee's autocorrelation time underestimates on short chains, and arviz
would be a dependency for one formula."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .._linalg import TINY
from .._typing import Array, Mask

# step of the snooker; ter Braak & Vrugt 2008: 1.2 to 2.2
GAMMA = 1.7
# spread of an independent proposal, as a multiple of that of the walkers it is drawn about
WIDER = 1.1
# the window of an autocorrelation time is this many times as long (Sokal 1997)
WINDOW = 5


def autocorrelation_time(chain: Array) -> Array:
    """Compute integrated autocorrelation times (d,) in steps of the chain (Sokal 1997); infinite
    where it does not move.

    The walkers' autocovariances about the mean of them all are averaged before they are summed.
    emcee takes each walker's own mean and variance: in a chain of fifty times, such walkers look a
    quarter less correlated than they are."""
    steps, _, names = chain.shape
    step = np.arange(steps)
    times = np.empty(names)
    for j in range(names):
        series = chain[:, :, j]
        covariance = _autocovariance(series)
        variance = covariance[0]
        if variance <= TINY:
            times[j] = np.inf
            continue
        correlation = covariance / variance
        cumulated = 2 * np.cumsum(correlation) - 1
        beyond = step >= WINDOW * cumulated
        window = steps - 1
        if beyond.any():
            window = int(np.argmax(beyond))
        times[j] = cumulated[window]
    return times


def _autocovariance(series: Array) -> Array:
    """Compute the autocovariance (n,) of series (n, walkers) about their common mean, up to a
    factor, by the power spectrum of the zero-padded series."""
    n = len(series)
    longest = 2 * n - 1
    bits = longest.bit_length()
    width = 1 << bits
    mean = series.mean()
    departure = series - mean
    spectrum = np.fft.rfft(departure, width, axis=0)
    amplitude = np.abs(spectrum)
    power = np.square(amplitude)
    power = power.sum(1)
    covariance = np.fft.irfft(power, width)
    covariance = covariance[:n]
    return np.asarray(covariance)


def r_hat(chain: Array) -> Array:
    """Compute rank-normalised split R-hat (d,), the larger of bulk and folded (Vehtari, Gelman,
    Simpson, Carpenter & Bürkner 2021); the walkers' halves are the chains."""
    # the walkers' halves
    half = len(chain) // 2
    first = chain[:half]
    second = chain[-half:]
    split = np.concatenate([first, second], axis=1)
    median = np.median(split, axis=(0, 1))
    departure = split - median
    folded = np.abs(departure)
    bulk_scores = _normal_scores(split)
    tail_scores = _normal_scores(folded)
    bulk = _plain_r_hat(bulk_scores)
    tail = _plain_r_hat(tail_scores)
    # bulk shows different places, tail different spreads
    larger = np.maximum(bulk, tail)
    return np.asarray(larger)


def _normal_scores(chain: Array) -> Array:
    """Replace every draw by the normal quantile of its rank among all (Blom 1958); ties share their
    mean rank."""
    from scipy.special import ndtri

    names = chain.shape[2]
    flat = chain.reshape(-1, names)
    count_plus = len(flat) + 0.25
    scores = np.empty_like(flat)
    for j, values in enumerate(flat.T):
        _, inverse, count = np.unique(values, return_inverse=True, return_counts=True)
        last = np.cumsum(count)
        rank = last - (count - 1) / 2
        numerator = rank[inverse] - 0.375
        probability = numerator / count_plus
        scores[:, j] = ndtri(probability)
    return scores.reshape(chain.shape)


def _plain_r_hat(chain: Array) -> Array:
    """Compute the square root (d,) of the pooled variance over the mean variance within chains."""
    n = len(chain)
    variance = chain.var(0, ddof=1)
    within = variance.mean(0)
    mean = chain.mean(0)
    of_means = mean.var(0, ddof=1)
    between = n * of_means
    ratio = between / within
    pooled = ratio + n - 1
    value = np.sqrt(pooled / n)
    return np.asarray(value)


def build_moves(ranges: Sequence[tuple[int, float, float]] = ()) -> list[tuple[Any, float]]:
    """Build emcee's moves with their weights: differential evolution 0.4, snooker 0.1, and 0.5 that
    draw a walker anew, near a normal distribution of independent coordinates (`propose_independent`).

    ranges: (position, lowest, highest) of every inner constant, which that leaves as they are; where
    there are any, a third of all moves instead draws one of them anew over its range: far modes are
    reached in one step.

    The DESnookerMove of emcee 3.1.6 weighs a proposal by half of (d − 1) ln |x*−z|/|x−z| and steps
    by √|x−z| too far (github.com/dfm/emcee/pull/531): its intervals are some 8 % narrow in eleven
    dimensions (benchmarks/calibration.py). The one used here is corrected."""
    import emcee

    class HalfMove(emcee.moves.RedBlueMove):  # type: ignore[misc]
        """emcee's move of one half of the walkers and then of the other, all of a half at once: its own
        goes through them one by one, which takes a quarter of the sampling."""

        def propose(self, model: Any, state: Any) -> tuple[Any, Mask]:
            return move_halves(self, model, state)

    class Differential(HalfMove, emcee.moves.DEMove):  # type: ignore[misc]
        """Differential evolution."""

    class Snooker(HalfMove):
        """Snooker update of all walkers at once (`propose_snooker`)."""

        def get_proposal(
            self, sample: Array, complement: list[Array], random: Any
        ) -> tuple[Array, Array]:
            others = np.concatenate(complement)
            pick = np.argsort(random.rand(len(sample), len(others)), axis=1)[:, :3]
            z, first, second = others[pick].transpose(1, 0, 2)
            return propose_snooker(sample, z, first - second)

    class Independent(HalfMove):
        """All but the constants of each walker drawn anew (`propose_independent`)."""

        def get_proposal(
            self, sample: Array, complement: list[Array], random: Any
        ) -> tuple[Array, Array]:
            others = np.concatenate(complement)
            held = [position for position, _, _ in ranges]
            drawn = random.standard_normal(sample.shape)
            return propose_independent(sample, others, drawn, held)

    class Redraw(HalfMove):
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

    moves: list[tuple[Any, float]] = [(Differential(), 0.4), (Snooker(), 0.1), (Independent(), 0.5)]
    if ranges:
        moves.append((Redraw(), 0.5))
    return moves


def move_halves(move: Any, model: Any, state: Any) -> tuple[Any, Mask]:
    """Move one half of the walkers, drawn at random, by where the other half stands; then the other.

    move, model, state: emcee's; the random numbers are those that it would draw. Returns the state,
    changed in place, and which of the walkers (W,) accepted their proposals."""
    walkers = len(state.coords)
    move.setup(state.coords)
    accepted = np.zeros(walkers, bool)
    half = np.arange(walkers) % 2
    model.random.shuffle(half)
    for number in range(2):
        own = np.flatnonzero(half == number)
        others = state.coords[half != number]
        proposal, factor = move.get_proposal(state.coords[own], [others], model.random)
        density, _ = model.compute_log_prob_fn(proposal)
        threshold = np.log(model.random.rand(len(own)))
        # a walker and a proposal both outside the priors: undefined, and not accepted
        with np.errstate(invalid="ignore"):
            is_taken = factor + density - state.log_prob[own] > threshold
        taken = own[is_taken]
        state.coords[taken] = proposal[is_taken]
        state.log_prob[taken] = density[is_taken]
        accepted[taken] = True
    return state, accepted


def propose_snooker(x: Array, z: Array, difference: Array) -> tuple[Array, Array]:
    """Propose x* = x + γ · (z1 − z2) projected on the line from z to x (ter Braak & Vrugt 2008, eq.
    4).

    x, z, difference: (W, d) walkers, others, and z1 − z2. Returns the proposals (W, d) and the
    logarithm (W,) of (|x*−z|/|x−z|)^(d−1)."""
    _, d = x.shape
    # the line from z to x, and the step along it
    line = x - z
    before = np.linalg.norm(line, axis=1)
    direction = line / before[:, None]
    projection = np.einsum("wd,wd->w", direction, difference)
    length = GAMMA * projection
    length = length[:, None]
    step = length * direction
    proposal = x + step
    line = proposal - z
    after = np.linalg.norm(line, axis=1)
    ratio = after / before
    log_ratio = np.log(ratio)
    power = d - 1.0
    log_factor = power * log_ratio
    return proposal, log_factor


def propose_independent(
    x: Array, others: Array, drawn: Array, held: Sequence[int] = ()
) -> tuple[Array, Array]:
    """Propose walkers (W, d) that do not depend on x, from normal numbers `drawn` (W, d).

    They lie about the mean of the others (n, d), each coordinate by itself spread as theirs, WIDER;
    coordinates that are `held` stay as they are. Returns the proposals and the logarithm (W,) of the
    proposal's density at x over that at them (an independence chain: Tierney 1994, Ann. Stat.
    22:1701, section 2.3.3)."""
    mean = others.mean(0)
    deviation = others.std(0)
    spread = WIDER * deviation
    step = spread * drawn
    proposal = mean + step
    held = list(held)
    proposal[:, held] = x[:, held]
    from_mean = x - mean
    standard = from_mean / spread
    squares = np.square(drawn)
    squares -= np.square(standard)
    squares[:, held] = 0.0
    difference = squares.sum(1)
    log_factor = 0.5 * difference
    return proposal, log_factor
