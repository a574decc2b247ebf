"""Terms that physics gives a sign: how far the fit of each is on its side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .._typing import Array, Index


class Sides(NamedTuple):
    """Of a bucket: which of the signed candidates (s,) it holds, where it has them (s,), the map
    (s, k, k) from Zᵀr to their terms, each times its sign and over its standard error at unit
    noise, and (s, k, 1) inf for a term of either sign."""

    signed: Index
    place: Index
    to: Array
    free: Array


def build_sides(which: Index, W: Array, signs: Sequence[Array], signed: Index) -> Sides:
    """Of a bucket of candidates `which` (n,) with Zᵀr = W Xᵀr (W (n, k, k)); a term that the model
    has already gets 0."""
    place = np.flatnonzero(np.isin(which, signed))
    own = np.array([signs[g] for g in which[place]]).reshape(len(place), W.shape[1])
    terms = np.swapaxes(W[place], 1, 2)  # their covariance is WᵀW
    error = np.linalg.norm(terms, axis=2, keepdims=True)
    unit = np.divide(terms, error, out=np.zeros_like(terms), where=error > 0)
    return Sides(
        np.searchsorted(signed, which[place]),
        place,
        own[:, :, None] * unit,
        np.where(own == 0, np.inf, 0.0)[:, :, None],
    )


def least(z: Array, side: Sides) -> Array:
    """(s, B) the term of each signed candidate that is least of its sign, from the bucket's Zᵀr z
    (n, k, B), in its precision."""
    return np.asarray(
        (np.matmul(side.to.astype(z.dtype), z[side.place]) + side.free.astype(z.dtype)).min(1)
    )
