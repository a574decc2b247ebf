"""How surely a calibrated robot knew where its target was in the study's held-out rows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .._typing import Index
from ..selection.evaluation import Split
from .prediction import propagate_uncertainty

if TYPE_CHECKING:
    from .calibration import Calibration

# of more rows so many are taken, about
MAX_ROWS = 1000


def measure_held_out_uncertainty(c: Calibration, split: Split) -> float | None:
    """Measure the model's own standard uncertainty (length, root mean square) [mm] at the held-out
    rows, outliers left out; None without such rows, or where rows are no points."""
    is_held_out = ~split.estimation & ~split.outlying
    rows = np.flatnonzero(is_held_out)
    problem = split.problem
    if not len(rows):
        return None
    if not problem.only_points:
        return None
    configuration = problem.data.configuration
    drawn = _draw_rows(rows, configuration)
    some = problem.take(drawn)
    spread = propagate_uncertainty(c, some)
    squares = np.square(spread)
    mean_square = squares.sum((1, 2)).mean()
    return float(np.sqrt(mean_square))


def _draw_rows(rows: Index, configuration: Index) -> Index:
    """Draw configurations, always the same, with all their rows, so that MAX_ROWS are left, about: a
    step from row to row would keep in step with targets, or with loads that take turns."""
    if len(rows) <= MAX_ROWS:
        return rows
    own = configuration[rows]
    distinct = np.unique(own)
    share = MAX_ROWS / len(rows)
    count = max(round(share * len(distinct)), 1)
    stream = np.random.default_rng(0)
    drawn = stream.choice(distinct, count, replace=False)
    return rows[np.isin(own, drawn)]
