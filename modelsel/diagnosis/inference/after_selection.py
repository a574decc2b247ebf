"""How large an effect is, allowing for the search that has found it.

Of effects near the detection limit only those are found that errors happen to enlarge: their
estimates are too large on average, and plain intervals hold the truth too rarely. Given the others,
the explained sum of squares of an effect of k terms, in units of the noise, is noncentral
chi-square, and it was found because that exceeded what the search asks. The distribution beyond this
limit bounds the effect (conditional likelihood: Zöllner & Pritchard 2007, Am. J. Hum. Genet. 80:605;
Zhong & Prentice 2008, Biostatistics 9:621)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..._linalg import TINY
from ..._typing import Array
from .evidence import RATIOS

# shares of what is found that are smaller, at the median and at the ends of the interval
SMALLER = (0.5, 0.975, 0.025)
NORMAL = 1.959964
# explained sum of squares from which no search enlarges an effect
PLAIN = 2000.0
# factor above which an effect is about as large as it is estimated
LARGE_SHARE = 0.9
# share of an effect by which its interval reaches further down
WIDER = 0.1


class AfterSelection(NamedTuple):
    """What an estimate is to be multiplied by: the median, and the ends of the 95 % interval."""

    factor: float
    low: float
    high: float

    def differs(self, estimate: Array, standard_error: Array) -> bool:
        """Whether the search makes an effect of some terms (k,) smaller, or its interval reach further
        down."""
        is_known = standard_error > 0
        sizes = estimate[is_known] / standard_error[is_known]
        strength = max(float(np.linalg.norm(sizes)), NORMAL)
        plain_low = 1 - NORMAL / strength
        return self.factor < LARGE_SHARE or self.low < plain_low - WIDER


def allow_for_search(square: float, limit: float, terms: int) -> AfterSelection:
    """Allow for the search in the size of an effect of some `terms`.

    `square`: the sum of squares that it explains, over the variance of the noise; `limit`: what it
    had to exceed."""
    if square > PLAIN:
        half = float(NORMAL / np.sqrt(square))
        return AfterSelection(1.0, 1 - half, 1 + half)
    # of smaller numbers older versions of chndtr make NaN
    limit = min(max(limit, TINY), square)
    middle, low, high = (
        np.sqrt(_find_noncentrality(square, limit, terms, level) / square) for level in SMALLER
    )
    return AfterSelection(float(middle), float(low), float(high))


def _find_noncentrality(square: float, limit: float, terms: int, level: float) -> float:
    """Find the noncentrality at which a share `level` of what is found is smaller than `square`."""
    from scipy.optimize import brentq

    def exceed(noncentrality: float) -> float:
        return _compute_share(square, limit, terms, noncentrality) - level

    if exceed(0.0) <= 0:
        return 0.0
    largest = square + 10 * np.sqrt(square) + 10
    return float(brentq(exceed, 0.0, largest, xtol=1e-6 * largest))


def _compute_share(square: float, limit: float, terms: int, noncentrality: float) -> float:
    """Compute the share of effects found beyond the limit that explain less than `square`."""
    from scipy.special import chndtr

    below, beyond = chndtr([limit, square], terms, noncentrality)
    found = 1 - below
    smaller = beyond - below
    if found <= 0:
        return 0.0
    return float(smaller / found)


def find_limit(square: float, terms: int, freedom: int, excess: float) -> float:
    """Find the explained sum of squares at which the log evidence would be lower by `excess`.

    `freedom`: of what is left beside the effect."""
    from scipy.optimize import brentq

    wanted = _compute_evidence(square, terms, freedom) - excess
    if excess <= 0:
        return square
    if _compute_evidence(0.0, terms, freedom) >= wanted:
        return 0.0
    return float(brentq(lambda at: _compute_evidence(at, terms, freedom) - wanted, 0.0, square))


def _compute_evidence(square: float, terms: int, freedom: int) -> float:
    """Compute the log Bayes factor of an effect at its best ratio ρ, as the scan does."""
    share = square / (square + freedom)
    shrunk = 1 - RATIOS / (1 + RATIOS) * share
    values = -0.5 * terms * np.log1p(RATIOS) - 0.5 * (freedom + terms) * np.log(shrunk)
    return float(values.max())
