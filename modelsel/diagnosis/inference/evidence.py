"""Evidence: Bayes factors of the candidates, their null distribution, and family-wise p-values.

Bayes factor. Candidate g with k orthonormal directions Z_g beyond the model explains the share
s = |Z_gᵀr|² / |r|² of the residual r, which has ν degrees of freedom. With a normal prior of
variance v on its terms (in units where a direction has unit length), noise variance σ² integrated
out under the Jeffreys prior, and ratio ρ = v / σ²,

    log BF = -k/2 log(1 + ρ) - ν/2 log(1 - s ρ / (1 + ρ))

(a fixed ratio gives Zellner's g-prior: Liang, Paulo, Molina, Clyde & Berger 2008, eq. 6). The
evidence of a scan is max over ρ in RATIOS of log Σ_g π_g BF_g(ρ), π_g the priors.

Null distribution. If nothing is left to find and the noise is normal, r / |r| is uniform on the unit
sphere of the model's residual space, whatever the parameters and the noise level: drawing from it
gives an exact Monte Carlo test (Dufour 2006). The p-value of an evidence is (1 + number of draws at
least as large) / (1 + number of draws).

Family-wise p-values. A candidate of k directions explains the share s or more by chance with
probability P(Beta(k/2, (ν - k)/2) >= s); its family-wise p-value is the share of null draws whose
smallest such probability, over all candidates, is as small (Westfall & Young 1993, min-p)."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._linalg import TINY
from ..._typing import Array, Index
from ..columns.row_blocks import split_range
from .scan import Beyond, Response, Scan, Strength

# ratios ρ = v / σ² over which the evidence is maximised
RATIOS = np.logspace(0.5, 5.0, 8)
# log odds from which one explanation is clearly more probable than another
MIN_LOG_ODDS = np.log(3)
# log evidence by which a bound may be off: far beyond single precision's rounding
BOUND_SLACK = 1e-3
# null draws computed together, a product of full speed in memory that is used again, and numbers
# that one group of pieces may hold
PIECE = 256
MAX_DRAWN_NUMBERS = 4e6
# share of the draws beyond which all are computed: selecting some has a cost too
MAX_SELECTED_SHARE = 0.7

# largest share (B,) among the candidates of each size
LargestShares = Mapping[float, Array]


def normalise_strength(strength: Strength, total: Array) -> Strength:
    """Scale a strength to responses of unit length.

    `total` (B,): the responses' sums of squares; nothing is explained of one of zero. Overwrites
    `strength.whole`."""
    total = np.maximum(total, np.finfo(total.dtype).tiny)
    whole = np.divide(strength.whole, total, out=strength.whole)
    np.minimum(whole, 1 - np.finfo(whole.dtype).eps, out=whole)
    return Strength(whole, strength.root / np.sqrt(total), strength.smooth / total)


def _compute_prices(seen: Beyond, ratios: Array) -> tuple[Array, Array]:
    """Compute what every candidate's freedom costs at each of some ratios (R,).

    Returns the price (G, R) in log evidence, and the weight (F, R, K) with which every direction of
    a free function counts."""
    which, weights = seen.smooth
    price = 0.5 * np.log1p(ratios) * seen.sizes[:, None]
    scaled = ratios[:, None] * weights[:, None]
    price[which] = 0.5 * np.log1p(scaled).sum(2)
    return price, scaled / (1 + scaled)


def _compute_smooth_share(share: Strength, weights: Array) -> Array:
    """Compute (F, R, B) the shares that free functions explain, by the weights (F, R, K)."""
    kind = share.smooth.dtype
    total = np.matmul(weights.astype(kind), share.smooth)
    return np.asarray(np.minimum(total, 1 - np.finfo(kind).eps))


def compute_log_bayes_factors(seen: Beyond, share: Strength, ratios: float | Array) -> Array:
    """Compute (G, B) log Bayes factors of every candidate at a ratio ρ against no effect; of one
    response those (G, R) at each of some ratios (R,).

    `share` comes from `normalise_strength`.

    A free function's directions have variances of their own, v times their weight. Terms with a
    sign have half of their prior: see `_compute_log_sign_factors`."""
    kind, ratios = share.whole.dtype.type, np.atleast_1d(ratios)
    shrink = (ratios / (1 + ratios)).astype(kind)
    price, weights = _compute_prices(seen, ratios)
    out = share.whole * -shrink
    if len(weights):
        smooth = _compute_smooth_share(share, weights)
        out[seen.smooth[0]] = -smooth.reshape(len(smooth), -1)
    np.log1p(out, out=out)
    out *= kind(-0.5 * seen.freedom)
    out -= np.where(seen.sizes[:, None] > 0, price, np.inf).astype(kind)
    if len(seen.signed):
        out[seen.signed] += _compute_log_sign_factors(seen, share, shrink)
    return out


def _compute_log_sign_factors(seen: Beyond, share: Strength, shrink: Array) -> Array:
    """Compute (S, B) or (S, R) what a sign adds to the log Bayes factors of candidates with a signed term.

    The prior has its half of that sign only, where it is twice as dense, and the data leave the
    tail of the posterior there, a Student t of as many degrees of freedom ν as the residual:
    BF = BF of either sign · 2 P(t_ν < z). With t² = ν (exp(2 log BF / ν) - 1) before its price,
    Wallace's normal z = (8ν+1)/(8ν+3) √(ν log(1 + t²/ν)) (1959) stays finite however strong the
    evidence. Of several signed terms it is the one that is least of its sign; exact for one
    term."""
    from scipy.special import log_ndtr

    kind, freedom = share.whole.dtype.type, seen.freedom
    whole = np.maximum(share.whole[seen.signed], np.finfo(kind).tiny)
    wallace = (8 * freedom + 1) / (8 * freedom + 3)
    normal = np.sqrt(-freedom * np.log1p(-shrink * whole) / whole) * wallace
    return np.asarray(kind(np.log(2)) + log_ndtr((normal * share.root).astype(kind)))


def compute_factors(seen: Beyond, response: Response) -> Array:
    """Compute (ratios, G) log Bayes factors of every candidate alone for a response.

    They are -inf for a candidate that would have to be large to explain it."""
    strength, is_small = seen.judge(response)
    share = normalise_strength(strength, np.array([response.square]))
    factors = compute_log_bayes_factors(seen, share, RATIOS)
    return np.where(is_small, factors.T, -np.inf)


def sum_evidence(factors: Array, log_prior: Array) -> tuple[float, Array]:
    """Sum up the evidence from `compute_factors` over the candidates.

    Returns log Σ prior · BF at the ratio that maximises it, and log prior + log BF (G,) there."""
    joint = factors + log_prior
    top = joint.max(1)
    if not np.isfinite(top).all():
        return -np.inf, np.full(len(log_prior), -np.inf)
    values = top + np.log(np.exp(joint - top[:, None]).sum(1))
    best = int(np.argmax(values))
    return float(values[best]), joint[best]


class Chance:
    """What chance responses (B,) show: the evidence for anything in each, and the smallest p-value.

    No candidate's Bayes factor grows with the ratio by more than that of the largest share of its
    size, so neither does the sum: where that cannot exceed the best so far, a ratio is not
    computed. Nor does the sum exceed the largest Bayes factor, which is cheap to bound.

    `products` (C, B): those of the columns with the responses off the model, whose sums of squares
    are `total` (B,); all is in their precision."""

    def __init__(self, seen: Beyond, log_prior: Array, products: NDArray[Any], total: NDArray[Any]):
        self.seen = seen
        self.share = normalise_strength(seen.strength(products), total)
        self.prior = log_prior.astype(products.dtype)[:, None]
        self.largest = find_largest_shares(seen, self.share)
        draws = self.share.whole.shape[1]
        by_size = np.array(list(self.largest.values())).reshape(len(self.largest), draws)
        self.bounding = np.concatenate([by_size, self.share.whole[seen.signed]])
        slack = np.full((len(self.bounding) + len(self.share.smooth), 1), BOUND_SLACK)
        # the tail of a sign may grow by a factor of two
        slack[len(by_size) : len(self.bounding)] += np.log(2)
        self.slack = slack

    @cached_property
    def bounds(self) -> Array:
        """Log Bayes factors (K, ratios, B) that bound those of every size, sign and free function."""
        price, weights = _compute_prices(self.seen, RATIOS)
        sizes = np.array(list(self.largest))
        by_size = 0.5 * sizes[:, None] * np.log1p(RATIOS)
        costs = np.concatenate([by_size, price[self.seen.signed], price[self.seen.smooth[0]]])
        shrink = (RATIOS / (1 + RATIOS)).astype(self.bounding.dtype)
        smooth = _compute_smooth_share(self.share, weights)
        explained = np.concatenate([self.bounding[:, None] * shrink[:, None], smooth])
        growth = -0.5 * self.seen.freedom * np.log1p(-explained)
        return np.asarray(growth - costs[:, :, None])

    @cached_property
    def first(self) -> Array:
        """The evidence (B,) at the first ratio: it is no less at the best one."""
        if not self.largest:
            return np.full(self.share.whole.shape[1], -np.inf)
        return self._compute(float(RATIOS[0]))

    @cached_property
    def growth(self) -> Array:
        """How much more (ratios - 1, B) the evidence may be at the other ratios."""
        if not self.largest:
            return np.zeros((1, len(self.first)))
        start = self.slack[:, None] - self.bounds[:, :1]
        return np.asarray((self.bounds[:, 1:] + start).max(0))

    @cached_property
    def evidence(self) -> Array:
        """The evidence (B,): -inf where no candidate is left."""
        if not self.largest:
            return self.first
        best = self.first.copy()
        for ratio, growth in zip(map(float, RATIOS[1:]), self.growth, strict=False):
            needed = np.flatnonzero(growth > best - self.first)
            if not len(needed):
                continue
            if len(needed) > MAX_SELECTED_SHARE * len(best):
                best = np.maximum(best, self._compute(ratio))
            else:
                best[needed] = np.maximum(best[needed], self.take(needed)._compute(ratio))
        return best

    @cached_property
    def most(self) -> Array:
        """What the evidence (B,) cannot exceed."""
        if not self.largest:
            return self.evidence
        return np.asarray((self.bounds + self.slack[:, None]).max((0, 1)))

    @property
    def smallest_p(self) -> Array:
        """The smallest p-values (B,) of single candidates: 1 where no candidate is left."""
        least = compute_smallest_p(self.largest, self.seen.freedom)
        return np.asarray(np.broadcast_to(least, self.share.whole.shape[1:]))

    def below(self, evidence: float) -> Array:
        """The evidence (B,), or its bound for responses where that stays below a given one.

        The bound that needs no candidate's Bayes factor is tried first, then that of the first
        ratio and what it may grow by."""
        out = self.most.copy()
        for tighter in ("ceiling", "evidence"):
            which = np.flatnonzero(out >= evidence)
            if len(which) > MAX_SELECTED_SHARE * len(out):
                out = getattr(self, tighter).copy()
            elif len(which):
                out[which] = getattr(self.take(which), tighter)
        return out

    def stays_below(self, evidence: float) -> bool:
        """Whether the evidence of every response is below a given one."""
        if self.most.max() < evidence:
            return True
        if self.first.max() >= evidence:
            return False
        return bool(self.ceiling.max() < evidence or self.evidence.max() < evidence)

    @property
    def ceiling(self) -> Array:
        """What the evidence (B,) cannot exceed, given that at the first ratio."""
        return np.asarray(self.first + np.maximum(self.growth.max(0), 0))

    def take(self, which: Index | slice) -> Chance:
        """Return the same of some responses."""
        part = Chance.__new__(Chance)
        part.seen, part.prior, part.slack = self.seen, self.prior, self.slack
        part.share = Strength(*(values[..., which] for values in self.share))
        part.largest = {size: values[which] for size, values in self.largest.items()}
        part.bounding = self.bounding[:, which]
        known = self.__dict__.keys() & {"first", "growth", "bounds"}
        part.__dict__.update({name: getattr(self, name)[..., which] for name in known})
        return part

    def _compute(self, ratio: float) -> Array:
        """Compute the log evidence (B,) at a ratio."""
        joint = compute_log_bayes_factors(self.seen, self.share, ratio)
        joint += self.prior
        top = joint.max(0)
        joint -= top
        return np.asarray(top + np.log(np.exp(joint, out=joint).sum(0)), float)


def draw_null(
    seen: Scan, log_prior: Array, draws: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Draw the null distribution of the evidence and of the smallest p-value.

    Returns sorted evidences (draws,), and sorted smallest p-values (draws,) of single candidates.

    Products are in single precision, which is ample where nothing stands out: a share is then off
    by some 1e-5 of itself."""
    if not seen.by_size:
        return np.full(draws, np.nan), np.ones(draws)
    rows = seen.columns.rows
    evidences, smallest = [], []
    for drawn in split_range(draws, int(MAX_DRAWN_NUMBERS / max(seen.columns.groups, rows))):
        noise = rng.standard_normal((rows, drawn.stop - drawn.start))
        noise -= seen.Q @ (seen.Q.T @ noise)
        residual = noise.astype(np.float32)
        del noise  # as large as a memory limit allows
        for piece in split_range(residual.shape[1], PIECE):
            part = np.ascontiguousarray(residual[:, piece])
            chance = Chance(seen, log_prior, seen.columns.dot(part), np.square(part).sum(0))
            evidences.append(chance.evidence)
            smallest.append(chance.smallest_p)
    return np.sort(np.concatenate(evidences)), np.sort(np.concatenate(smallest))


