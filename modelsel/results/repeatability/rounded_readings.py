"""How coarsely the joint readings of a file are rounded, and what that alone leaves of a joint."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..._typing import Array
from ...measurements.measurements import Measurements

# steps of a reading in the unit of its column, the coarsest first
STEPS = {
    "deg": (1.0, 0.5, 0.25, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001),
    "rad": (0.01, 0.005, 0.002, 0.001, 5e-4, 2e-4, 1e-4, 1e-5),
    "mm": (1.0, 0.5, 0.25, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001),
    "m": (0.01, 0.005, 0.002, 0.001, 5e-4, 2e-4, 1e-4, 1e-5),
}
# of a column's unit in rad or mm, and how it is written
FACTORS = {"deg": np.pi / 180, "rad": 1.0, "mm": 1.0, "m": 1e3}
SYMBOLS = {"deg": "°", "rad": " rad", "mm": " mm", "m": " m"}
# units of a column, each with those that its readings may have been rounded in: a controller shows
# degrees, and its file has radians
ROUNDED_IN = {"deg": ("deg", "rad"), "rad": ("rad", "deg"), "mm": ("mm",), "m": ("m",)}
# share of a step up to which a reading is a multiple of it
MULTIPLE = 1e-4
# the same at most where a column's own digits leave it open: twenty readings at random would all be
# within it once in 1e20 files
MOST_OPEN = 0.05
# digits after the point that a column has at most
MOST_DIGITS = 12
# different readings from which they are a measurement's, and not a few commanded ones
FEWEST_READINGS = 20
# readings that are looked at before all
FIRST = 100


class Rounding(NamedTuple):
    """The step of a joint's readings, in words, and its standard deviation [rad or mm]: uniform within a
    step, its root of a twelfth."""

    step: str
    scale: float


def find_rounding(data: Measurements) -> dict[str, Rounding]:
    """Find the joints whose readings are all multiples of a coarse step: "joint 2" and its rounding.

    A column in radians may hold multiples of a degree's share, and one in degrees of a radian's: the
    coarsest step counts. Empty where motors are coupled: the readings are not the joints'."""
    if data.coupling is not None:
        return {}
    found = {}
    for j, readings in enumerate(data.readings.T):
        unit = data.units[j] if data.units else _choose_unit(data, j)
        steps = [_find_rounding_in(other, readings, unit) for other in ROUNDED_IN[unit]]
        known = [step for step in steps if step is not None]
        if known:
            found[f"joint {j + 1}"] = max(known, key=lambda rounding: rounding.scale)
    return found


def _find_rounding_in(unit: str, readings: Array, given: str) -> Rounding | None:
    """Find the step in a unit of readings [rad or mm] whose column is `given` in another or the same."""
    factor = FACTORS[unit]
    open_by_digits = 0.0
    if unit != given:
        open_by_digits = _find_resolution(readings / FACTORS[given]) * FACTORS[given] / 2
    step = _find_step(readings / factor, STEPS[unit], open_by_digits / factor)
    if step is None:
        return None
    scale = step * factor / np.sqrt(12)
    return Rounding(f"{step:g}{SYMBOLS[unit]}", float(scale))


def _find_resolution(values: Array) -> float:
    """Find the last decimal place that values have; 0 where they have them all."""
    for digits in range(MOST_DIGITS):
        place = float(10**-digits)
        if _are_multiples(values[:FIRST], place) and _are_multiples(values, place):
            return place
    return 0.0


def _choose_unit(data: Measurements, joint: int) -> str:
    slides = data.prismatic[joint] if data.prismatic else False
    return "mm" if slides else "rad"


def _find_step(values: Array, steps: tuple[float, ...], open_by_digits: float) -> float | None:
    for step in steps:
        share = MULTIPLE + open_by_digits / step
        if share > MOST_OPEN:
            break
        # of very many readings the first tell most that are no multiples
        if not _are_multiples(values[:FIRST], step, share):
            continue
        if not _are_multiples(values, step, share):
            continue
        distinct = len(np.unique(values.round(9)))
        return step if distinct >= FEWEST_READINGS else None
    return None


def _are_multiples(values: Array, step: float, share: float = MULTIPLE) -> bool:
    multiples = values / step
    apart = np.abs(multiples - multiples.round())
    return bool(apart.max() < share)
