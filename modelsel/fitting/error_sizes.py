"""Sizes: whether the errors of one target's rows, or of one group's, are larger than those of others.

The likelihood of more noise there also gains by a few loud rows that happen to be among them: heavy
tails resemble it. So the sizes of the errors are compared by their ranks, which a few rows move
little: of a target within each configuration, which is as hard to predict for all of its targets; of
a group by whole configurations, within each posture that others measured, too. The ranks are weighted
as by van Elteren 1960, Bull. Inst. Int. Stat. 37:351; where nothing is larger their sum is normal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._linalg import TINY
from .._typing import Array, Index, Mask, Rows
from .error_directions import standardise_errors
from .restricted_likelihood import Likelihood
from .shared_errors import SharedError


@dataclass(frozen=True, eq=False)
class Comparison:
    """What is compared of the rows: those that may have larger errors (m,), the unit (m,) whose rows
    count as one, and the stratum (m,) within which units are compared."""

    is_larger: Mask
    unit: Index
    stratum: Index

    def take(self, rows: Rows) -> Comparison:
        """Return what is compared of some rows."""
        is_larger = self.is_larger[rows]
        unit = self.unit[rows]
        stratum = self.stratum[rows]
        return Comparison(is_larger, unit, stratum)

    def compute_p(self, sizes: Array) -> float:
        """Compute how often chance puts as many of the largest values (m,) where they are expected."""
        from scipy.special import ndtr

        _, first, unit = np.unique(self.unit, return_index=True, return_inverse=True)
        is_larger = self.is_larger[first]
        stratum = _pool_alike(self.stratum[first], is_larger)
        value = np.bincount(unit, sizes) / np.bincount(unit)
        every = np.bincount(stratum)
        larger = np.bincount(stratum, is_larger)
        rank = _rank_within(stratum, value)
        middle = (every + 1) / 2
        beyond = (rank - middle[stratum]) / (every + 1)[stratum]
        variance = larger * (every - larger) / (every + 1) / 12
        spread = np.sqrt(variance.sum())
        if not spread:
            return 1.0
        z = beyond[is_larger].sum() / spread
        return float(ndtr(-z))


def compute_size_p(at: Likelihood, part: SharedError, compared: Comparison) -> float:
    """Compute how often errors of these sizes, in a random order, are as large in the rows of a part
    as those of a likelihood without it are."""
    errors, _ = standardise_errors(at, part)
    squares = np.square(errors).sum(1)
    sizes = np.log(np.maximum(squares, TINY))
    return compared.compute_p(sizes)


def _pool_alike(stratum: Index, is_larger: Mask) -> Index:
    """Return strata (u,) of which those that hold units of one kind alone are one."""
    _, number = np.unique(stratum, return_inverse=True)
    every = np.bincount(number)
    larger = np.bincount(number, is_larger)
    is_alike = (larger == 0) | (larger == every)
    return np.where(is_alike[number], len(every), number)


def _rank_within(stratum: Index, value: Array) -> Index:
    """Rank values (u,) from 1 within each stratum."""
    count = len(value)
    order = np.lexsort((value, stratum))
    every = np.bincount(stratum)
    end = np.cumsum(every)
    begin = end - every
    rank = np.empty(count, np.intp)
    rank[order] = np.arange(1, count + 1)
    before = begin[stratum]
    return np.asarray(rank - before)