def find_largest_shares(seen: Beyond, share: Strength) -> LargestShares:
    """Find the largest share (B,) among the candidates of every size, of at least one direction."""
    return {size: share.whole[which].max(0) for size, which in seen.by_size.items()}


def compute_smallest_p(largest: LargestShares, freedom: int) -> Array:
    """Compute (B,) smallest p-values of single candidates, from the largest shares of each size.

    They are 1 where there are no candidates."""
    if not largest:
        return np.ones(1)
    by_size = []
    for size, share in largest.items():
        tail = _compute_tail(share, size, freedom)
        by_size.append(tail)
    smallest = np.min(by_size, axis=0)
    return np.asarray(smallest)


def _compute_tail(share: Array, size: Array | float, freedom: int) -> Array:
    """Compute how often a candidate of k = `size` directions explains a share by chance.

    That is P(Beta(k/2, (ν - k)/2) >= share), ν the `freedom`."""
    from scipy.special import betainc

    own = np.maximum(size, 1e-9)
    left = np.maximum(freedom - size, 1e-9)
    unexplained = 1 - np.minimum(share, 1.0)
    tail = betainc(left / 2, own / 2, unexplained)
    return np.asarray(tail)


def compute_familywise_p(seen: Beyond, response: Response, smallest: Array) -> Array:
    """Compute (G,) family-wise p-values of every candidate alone.

    `smallest`: the sorted smallest p-values of the null."""
    share = seen.strength(response.column).whole[:, 0] / max(response.square, TINY)
    single = np.where(seen.sizes > 0, _compute_tail(share, seen.sizes, seen.freedom), 1.0)
    as_small = np.searchsorted(smallest, single, side="right")
    return np.asarray((1 + as_small) / (len(smallest) + 1))


def compute_single_f(seen: Beyond, response: Response) -> Array:
    """Compute (G,) the F statistic of every candidate alone beyond the model.

    It is 0 for one that adds nothing, and finite where one explains all."""
    strength = seen.strength(response.column).whole[:, 0]
    total, size = response.square, seen.sizes
    rest = np.maximum(total - strength, max(np.finfo(float).eps * total, TINY))
    left = np.maximum(seen.freedom - size, 1)
    f = strength / np.maximum(size, 1) / rest * left
    return np.where((size > 0) & (seen.freedom > size), f, 0.0)


def compute_p_value(observed: float, sorted_null: Array) -> float:
    """Compute (1 + #{null >= observed}) / (B + 1); 1 where there is no evidence at all."""
    if not np.isfinite(observed):
        return 1.0
    draws = len(sorted_null)
    smaller = np.searchsorted(sorted_null, observed, side="left")
    as_large = draws - smaller
    p = (1 + as_large) / (draws + 1)
    return float(p)
