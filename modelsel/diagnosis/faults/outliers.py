"""Gross outliers: rows far off the fitted model, found by least trimmed squares before anything is
named.

Concentration steps (Rousseeuw & Van Driessen 1999) fit the rows with the smallest residuals; a row
is an outlier where its residual, divided by what its leverage makes of it, exceeds a number of
robust standard deviations."""

from __future__ import annotations

import numpy as np

from ..._typing import Array, Mask
from ...fitting.design import compute_design
from ...fitting.identifiability import identify
from ...fitting.least_squares import Fit
from ...fitting.problem import Problem
from ...fitting.reduction import reduce

# share of the rows that the concentration steps fit
TRIM_SHARE = 0.75
# median length of a vector of three, and of one, standard normal coordinates
MEDIAN_3 = 1.5382
MEDIAN_1 = 0.6745
# robust standard deviations of one coordinate beyond which a row is an outlier: before anything is
# named, while systematic error inflates the residuals, and once the named effects are fitted
GROSS_THRESHOLD = 8.0
REFINED_THRESHOLD = 6.0
# robust standard deviations within which a corrected row fits, and a position another row
MATCH_THRESHOLD = 8.0
# share of the rows beyond which rows far off are no outliers but an effect
MAX_OUTLIER_SHARE = 0.15
CONCENTRATION_STEPS = 12
REWEIGHTING_STEPS = 3


def compute_lengths(residual: Array) -> Array:
    """Compute (m,) lengths of the positional part of residuals (m, c)."""
    return np.asarray(np.linalg.norm(residual[:, :3], axis=1))


def estimate_scale(size: Array, measured: Mask | None = None) -> float:
    """Estimate the robust standard deviation of one coordinate from lengths (m,) of residuals.

    `measured` (m, c) tells which coordinates every row has; None: all three."""
    return float(np.median(_rescale_lengths(size, measured))) / MEDIAN_3


def _rescale_lengths(size: Array, measured: Mask | None) -> Array:
    """Scale the lengths (m,) of rows with one coordinate so that their median is that of three."""
    if measured is None:
        return size
    coordinates = measured[:, :3].sum(1)
    has_one = coordinates == 1
    three_over_one = MEDIAN_3 / MEDIAN_1
    factor = np.where(has_one, three_over_one, 1.0)
    return np.asarray(size * factor)


def find_gross_outliers(problem: Problem, fitted: Fit) -> Mask:
    """Find the rows (m,) far off the base model, fitted to all, whatever systematic error it leaves in.

    None is flagged where more than MAX_OUTLIER_SHARE of the rows would be, or where the rows are
    too few to trim."""
    X, residual = compute_design(problem, fitted.terms, fitted.at())
    representatives = list(fitted.representatives)
    X = X[:, :, representatives]
    rows, _, columns = X.shape
    coordinates = problem.coordinates / rows
    fewest = np.ceil(2 * columns / coordinates)
    needed = int(fewest) + 1
    keep = max(int(TRIM_SHARE * rows), needed)
    if keep >= rows:
        return np.zeros(rows, bool)
    measured = problem.measured
    inside, size = _concentrate(X, residual, measured, keep)
    dimension = round(min(coordinates, 3))
    scale = _estimate_trimmed_scale(size, inside, measured, dimension)
    flagged = size > GROSS_THRESHOLD * scale
    return _reweight(X, residual, measured, flagged)


def _concentrate(X: Array, residual: Array, measured: Mask | None, keep: int) -> tuple[Mask, Array]:
    """Fit the `keep` rows with the smallest residuals until they stay the same.

    Returns their mask (m,) and the standardised lengths (m,) of all rows."""
    inside = np.ones(len(X), bool)
    size = compute_lengths(residual)
    for _ in range(CONCENTRATION_STEPS):
        rescaled = _rescale_lengths(size, measured)
        order = np.argsort(rescaled, kind="stable")
        chosen = np.zeros(len(X), bool)
        chosen[order[:keep]] = True
        if (chosen == inside).all():
            break
        inside = chosen
        size = _refit(X, residual, inside, measured)
    return inside, size


def _reweight(X: Array, residual: Array, measured: Mask | None, flagged: Mask) -> Mask:
    """Refit the rows that are not flagged, and flag again, until the flags stay the same."""
    for _ in range(REWEIGHTING_STEPS):
        size = _refit(X, residual, ~flagged, measured)
        scale = estimate_scale(size, measured)
        again = size > GROSS_THRESHOLD * scale
        is_settled = (again == flagged).all()
        if is_settled or again.mean() > MAX_OUTLIER_SHARE:
            break
        flagged = again
    if flagged.mean() > MAX_OUTLIER_SHARE:
        return np.zeros(len(flagged), bool)
    return flagged


def _estimate_trimmed_scale(
    size: Array, inside: Mask, measured: Mask | None, coordinates: int
) -> float:
    """Estimate the robust standard deviation of one coordinate from the lengths (m,) of the rows
    `inside`, which are the smallest."""
    seen = None
    if measured is not None:
        seen = measured[inside]
    trimmed = estimate_scale(size[inside], seen)
    share = float(inside.mean())
    return trimmed / _trimmed_median_ratio(share, coordinates)


def _trimmed_median_ratio(share: float, coordinates: int) -> float:
    """Compute the median length of trimmed normal vectors over the median of all.

    Trimming keeps the smallest `share` of them."""
    from scipy.special import gammaincinv

    shape = coordinates / 2
    trimmed = np.sqrt(2 * gammaincinv(shape, share / 2))
    median = MEDIAN_3
    if coordinates != 3:
        median = np.sqrt(2 * gammaincinv(shape, 0.5))
    return float(trimmed / median)


def _refit(X: Array, residual: Array, inside: Mask, measured: Mask | None) -> Array:
    """Compute (m,) standardised lengths of the residuals of a fit to the rows `inside`.

    Each is divided by the factor that its leverage puts on it; X (m, c, p), `measured` (m, c)."""
    _, c, p = X.shape
    reduction = reduce(X[inside].reshape(int(inside.sum()) * c, p), residual[inside].ravel())
    kept = list(identify(reduction).kept)
    R = reduction.select(kept).R
    inverse = np.linalg.inv(R[:-1, :-1])
    rest = residual - X[:, :, kept] @ (inverse @ R[:-1, -1])
    coordinates = c if measured is None else measured.sum(1)
    leverage = np.square(X[:, :, kept] @ inverse).sum((1, 2)) / coordinates
    variance = np.where(inside, np.maximum(1 - leverage, 0.05), 1 + leverage)
    return compute_lengths(rest / np.sqrt(variance)[:, None])


def find_far_rows(
    residual: Array, reference: Array, threshold: float, measured: Mask | None = None
) -> Mask:
    """Find rows of `residual` (m, c) longer than `threshold` robust standard deviations.

    The deviations are those of the `reference` rows, whose coordinates are `measured` (None: all)."""
    length = compute_lengths(residual)
    reference_length = compute_lengths(reference)
    scale = estimate_scale(reference_length, measured)
    is_far = length > threshold * scale
    return np.asarray(is_far)
