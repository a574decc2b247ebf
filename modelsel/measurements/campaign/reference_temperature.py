"""Reference temperature from which thermal effects are counted."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

TEMPERATURE = "temperature_C"
REFERENCE = 20.0  # °C: ISO 1


def choose_reference(covariates: Mapping[str, NDArray[np.float64]]) -> float:
    """Choose a reference [°C]: 20 (ISO 1), but the mean in whole degrees of a campaign that never was as warm, or never
    as cold: what an arm does beyond what was seen is a guess, and nothing is counted from there."""
    seen = covariates.get(TEMPERATURE)
    if (
        seen is None
        or not len(seen)
        or seen.min() <= REFERENCE <= seen.max()
        or not np.isfinite(seen).all()
    ):
        return REFERENCE
    return float(np.round(seen.mean()))
