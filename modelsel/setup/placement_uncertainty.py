"""How certain placements and targets are: the standard deviations that the rows leave."""

from __future__ import annotations

import numpy as np

from .._typing import Array, Mask
from .adjustment import normal_equations
from .placement import MIN_MEDIAN_MM, Placed, Sight, compute_residuals

# error of an arm as a share of how far it moves, and of how many rows it is shared
USUAL_ERROR = 2e-3
INDEPENDENT_ROWS = 6
# share of how far the arm moves above which the misfit says nothing of the uncertainty
MAX_MISFIT = 0.01
# least eigenvalue of scaled normal equations: directions that nothing determines stay finite
NULL_EIGENVALUE = 1e-14
# least information on a parameter that nothing determines, whose variance stays finite
NO_INFORMATION = 1e-100


def compute_uncertainty(sight: Sight, at: Placed, good: Mask) -> tuple[Array, Array]:
    """Compute the standard deviations that the good rows (mask) leave, with targets expected as
    usual: ((G,) of the least certain turn of each placement [rad], (T,) of the least certain
    direction of each target [mm])."""
    residuals = compute_residuals(sight, at)
    sigma = _estimate_sigma(sight, residuals, good)
    weight = good.astype(float)
    H, _ = normal_equations(sight, at, residuals, weight)
    H = H / sigma**2
    G = sight.groups
    T = sight.targets
    first_target = 6 * G
    tools = first_target + np.arange(3 * T)
    prior = 1 / sight.prior_sigma**2
    H[tools, tools] += np.repeat(prior, 3)
    covariance = _invert(H)
    turns = []
    for g in range(G):
        turn = _compute_largest_sigma(covariance, 6 * g)
        turns.append(turn)
    places = []
    for k in range(T):
        start = first_target + 3 * k
        place = _compute_largest_sigma(covariance, start)
        places.append(place)
    return np.array(turns), np.array(places)


def _estimate_sigma(sight: Sight, residuals: Array, good: Mask) -> float:
    """Estimate the standard deviation of a coordinate [mm] for the uncertainty.

    The arm's own errors, USUAL_ERROR of how far it moves, are shared by rows: they count as if only
    INDEPENDENT_ROWS were measured. A misfit beyond MAX_MISFIT means that the robot is wrong."""
    measured = _compute_rms_distance(sight.x[good])
    nominal = _compute_rms_distance(sight.o[good])
    moves = max(measured, nominal)
    squares = np.square(residuals[good])
    square = float(squares.mean())
    largest = MAX_MISFIT * moves
    square = min(square, largest**2)
    usual = USUAL_ERROR * moves
    rows = good.sum()
    rows_per_error = max(rows / INDEPENDENT_ROWS, 1.0)
    shared = usual**2 * rows_per_error
    sigma = float(np.sqrt(square + shared))
    return max(sigma, MIN_MEDIAN_MM)


def _compute_rms_distance(points: Array) -> float:
    """Compute the root mean square distance of points (k, 3) from their median."""
    middle = np.median(points, axis=0)
    offset = points - middle
    square = np.square(offset).sum(1)
    mean = square.mean()
    rms = np.sqrt(mean)
    return float(rms)


def _invert(H: Array) -> Array:
    """Invert normal equations (p, p) after scaling; undetermined directions get a large variance."""
    diagonal = np.diag(H)
    size = np.sqrt(np.maximum(diagonal, NO_INFORMATION))
    scaled = H / np.outer(size, size)
    value, vector = np.linalg.eigh(scaled)
    bounded = np.maximum(value, NULL_EIGENVALUE)
    whitened = vector / np.sqrt(bounded)
    root = whitened / size[:, None]
    inverse = root @ root.T
    return np.asarray(inverse)


def _compute_largest_sigma(covariance: Array, start: int) -> float:
    """Compute the largest standard deviation in the 3 x 3 block from `start` on."""
    end = start + 3
    block = covariance[start:end, start:end]
    variances = np.linalg.eigvalsh(block)
    largest = max(variances[-1], 0.0)
    return float(np.sqrt(largest))
