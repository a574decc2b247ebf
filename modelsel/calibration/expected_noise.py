"""The noise that new data of a calibrated arm should show."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .._typing import Array
from ..exceptions import write_rounded
from ..fitting.noise_check import name_likeliest_mistake
from ..measurements.quantities.columns import MIN_UNCERTAINTY

if TYPE_CHECKING:
    from .calibration import Calibration

# of the errors to those expected, from which more than noise is seen
MIN_FACTOR = 1.1
STATED_KEYS = "floor_mm or sx_mm, sy_mm, sz_mm of its study"
# a stated uncertainty is not believed above so many times what the study's own held-out
# configurations showed
MAX_OVERSTATEMENT = 3.0


def expect_noise(c: Calibration, spread: Array) -> tuple[float, float]:
    """Return the standard deviation [mm] of one coordinate that new data should show beside the
    parameters' uncertainty, and its degrees of freedom.

    The noise floor, or what the study's own held-out configurations showed where that is clearly more,
    or where it contradicts a stated floor. Their errors have the parameters' uncertainty in them, which
    is taken out. Files of earlier versions lack what it was there; it is taken for what it is at the
    new rows, where its factors are `spread` (m, 3, r) [mm].
    """
    freedom = c.floor.freedom
    sigma = c.floor.coordinate_mm
    shown = _measure_held_out(c)
    if is_overstated(c):
        return max(shown, MIN_UNCERTAINTY), freedom
    parameters = _measure_parameters(c, spread)
    left = shown**2 - parameters
    noise = max(left, 0.0)
    held_out = float(np.sqrt(noise))
    if held_out > MIN_FACTOR * sigma:
        sigma = held_out
    return max(sigma, MIN_UNCERTAINTY), freedom


def _measure_parameters(c: Calibration, spread: Array) -> float:
    """Return the variance [mm²] that the parameters' uncertainty adds to a held-out coordinate."""
    known = c.held_out_model_mm
    if known is not None:
        return known**2 / 3
    squares = np.square(spread)
    mean = squares.sum() / (3 * len(spread))
    return float(mean)


def describe_other_noise(c: Calibration, sigma: float) -> list[str]:
    """Say that errors are expected with another noise, `sigma` [mm], than the study states."""
    stated = c.floor.coordinate_mm
    if not np.isinf(c.floor.freedom) or np.isclose(sigma, max(stated, MIN_UNCERTAINTY)):
        return []
    shown = write_rounded(sigma, 2)
    sentence = (
        f"the expected errors hold a noise of {shown} mm per coordinate, as the study's held-out "
        f"configurations showed it, and not the stated {write_rounded(stated, 2)} mm."
    )
    return [sentence]


def _measure_held_out(c: Calibration) -> float:
    """Return the standard deviation [mm] of one held-out coordinate; zero where none is known."""
    rms = c.held_out_rms_mm
    if rms is None:
        return 0.0
    noise = rms / np.sqrt(3)
    return float(noise)


def is_overstated(c: Calibration) -> bool:
    """Whether the study's own held-out configurations contradict its stated noise."""
    if not np.isinf(c.floor.freedom):
        return False
    held_out = _measure_held_out(c)
    believed = MAX_OVERSTATEMENT * held_out
    stated = c.floor.coordinate_mm
    return held_out > 0 and stated > believed


def describe_overstatement(c: Calibration) -> str:
    """Say that the study's own held-out configurations contradict its stated noise."""
    stated = c.floor.coordinate_mm
    held_out = _measure_held_out(c)
    ratio = stated / held_out
    mistake = name_likeliest_mistake(ratio, STATED_KEYS)
    return (
        f"The calibration's stated uncertainty of one coordinate ({write_rounded(stated)} mm) is {write_rounded(ratio)} times"
        f" what its own held-out configurations showed ({write_rounded(held_out)} mm), which is expected here instead. "
        f"{mistake}"
    )
