"""Errors in mm on estimation and held-out rows, and the paired gain between two models with its interval."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .._typing import Array, Index

DRAWS = 2000
DRAWN = 5000   # configurations, or bundles of them, that the bootstrap draws from


@dataclass(frozen=True)
class Errors:
    """Lengths of the residual vectors [mm] over rows; `left_out` outlying rows, `mean_all_mm` with them in."""

    mean_mm: float | None
    rms_mm: float | None
    p95_mm: float | None
    max_mm: float | None
    rows: int
    left_out: int
    mean_all_mm: float | None


def errors(residual: Array, outlying: NDArray[np.bool_] | None = None) -> Errors:
    """Of residuals (m, 3) [mm]; None where there are no rows."""
    return errors_of(np.linalg.norm(residual[:, :3], axis=1), outlying)


def errors_of(size: Array, outlying: NDArray[np.bool_] | None = None) -> Errors:
    """Of lengths (m,) [mm]."""
    good = size if outlying is None else size[~outlying]
    left = len(size) - len(good)
    if not len(good):
        return Errors(None, None, None, None, 0, left, float(size.mean()) if len(size) else None)
    return Errors(float(good.mean()), float(np.sqrt(np.square(good).mean())), float(np.percentile(good, 95)),
                  float(good.max()), len(good), left, float(size.mean()))


@dataclass(frozen=True)
class Gain:
    """Held-out rms before and after, and the 95 % interval [low, high] of their difference, by configurations."""

    held_out_rms_before_mm: float | None
    held_out_rms_after_mm: float | None
    interval_mm: tuple[float, float] | None


@dataclass(frozen=True, eq=False)
class Resampled:
    """Rows drawn anew by whole configurations: the configuration, or bundle of them, of every row (m,), and how often each is in
    every draw (DRAWS, K); None with fewer than three."""

    index: Index
    draw: NDArray[np.int64] | None

    @staticmethod
    def of(block: Index, rng: np.random.Generator) -> Resampled:
        """By configurations (m,); one drawing serves every pair of models on the same rows."""
        blocks, index = np.unique(block, return_inverse=True)
        if len(blocks) > DRAWN:                     # many configurations are drawn in bundles: the interval is the same
            blocks, index = np.arange(DRAWN), index % DRAWN
        some = rng.multinomial(len(blocks), np.full(len(blocks), 1 / len(blocks)), DRAWS) if len(blocks) >= 3 else None
        return Resampled(index, some)


def gain(before: Array, after: Array, block: Index, rng: np.random.Generator) -> Gain:
    """Paired: both residuals (m, 3) on the same rows; the bootstrap draws whole configurations."""
    return paired(before, after, Resampled.of(block, rng))


def paired(before: Array, after: Array, rows: Resampled) -> Gain:
    """The gain on rows already drawn."""
    if not len(before):
        return Gain(None, None, None)
    squares = np.stack([np.bincount(rows.index, np.square(r[:, :3]).sum(1)) for r in (before, after)])
    whole = np.sqrt(squares.sum(1) / len(before))
    if rows.draw is None:
        return Gain(float(whole[0]), float(whole[1]), None)
    first, second = np.sqrt(squares @ rows.draw.T / (rows.draw @ np.bincount(rows.index)))
    low, high = np.percentile(first - second, [2.5, 97.5])
    return Gain(float(whole[0]), float(whole[1]), (float(low), float(high)))


def surprise(expected: Array, own: Index, seen: Array, block: Index) -> tuple[float, float]:
    """(how many times as large, rms, p): are held-out lengths `seen` [mm] larger than the cross-validated ones `expected`, of
    configurations `block` and `own`? Wilcoxon's rank sum of mean squares per configuration, so that tails do not matter; (1, 1)
    with fewer than five configurations on a side."""
    from scipy.special import ndtr
    first, second = (_per_block(np.square(size), unit) for size, unit in ((expected, own), (seen, block)))
    a, b = len(first), len(second)
    if min(a, b) < 5 or not first.mean() > 0:
        return 1.0, 1.0
    rank = np.empty(a + b)
    rank[np.argsort(np.concatenate([first, second]), kind="stable")] = np.arange(1, a + b + 1)
    z = (rank[a:].sum() - b * (a + b + 1) / 2) / np.sqrt(a * b * (a + b + 1) / 12)
    return float(np.sqrt(second.mean() / first.mean())), float(ndtr(-z))


def _per_block(values: Array, block: Index) -> Array:
    which = np.unique(block, return_inverse=True)[1]
    return np.asarray(np.bincount(which, values) / np.bincount(which))
