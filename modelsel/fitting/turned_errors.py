"""Turned errors: whether what a joint moves fits the errors of a campaign better than it fits errors of
the same lengths, each row's turned at random.

Where a posture or several targets are measured, a joint that does not repeat gains by all rows of a
visit together. Its likelihood also gains by a few loud rows: heavy tails resemble it there as they do
in single rows (`error_directions`). Rows of a visit or of a posture are not independent then, so that
no formula says how often: the slope of the likelihood is computed for errors that are drawn, of the
lengths that the rows have, in random directions, with what they share drawn beside. A gamma
distribution with the first three moments of these slopes gives the chance. In both, errors that are
much longer than most count as no longer: else a few rows would hide a joint that all others show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.random import Generator

from .._typing import Array, Index
from .error_directions import compute_tail, standardise_errors
from .restricted_likelihood import Likelihood
from .shared_errors import SharedError, confine, group_blocks

# campaigns that are drawn, by a stream of their own that is the same in every study
DRAWS = 400
SEED = 0
# lengths of the errors, over their median, beyond which they count as if they were as long
SOFT = 2.0
# what keeps the correlations of what lasts from one row to the next positive
JITTER = 1e-9


def compute_turned_p(at: Likelihood, part: SharedError) -> float:
    """Compute how often errors of these lengths, turned at random, raise the likelihood by a part as much
    as those of a likelihood without it do."""
    rng = np.random.default_rng(SEED)
    part = confine(part, at.layout.parts)
    lengths = np.linalg.norm(at.innovations, axis=1)
    most = SOFT * float(np.median(lengths))
    if not most:
        return 1.0
    own = _measure_slopes(at.innovations, most, part)
    response = _draw_campaigns(at, part, rng)
    innovations = at.solve(response)
    drawn = _measure_slopes(innovations, most, part)
    mean = drawn.mean()
    beyond = drawn - mean
    spread = np.sqrt(np.square(beyond).mean())
    if spread == 0:
        return 1.0
    skewness = (beyond**3).mean() / spread**3
    z = (own.item() - mean) / spread
    return compute_tail(z, skewness)


def _measure_slopes(innovations: Array, most: float, part: SharedError) -> Array:
    """Measure (n,) yᵀPVPy of innovations P y (m, c, n), V being a part's, over yᵀPPy; no row's counts
    as longer than `most`."""
    length = np.linalg.norm(innovations, axis=1, keepdims=True)
    share = most / np.maximum(length, most)
    shorter = innovations * share
    moved = part.multiply(shorter)
    seen = np.einsum("mcn,mcn->n", shorter, moved)
    squares = np.einsum("mcn,mcn->n", shorter, shorter)
    return np.asarray(seen / squares)


def _draw_campaigns(at: Likelihood, part: SharedError, rng: Generator) -> Array:
    """Draw responses (m, c, n) that have the parts of a likelihood, and rows of its errors' lengths."""
    errors, _ = standardise_errors(at, part)
    m, c = errors.shape
    direction = rng.standard_normal((m, c, DRAWS))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    length = np.linalg.norm(errors, axis=1)
    alike = direction * length[:, None, None]
    laid = _list_laid(at)
    single = [one for one in laid if _is_of_row(one)]
    roots = _list_roots(single, m, c)
    drawn: Array = np.matmul(roots, alike)
    scale = np.sqrt(at.phi)
    for one in laid:
        if not _is_of_row(one):
            drawn += scale * _draw_shared(one, rng)
    return drawn


def _list_laid(at: Likelihood) -> list[SharedError]:
    """List the parts as they stand in the blocks of a likelihood, with their variances."""
    pairs = zip(at.layout.parts, at.parts, strict=True)
    return [replace(laid, variance=own.variance) for laid, own in pairs]


def _is_of_row(part: SharedError) -> bool:
    """Whether every row has a draw of its own."""
    return len(np.unique(part.level)) == len(part.level)


def _list_roots(single: list[SharedError], m: int, c: int) -> Array:
    """List roots (m, c, c) of the covariances of what every row has by itself."""
    covariance = np.tile(np.eye(c), (m, 1, 1))
    for one in single:
        covariance += one.variance * np.matmul(one.loading, one.loading.swapaxes(1, 2))
    return np.asarray(np.linalg.cholesky(covariance))


def _draw_shared(part: SharedError, rng: Generator) -> Array:
    """Draw (m, c, n) what rows share by a part."""
    m, _, d = part.loading.shape
    normal = rng.standard_normal((m, d, DRAWS))
    if part.time is None:
        _, number = np.unique(part.level, return_inverse=True)
        draws = normal[number]
    else:
        draws = np.empty_like(normal)
        for rows in group_blocks(part.level):
            draws[rows] = _correlate(part, normal, rows)
    moved: Array = np.matmul(part.loading, draws)
    moved *= np.sqrt(part.variance)
    return moved


def _correlate(part: SharedError, normal: Array, rows: Index) -> Array:
    """Correlate normal draws (m, d, n) of rows (B, k) as a part that lasts does."""
    correlation = part.correlate(rows)
    count = correlation.shape[1]
    root = np.linalg.cholesky(correlation + JITTER * np.eye(count))
    return np.asarray(np.einsum("bij,bjdn->bidn", root, normal[rows]))
