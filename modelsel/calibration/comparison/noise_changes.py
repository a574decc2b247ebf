"""Whether the noise of one coordinate changed between two campaigns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...fitting.noise import Floor
from ...fitting.noise_check import lack
from ..expected_noise import MIN_FACTOR


@dataclass(frozen=True)
class NoiseChange:
    """The noise [mm] of one coordinate in both campaigns, where chance does not explain that it
    differs."""

    before_mm: float
    after_mm: float


def find_noise_change(before: Floor, after: Floor) -> NoiseChange | None:
    """Compare the noise of two campaigns by an F test; None where it is alike, or one is stated."""
    is_measured = np.isfinite([before.freedom, after.freedom])
    if not is_measured.all():
        return None
    ratio = after.coordinate_mm / before.coordinate_mm
    found = lack(before, ratio, after.freedom)
    if not found.outside or max(ratio, 1 / ratio) < MIN_FACTOR:
        return None
    return NoiseChange(before.coordinate_mm, after.coordinate_mm)
