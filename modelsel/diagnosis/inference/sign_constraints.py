"""Sign constraints: how far the fitted terms are on the side that physics allows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..._linalg import TINY
from ..._typing import Array, Index, Mask
from ...mechanisms.terms import Mechanism

# how often chance may give one of a mechanism's terms the wrong sign by so many standard errors
WRONG_BY_CHANCE = 0.025


class Sides(NamedTuple):
    """The candidates of a bucket that have a term with a sign.

    `signed` (s,): their indices among all signed candidates; `place` (s,): their indices in the
    bucket; `projection` (s, k, k): from Zᵀr to their terms, each times its sign and over its standard
    error at unit noise; `unsigned` (s, k, 1): inf for a term of either sign, else 0."""

    signed: Index
    place: Index
    projection: Array
    unsigned: Array


def build_sides(which: Index, W: Array, signs: Sequence[Array], signed: Index) -> Sides | None:
    """Build the sides of a bucket of candidates `which` (n,) with Zᵀr = W Xᵀr, W (n, k, k).

    A term that the model has already gets 0. None where no candidate has a sign."""
    position = np.searchsorted(signed, which)
    place = np.flatnonzero(np.append(signed, -1)[position] == which)
    if not len(place):
        return None
    sign = np.array([signs[g] for g in which[place]])
    terms = np.swapaxes(W[place], 1, 2)  # their covariance is WᵀW
    error = np.linalg.norm(terms, axis=2, keepdims=True)
    standardised = np.divide(terms, error, out=np.zeros_like(terms), where=error > 0)
    unsigned = np.where(sign == 0, np.inf, 0.0)[:, :, None]
    return Sides(position[place], place, sign[:, :, None] * standardised, unsigned)


def compute_least_of_sign(z: Array, side: Sides) -> Array:
    """Compute (s, B) the term of each signed candidate that is least of its sign.

    `z` (n, k, B): the bucket's Zᵀr; the result has its precision."""
    terms = np.matmul(side.projection.astype(z.dtype), z[side.place])
    return np.asarray((terms + side.unsigned.astype(z.dtype)).min(1))


def find_contrary_terms(mechanism: Mechanism, estimate: Array, error: Array) -> Mask:
    """Find the terms (k,) of the sign that physics forbids, beyond what chance gives one of them by
    their standard errors.

    None of a mechanism that has a sentence for that sign."""
    from scipy.special import ndtr

    signs = np.array([term.sign for term in mechanism.terms])
    signed = np.count_nonzero(signs)
    if mechanism.contrary or not signed:
        return np.zeros(len(signs), bool)
    standardised = signs * estimate / np.maximum(error, TINY)
    by_chance = signed * ndtr(standardised)
    return np.asarray((signs != 0) & (by_chance < WRONG_BY_CHANCE))


def are_unsigned_negative(mechanism: Mechanism, estimate: Array) -> bool:
    """Return whether terms (k,) to which physics gives no sign are all negative."""
    is_signed = any(term.sign for term in mechanism.terms)
    is_negative = estimate < 0
    if is_signed:
        return False
    return bool(is_negative.all())
