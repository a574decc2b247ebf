"""Gross outliers: found before anything is named, by least trimmed squares on the fitted model."""
from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .._typing import Array
from ..fitting.design import Model, design
from ..fitting.identifiability import identify
from ..fitting.least_squares import fit
from ..fitting.problem import Scene
from ..fitting.reduction import reduce

TRIM = 0.75          # share of the rows that the concentration steps fit
MEDIAN_3 = 1.5382    # median length of three standard normals
MEDIAN_1 = 0.6745    # and of one
GROSS = 8.0          # robust standard deviations of one coordinate, before naming: systematic error is still in
LEFT = 6.0           # the same, once the named effects are taken out
MOST = 0.15          # of the rows: more are not outliers but an effect
STEPS = 12

Mask = NDArray[np.bool_]


def lengths(residual: Array) -> Array:
    """(m,) lengths of the positional part of residuals (m, c)."""
    return np.asarray(np.linalg.norm(residual[:, :3], axis=1))


def scale_of(size: Array, measured: Mask | None = None) -> float:
    """Robust standard deviation of one coordinate from lengths of residual vectors; `measured` (m, c): which coordinates each
    has (None: three)."""
    return float(np.median(_alike(size, measured))) / MEDIAN_3


def _alike(size: Array, measured: Mask | None) -> Array:
    """Lengths (m,) as they would be of three coordinates, by their medians."""
    return size if measured is None else size * np.where(measured[:, :3].sum(1) == 1, MEDIAN_3 / MEDIAN_1, 1.0)


def gross(scene: Scene, base: Model) -> Mask:
    """(m,) rows far off, whatever the base does not explain: concentration steps from the plain fit (Rousseeuw & Van
    Driessen 1999), then residuals in robust standard deviations, each divided by what its leverage makes of it."""
    fitted = fit(scene, base)
    X, r = design(scene, base.terms, fitted.at())
    X = X[:, :, list(fitted.representatives)]
    seen = scene.measured
    m, p, c = len(X), X.shape[2], scene.coordinates / len(X)
    keep = max(int(TRIM * m), int(np.ceil(2 * p / c)) + 1)
    if keep >= m:
        return np.zeros(m, bool)
    inside = np.ones(m, bool)
    size = lengths(r)
    for _ in range(STEPS):
        chosen = np.zeros(m, bool)
        chosen[np.argsort(_alike(size, seen), kind="stable")[:keep]] = True
        if (chosen == inside).all():
            break
        inside = chosen
        left, spread = _refit(X, r, inside, seen)
        size = lengths(left / spread[:, None])
    flagged = size > GROSS * scale_of(size[inside], None if seen is None else seen[inside]) / _shrinkage(TRIM, round(min(c, 3)))
    for _ in range(3):
        left, spread = _refit(X, r, ~flagged, seen)
        size = lengths(left / spread[:, None])
        again = size > GROSS * scale_of(size, seen)
        if (again == flagged).all() or again.mean() > MOST:
            break
        flagged = again
    return flagged if flagged.mean() <= MOST else np.zeros(m, bool)


def _shrinkage(share: float, c: int) -> float:
    """Median length among the smallest `share` of normals of c coordinates, over the median of all."""
    from scipy.special import gammaincinv
    return float(np.sqrt(2 * gammaincinv(c / 2, share / 2)) / (MEDIAN_3 if c == 3 else np.sqrt(2 * gammaincinv(c / 2, 0.5))))


def _refit(X: Array, r: Array, inside: Mask, measured: Mask | None) -> tuple[Array, Array]:
    """Residuals (m, c) of the fit to the rows `inside`, and the factor (m,) their leverage puts on them; `measured` (m, c)."""
    _, c, p = X.shape
    reduction = reduce(X[inside].reshape(int(inside.sum()) * c, p), r[inside].ravel())
    kept = list(identify(reduction).kept)
    R = reduction.select(kept).R
    T = np.linalg.inv(R[:-1, :-1])
    left = r - X[:, :, kept] @ (T @ R[:-1, -1])
    leverage = np.square(X[:, :, kept] @ T).sum((1, 2)) / (c if measured is None else measured.sum(1))
    return left, np.sqrt(np.where(inside, np.maximum(1 - leverage, 0.05), 1 + leverage))


def far_off(residual: Array, reference: Array, threshold: float, measured: Mask | None = None) -> Mask:
    """Rows of `residual` longer than `threshold` robust standard deviations of the `reference` rows, whose coordinates are
    `measured` (None: all)."""
    return np.asarray(lengths(residual) > threshold * scale_of(lengths(reference), measured))
