"""Weights of iteratively reweighted least squares: the larger a residual, the less its row counts."""

from __future__ import annotations

import numpy as np

from .._typing import Array, Mask
from ..robot.rigid import nearest_rotation

# medians of the residuals' lengths beyond which a row counts less and less
MEDIANS = 3.0
# rounds of reweighting of a rotation
ROTATION_ROUNDS = 12
# least scales of the weights, by residuals of positions [mm] and of rotations [rad]
MIN_SCALE_MM = 1e-6
MIN_ROTATION_SCALE = 1e-9


def compute_scale(size: Array, least: float) -> float:
    """Compute the scale of the weights from lengths of residuals: MEDIANS medians, or `least`."""
    median = float(np.median(size))
    scale = MEDIANS * median
    return max(scale, least)


def compute_cauchy_weights(size: Array, scale: Array | float) -> Array:
    """Compute weights 1 / (1 + (size / scale)²): of a row far off, its square has a weight of 1."""
    ratio = size / scale
    influence = 1 + ratio**2
    weights = 1 / influence
    return np.asarray(weights)


def compute_redescending_weights(size: Array, scale: Array | float) -> Array:
    """Compute weights 1 / (1 + (size / scale)²)²: a row far off has no influence (Geman & McClure
    1985)."""
    ratio = size / scale
    influence = 1 + ratio**2
    weights = 1 / influence**2
    return np.asarray(weights)


def compute_redescending_loss(square: Array, scale: Array | float) -> tuple[Array, Array]:
    """Compute (losses, weights) of the redescending loss from squared lengths of residuals."""
    ratio = square / scale**2
    influence = 1 + ratio
    losses = square / influence
    weights = 1 / influence**2
    return losses, weights


def fit_rotation_robustly(a: Array, b: Array, is_trusted: Mask) -> Array:
    """Fit the rotation R (3, 3) with a = R b to vectors a, b (m, 3) [rad] with Cauchy weights.

    Rows that are not trusted do not count."""
    weight = is_trusted.astype(float)
    for _ in range(ROTATION_ROUNDS):
        covariance = np.einsum("m,mi,mj->ij", weight, a, b)
        R = nearest_rotation(covariance)
        size = np.linalg.norm(a - b @ R.T, axis=1)
        scale = compute_scale(size, MIN_ROTATION_SCALE)
        weight = is_trusted * compute_cauchy_weights(size, scale)
    return R
