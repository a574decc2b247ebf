"""How far commands are off where an error is not on the side of arm and instrument that is fitted."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..._typing import Array
from ...fitting.problem import Problem
from ..prediction import compute_sensitivities

if TYPE_CHECKING:
    from ..calibration import Calibration


def count_other_sides(c: Calibration, at: Problem) -> Array:
    """Count the variance (m,) [mm²] that each row of commands has to reckon with, since a fitted mechanism
    may be an error of the other side: the square of the instrument's error there as often as that is so.

    Where that depends on a column that the commands do not have, its square at the fitted rows."""
    variance = np.zeros(len(at))
    known = at.names()
    for other in c.other_sides.values():
        if not known.keys() >= other.instrument.names():
            variance += other.share * other.rms_mm**2
            continue
        estimate = np.array(other.estimate)
        terms = other.instrument.terms
        moved = compute_sensitivities(c, at, terms, estimate[:, None])
        square = np.square(moved[:, :3, 0])
        variance += other.share * square.sum(1)
    return variance
