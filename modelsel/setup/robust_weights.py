"""Weights of iteratively reweighted least squares: the larger a residual, the less its row counts."""

from __future__ import annotations

import numpy as np

from .._typing import Array

# medians of the residuals' lengths beyond which a row counts less and less
MEDIANS = 3.0


def compute_scale(size: Array, least: float) -> float:
    """Compute the scale of the weights from lengths of residuals: MEDIANS medians, or `least`."""
    return max(MEDIANS * float(np.median(size)), least)


def compute_cauchy_weights(size: Array, scale: Array | float) -> Array:
    """Compute weights 1 / (1 + (size / scale)²): of a row far off, its square has a weight of 1."""
    return np.asarray(1 / (1 + (size / scale) ** 2))


def compute_redescending_weights(size: Array, scale: Array | float) -> Array:
    """Compute weights 1 / (1 + (size / scale)²)²: a row far off has no influence (Geman & McClure
    1985)."""
    return np.asarray(1 / (1 + (size / scale) ** 2) ** 2)


def compute_redescending_loss(square: Array, scale: float) -> tuple[Array, Array]:
    """Compute (losses, weights) of the redescending loss from squared lengths of residuals."""
    ratio = square / scale**2
    return square / (1 + ratio), 1 / (1 + ratio) ** 2
