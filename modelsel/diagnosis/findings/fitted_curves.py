"""Free functions as they are fitted: how high their curves are, and which waves they have."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..._typing import Array
from ...mechanisms.causes import Bump
from ...mechanisms.terms import Term

# waves per turn that are looked for in a free function, how many are named, and the least share of
# the curve's sum of squares that one must explain
MAX_WAVES = 90
NAMED_WAVES = 2
MIN_WAVE_SHARE = 0.1
# share of the whole curve's sum of squares that they must leave unexplained at most, or none is named
MAX_REST = 0.5
# turns from which a range of readings is none of a joint that turns, but a slide's, in mm
MAX_TURNS = 10
# points at which a curve is evaluated
POINTS = 1000


def measure_heights(terms: Sequence[Term], estimate: Array) -> dict[str, float]:
    """Measure, unit by unit, how far the highest point of a free function is above its lowest.

    Of several curves in one unit it is the largest; what is no plain curve, such as a spline times
    another cause, counts by its coefficients. `estimate`: (k,) of the terms."""
    curves: dict[tuple[str, tuple[int, str, str] | None], list[int]] = {}
    for number, term in enumerate(terms):
        place = _find_place(term)
        key = term.unit, place
        own = curves.setdefault(key, [])
        own.append(number)
    heights: dict[str, float] = {}
    for (unit, place), own in curves.items():
        values = estimate[own]
        if place is not None:
            some = [terms[number] for number in own]
            _, values = _draw_curve(some, values)
        height = float(np.ptp(values))
        largest = heights.get(unit, 0.0)
        heights[unit] = max(largest, height)
    return heights


def _find_place(term: Term) -> tuple[int, str, str] | None:
    """Find where a spline acts, and its driver; None for a term that is no plain spline."""
    screw = term.screws[0]
    cause = screw.cause
    if not isinstance(cause, Bump):
        return None
    return screw.frame, screw.axis, cause.name


def _draw_curve(terms: Sequence[Term], estimate: Array) -> tuple[Array, Array]:
    """Evaluate the curve of splines between the first and the last centre: (readings, values)."""
    causes = (term.screws[0].cause for term in terms)
    bumps = [(c, v) for c, v in zip(causes, estimate, strict=True) if isinstance(c, Bump)]
    centres = [bump.centre for bump, _ in bumps]
    grid = np.linspace(min(centres), max(centres), POINTS)
    curve = np.zeros(POINTS)
    for bump, value in bumps:
        curve += value * bump.shape(grid)
    return grid, curve


def find_waves(terms: Sequence[Term], estimate: Array) -> list[tuple[int, float]]:
    """Find (waves per turn, amplitude) of the two strongest waves of a free function that is mostly
    these; nothing of any other, nor of a slide's readings.

    They are found beyond a straight line, one after the other. A wave must repeat at least twice
    within the range, and explain a tenth of the rest."""
    grid, curve = _draw_curve(terms, estimate)
    turns = float(np.ptp(grid)) / (2 * np.pi)
    if not 0 < turns <= MAX_TURNS:
        return []
    fewest = max(1, int(np.ceil(2 / turns)))
    waves: list[tuple[int, float]] = []
    whole = curve - curve.mean()
    rest = whole
    for _ in range(NAMED_WAVES):
        before = _fit_waves(grid, rest, 0)[0]
        fits = [(*_fit_waves(grid, rest, k), k) for k in range(fewest, MAX_WAVES + 1)]
        left, beta, count = min(fits, key=lambda fitted: fitted[0])
        if before == 0 or left > (1 - MIN_WAVE_SHARE) * before:
            break
        waves.append((count, float(np.hypot(*beta[2:]))))
        rest = rest - np.column_stack([np.sin(count * grid), np.cos(count * grid)]) @ beta[2:]
    # waves of a few turns follow part of any smooth curve
    return waves if rest @ rest < MAX_REST * (whole @ whole) else []


def _fit_waves(grid: Array, curve: Array, count: int) -> tuple[float, Array]:
    """Fit a line, and a wave of `count` a turn unless that is 0: (sum of squares left, terms)."""
    X = np.column_stack([np.ones_like(grid), grid])
    if count:
        X = np.column_stack([X, np.sin(count * grid), np.cos(count * grid)])
    beta = np.asarray(np.linalg.lstsq(X, curve, rcond=None)[0], float)
    return float(np.square(curve - X @ beta).sum()), beta
