"""Alignment: whether the errors of single rows lie along what a joint would move, or where an
instrument would err most, whatever their lengths.

Where nothing was measured again and there is one target, a joint that does not repeat is told by the
directions of the errors alone. Its likelihood also gains by a few loud rows that happen to lie where
the joint moves the target far: heavy tails resemble it. Errors u_i of c numbers that are alike in all
directions, each of its own length, lie along k_i by chance: cos² of the angle between them has a beta
distribution of (1/2, (c - 1)/2), and of (r/2, (c - r)/2) where k_i spans r directions. The sum of
|u_i|² |k_i|² cos² has its first three moments by that, and the tail of the gamma distribution that has
them, too."""

from __future__ import annotations

import numpy as np

from .._typing import Array
from .restricted_likelihood import Likelihood
from .shared_errors import SharedError

# share of a row's variance that the fit leaves, below which its error in a direction says nothing
LEAST_LEFT = 1e-3


def compute_alignment_p(at: Likelihood, part: SharedError) -> float:
    """Compute how often errors of these lengths, in random directions, lie along a part as much as
    those of a likelihood without it do."""
    u, k = standardise_errors(at, part)
    spanned = k.shape[2]
    along = np.square(np.einsum("mc,mcr->mr", u, k)).sum(1)
    squares = np.square(k).sum((1, 2)) / spanned
    most = np.square(u).sum(1) * squares
    return compute_chance(along, most, u.shape[1], spanned)


def compute_chance(along: Array, most: Array, count: int, spanned: int = 1) -> float:
    """Compute how often Σ most · cos² is as large as Σ along, the angles being those of random
    directions in `count` dimensions with a plane of `spanned`."""
    mean, variance, third = _find_moments(count, spanned)
    spread = np.sqrt(variance * np.square(most).sum())
    if spread == 0:
        return 1.0
    z = (along.sum() - mean * most.sum()) / spread
    skewness = third * (most**3).sum() / spread**3
    return compute_tail(z, skewness)


def compute_tail(z: float, skewness: float) -> float:
    """Compute how often the gamma distribution of mean 0, variance 1 and a skewness exceeds z."""
    from scipy.special import gammainc, gammaincc

    shape = 4 / skewness**2
    beyond = shape + 2 * z / skewness
    # the gamma distribution has its longer tail where the sum has it
    tail = gammaincc if skewness > 0 else gammainc
    return float(tail(shape, max(beyond, 0.0)))


def _find_moments(count: int, spanned: int) -> tuple[float, float, float]:
    """Find the mean and the second and third central moments of cos² to a plane of `spanned`
    dimensions in so many."""
    mean = spanned / count
    second = mean * (spanned + 2) / (count + 2)
    third = second * (spanned + 4) / (count + 4)
    variance = second - mean**2
    central = third - 3 * mean * second + 2 * mean**3
    return mean, variance, central


def standardise_errors(at: Likelihood, part: SharedError) -> tuple[Array, Array]:
    """Return every row's error u (m, c), of equal variance in all directions where there is no such
    part, and what the part does to it, k (m, c, r)."""
    value, vector = np.linalg.eigh(_list_variances(at))
    is_left = value > LEAST_LEFT
    root = np.sqrt(np.where(is_left, value, 0.0))
    inverse = np.zeros_like(root)
    np.divide(1.0, root, out=inverse, where=is_left)
    errors = at.innovations[:, :, 0]
    turned = np.einsum("mcd,mc->md", vector, errors)
    seen = np.einsum("mcd,mcr->mdr", vector, part.loading)
    return turned * inverse, seen * root[:, :, None]


def _list_variances(at: Likelihood) -> Array:
    """List the variances (m, c, c) of the rows' innovations P y: the blocks of P on its diagonal."""
    m, c, _ = at.innovations.shape
    variances = np.tile(np.eye(c), (m, 1, 1))
    if at.precision is not None:
        for rows, precision in zip(at.precision.rows, at.precision.blocks, strict=True):
            blocks, k = rows.shape
            shape = blocks, k, c, k, c
            by_row = precision.reshape(shape)
            variances[rows] = np.einsum("bicid->bicd", by_row)
    taken = np.matmul(at.directions, at.directions.swapaxes(1, 2))
    return np.asarray(variances - taken)
