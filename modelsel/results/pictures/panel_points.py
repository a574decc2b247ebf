"""Points and curve of a finding's panel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..._typing import Array, Index

# points of a panel
MAX_POINTS = 240
CURVE_POINTS = 160

Values = dict[str, Any]


@dataclass(frozen=True, eq=False)
class PanelPoints:
    """Points and curve of a panel: x, the residual with the effect left in and taken out, the points' weights."""

    x: Array
    before: Array
    after: Array
    weight: Array
    grid: Array
    curve: Array

    def describe(self) -> Values:
        """Return the panel's numbers, five digits each."""
        return {
            "x": _shorten(self.x),
            "before": _shorten(self.before),
            "after": _shorten(self.after),
            "weight": _shorten(self.weight),
            "curve": [_shorten(self.grid), _shorten(self.curve)],
        }


def select_points(mask: Array) -> Index | None:
    """Return at most MAX_POINTS rows of a mask, evenly spread; None of fewer than two."""
    rows = np.flatnonzero(mask)
    count = len(rows)
    if count < 2:
        return None
    steps = np.linspace(0, count - 1, min(count, MAX_POINTS))
    places = np.unique(steps.astype(int))
    chosen: Index = rows[places]
    return chosen


def _shorten(values: Array) -> list[float]:
    """Return values with five digits."""
    return [float(f"{value:.5g}") for value in values]
