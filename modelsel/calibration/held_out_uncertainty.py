"""How surely a calibrated robot knew where its target was in the study's held-out rows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..selection.evaluation import Split
from .prediction import propagate_uncertainty

if TYPE_CHECKING:
    from .calibration import Calibration

# of more rows every second, third, ... is taken
MAX_ROWS = 1000


def measure_held_out_uncertainty(c: Calibration, split: Split) -> float | None:
    """Measure the model's own standard uncertainty (length, root mean square) [mm] at the held-out
    rows, outliers left out; None without such rows, or where rows are no points."""
    is_held_out = ~split.estimation & ~split.outlying
    rows = np.flatnonzero(is_held_out)
    if not len(rows) or not split.problem.only_points:
        return None
    step = -(-len(rows) // MAX_ROWS)
    problem = split.problem.take(rows[::step])
    spread = propagate_uncertainty(c, problem)
    squares = np.square(spread)
    mean_square = squares.sum((1, 2)).mean()
    return float(np.sqrt(mean_square))
