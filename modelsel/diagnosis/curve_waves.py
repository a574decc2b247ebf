"""The strongest waves of a free function of a joint."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .._typing import Array
from ..mechanisms.causes import Bump
from ..mechanisms.terms import Term

# waves per turn that are looked for in a free function, how many are named, and the least share of
# the curve's sum of squares that one must explain
MAX_WAVES = 90
NAMED_WAVES = 2
MIN_WAVE_SHARE = 0.1


def find_waves(terms: Sequence[Term], estimate: Array) -> list[tuple[int, float]]:
    """Find (waves per turn, amplitude) of the two strongest waves of a free function.

    They are found beyond a straight line, one after the other.

    A wave must repeat at least twice within the range, and explain a tenth of the rest."""
    causes = (term.screws[0].cause for term in terms)
    bumps = [(c, v) for c, v in zip(causes, estimate, strict=True) if isinstance(c, Bump)]
    centres = [bump.centre for bump, _ in bumps]
    grid = np.linspace(min(centres), max(centres), 1000)
    curve = np.zeros(len(grid))
    for bump, value in bumps:
        curve += value * bump.shape(grid)
    fewest = max(1, int(np.ceil(2 * 2 * np.pi / np.ptp(grid))))
    waves: list[tuple[int, float]] = []
    for _ in range(NAMED_WAVES):
        before = _fit_waves(grid, curve, 0)[0]
        fits = [(*_fit_waves(grid, curve, k), k) for k in range(fewest, MAX_WAVES + 1)]
        left, beta, count = min(fits, key=lambda fitted: fitted[0])
        if before == 0 or left > (1 - MIN_WAVE_SHARE) * before:
            break
        waves.append((count, float(np.hypot(*beta[2:]))))
        curve = curve - np.column_stack([np.sin(count * grid), np.cos(count * grid)]) @ beta[2:]
    return waves


def _fit_waves(grid: Array, curve: Array, count: int) -> tuple[float, Array]:
    """Fit a line, and a wave of `count` a turn unless that is 0: (sum of squares left, terms)."""
    X = np.column_stack([np.ones_like(grid), grid])
    if count:
        X = np.column_stack([X, np.sin(count * grid), np.cos(count * grid)])
    beta = np.asarray(np.linalg.lstsq(X, curve, rcond=None)[0], float)
    return float(np.square(curve - X @ beta).sum()), beta
