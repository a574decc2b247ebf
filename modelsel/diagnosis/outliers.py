"""Gross outliers: found before anything is named, by least trimmed squares on the fitted model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .._typing import Array, Index
from ..fitting.design import Model, compute_design
from ..fitting.identifiability import identify
from ..fitting.least_squares import Fit, fit
from ..fitting.problem import Problem
from ..fitting.reduction import reduce

TRIM = 0.75  # share of the rows that the concentration steps fit
MEDIAN_3 = 1.5382  # median length of three standard normals
MEDIAN_1 = 0.6745  # and of one
GROSS_THRESHOLD = (
    8.0  # robust standard deviations of one coordinate, before naming: systematic error is still in
)
LEFT = 6.0  # the same, once the named effects are taken out
MOST = 0.15  # of the rows: more are not outliers but an effect
CONCENTRATION_STEPS = 12

REWEIGHTING_STEPS = NDArray[np.bool_]


def lengths(residual: Array) -> Array:
    """(m,) lengths of the positional part of residuals (m, c)."""
    return np.asarray(np.linalg.norm(residual[:, :3], axis=1))


def estimate_scale(size: Array, measured: REWEIGHTING_STEPS | None = None) -> float:
    """Robust standard deviation of one coordinate from lengths of residual vectors; `measured` (m,
    c): which coordinates each has (None: three)."""
    return float(np.median(_alike(size, measured))) / MEDIAN_3


def _alike(size: Array, measured: REWEIGHTING_STEPS | None) -> Array:
    """Lengths (m,) as they would be of three coordinates, by their medians."""
    return (
        size
        if measured is None
        else size * np.where(measured[:, :3].sum(1) == 1, MEDIAN_3 / MEDIAN_1, 1.0)
    )


def find_gross_outliers(problem: Problem, base: Model) -> REWEIGHTING_STEPS:
    """(m,) rows far off, whatever the base does not explain: concentration steps from the plain fit
    (Rousseeuw & Van Driessen 1999), then residuals in robust standard deviations, each divided by
    what its leverage makes of it."""
    fitted = fit(problem, base)
    X, r = compute_design(problem, base.terms, fitted.at())
    X = X[:, :, list(fitted.representatives)]
    seen = problem.measured
    m, p, c = len(X), X.shape[2], problem.coordinates / len(X)
    keep = max(int(TRIM * m), int(np.ceil(2 * p / c)) + 1)
    if keep >= m:
        return np.zeros(m, bool)
    inside = np.ones(m, bool)
    size = lengths(r)
    for _ in range(CONCENTRATION_STEPS):
        chosen = np.zeros(m, bool)
        chosen[np.argsort(_alike(size, seen), kind="stable")[:keep]] = True
        if (chosen == inside).all():
            break
        inside = chosen
        left, spread = _refit(X, r, inside, seen)
        size = lengths(left / spread[:, None])
    flagged = size > GROSS_THRESHOLD * estimate_scale(
        size[inside], None if seen is None else seen[inside]
    ) / _shrinkage(TRIM, round(min(c, 3)))
    for _ in range(3):
        left, spread = _refit(X, r, ~flagged, seen)
        size = lengths(left / spread[:, None])
        again = size > GROSS_THRESHOLD * estimate_scale(size, seen)
        if (again == flagged).all() or again.mean() > MOST:
            break
        flagged = again
    return flagged if flagged.mean() <= MOST else np.zeros(m, bool)


def _shrinkage(share: float, c: int) -> float:
    """Median length among the smallest `share` of normals of c coordinates, over the median of
    all."""
    from scipy.special import gammaincinv

    return float(
        np.sqrt(2 * gammaincinv(c / 2, share / 2))
        / (MEDIAN_3 if c == 3 else np.sqrt(2 * gammaincinv(c / 2, 0.5)))
    )


def _refit(
    X: Array, r: Array, inside: REWEIGHTING_STEPS, measured: REWEIGHTING_STEPS | None
) -> tuple[Array, Array]:
    """Residuals (m, c) of the fit to the rows `inside`, and the factor (m,) their leverage puts on
    them; `measured` (m, c)."""
    _, c, p = X.shape
    reduction = reduce(X[inside].reshape(int(inside.sum()) * c, p), r[inside].ravel())
    kept = list(identify(reduction).kept)
    R = reduction.select(kept).R
    T = np.linalg.inv(R[:-1, :-1])
    left = r - X[:, :, kept] @ (T @ R[:-1, -1])
    leverage = np.square(X[:, :, kept] @ T).sum((1, 2)) / (
        c if measured is None else measured.sum(1)
    )
    return left, np.sqrt(np.where(inside, np.maximum(1 - leverage, 0.05), 1 + leverage))


def find_far_rows(
    residual: Array, reference: Array, threshold: float, measured: REWEIGHTING_STEPS | None = None
) -> REWEIGHTING_STEPS:
    """Rows of `residual` longer than `threshold` robust standard deviations of the `reference`
    rows, whose coordinates are `measured` (None: all)."""
    return np.asarray(lengths(residual) > threshold * estimate_scale(lengths(reference), measured))


# Faults of the data, found among the gross outliers: rows whose position belongs to another row.

MATCH = 8.0  # robust standard deviations within which a position fits another row
DRAWS = 1999
CERTAIN = 0.05
CREDIBLE = 0.95  # posterior probability from which a fault is told
TAIL = 4  # degrees of freedom of a good position about its prediction
MOST_ROWS = 1000  # outlying rows: among more, every position finds a reading that it fits


@dataclass(frozen=True, eq=False)
class Fault:
    """A data fault: its name, the rows of the file it concerns (0-based), a sentence, how often
    chance does as well, and its posterior `probability` against gross errors that have nothing to
    do with each other."""

    name: str
    rows: Index
    sentence: str
    p: float
    probability: float


def misplaced(
    problem: Problem, outlying: REWEIGHTING_STEPS, fitted: Fit, rng: np.random.Generator
) -> tuple[Fault, ...]:
    """Outlying rows whose positions fit each other's joint readings or targets: swapped reflectors
    where they share a configuration, a wrong order of rows elsewhere. Chance: the same distances in
    random directions. Told where both that p and the posterior probability (`_probability`) are
    clear."""
    gauges = problem.data.gauges
    points = np.ones(len(outlying), bool) if gauges is None else gauges.of("point")
    at = np.flatnonzero(outlying & points)
    if not 2 <= len(at) <= MOST_ROWS:
        return ()
    residual = fitted.residuals(problem)[:, :3]
    scale = estimate_scale(np.linalg.norm(residual[~outlying & points], axis=1))
    near = MATCH * scale
    measured = problem.data.position[at]
    predicted = measured - residual[at]
    fits = _fits(measured, predicted, near)
    if fits.sum() < 2:
        return ()
    direction = rng.standard_normal((DRAWS, len(at), 3))
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    away = predicted + direction * np.linalg.norm(residual[at], axis=1)[:, None]
    chance = np.array([_fits(one, predicted, near).sum() for one in away])
    p = float((1 + (chance >= fits.sum()).sum()) / (DRAWS + 1))
    if p > CERTAIN:
        return ()
    rows, data = at[fits], problem.data
    every = _partner(measured, predicted)
    partner = every[fits]
    ratio = _log_ratio(
        np.linalg.norm(measured - predicted[every], axis=1),
        np.linalg.norm(residual[at], axis=1),
        scale,
        problem.reach_mm,
    )
    together = data.configuration[rows] == data.configuration[at[partner]]
    out = []
    for name, mask, words in (
        (
            "swapped-reflectors",
            together,
            "the reflectors of these rows are swapped: each position fits the other target",
        ),
        (
            "row-order",
            ~together,
            "these rows stand in the wrong order: each position fits another row's joint readings",
        ),
    ):
        concerned = np.zeros(len(at), bool)
        concerned[np.flatnonzero(fits)[mask]] = True
        probability = _probability(ratio, concerned)
        if mask.sum() >= 2 and probability >= CREDIBLE:
            index = data.row[rows[mask]]
            out.append(
                Fault(
                    name,
                    index,
                    f"A fault of the data: {words} ({data.where.listed(index)}).",
                    p,
                    probability,
                )
            )
    return tuple(out)


def _log_ratio(distance: Array, length: Array, scale: float, reach: float) -> Array:
    """(k,) log ratio of a measured position's density if it belongs to another outlying row to that
    if it is any gross error. There: a t of TAIL degrees of freedom and the good rows' `scale` [mm]
    about the prediction of that row, one of k - 1 equally likely; `distance` (k,) to it. Any gross
    error: every direction alike, the logarithm of its `length` (k,) spread evenly from where rows
    count as outlying to the arm's `reach`."""
    from scipy.special import gammaln

    k, length = len(distance), np.maximum(length, MATCH * scale)
    there = (
        gammaln((TAIL + 3) / 2)
        - gammaln(TAIL / 2)
        - 1.5 * np.log(TAIL * np.pi)
        - 3 * np.log(scale)
        - (TAIL + 3) / 2 * np.log1p(np.square(distance / scale) / TAIL)
        - np.log(k - 1)
    )
    spread = np.log(max(reach / (MATCH * scale), np.e))
    return np.asarray(there + np.log(4 * np.pi * spread) + 3 * np.log(length))


def _probability(log_ratio: Array, concerned: REWEIGHTING_STEPS) -> float:
    """Posterior probability that rows were exchanged, as likely before as not, and then every
    outlying row as likely as not among them: Bayes factor = product over the rows of (1 + ratio) /
    2, ratio nought for a row that is not `concerned`."""
    from scipy.special import expit

    return float(
        expit((np.logaddexp(0.0, np.where(concerned, log_ratio, -np.inf)) - np.log(2)).sum())
    )


def _partner(measured: Array, predicted: Array) -> Index:
    """(k,) for every outlying row, the other outlying row whose prediction is nearest to its
    measured position."""
    distance = np.linalg.norm(measured[:, None] - predicted[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    return np.asarray(distance.argmin(1), dtype=np.intp)


def _fits(measured: Array, predicted: Array, near: float) -> REWEIGHTING_STEPS:
    partner = _partner(measured, predicted)
    return np.asarray(np.linalg.norm(measured - predicted[partner], axis=1) < near)
