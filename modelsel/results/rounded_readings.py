"""How coarsely the joint readings of a file are rounded, and what that alone leaves of a joint."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._typing import Array
from ..measurements.measurements import Measurements

# steps of a reading in the unit of its column, the coarsest first
STEPS = {
    "deg": (1.0, 0.5, 0.1, 0.05, 0.01, 0.001),
    "rad": (0.01, 0.001, 1e-4, 1e-5),
    "mm": (1.0, 0.5, 0.1, 0.05, 0.01, 0.001),
    "m": (0.01, 0.001, 1e-4, 1e-5),
}
# of a column's unit in rad or mm, and how it is written
FACTORS = {"deg": np.pi / 180, "rad": 1.0, "mm": 1.0, "m": 1e3}
SYMBOLS = {"deg": "°", "rad": " rad", "mm": " mm", "m": " m"}
# share of a step up to which a reading is a multiple of it
MULTIPLE = 1e-4
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

    Empty where motors are coupled: the readings are not the joints'."""
    if data.coupling is not None:
        return {}
    found = {}
    for j, readings in enumerate(data.readings.T):
        unit = data.units[j] if data.units else _choose_unit(data, j)
        values = readings / FACTORS[unit]
        step = _find_step(values, STEPS[unit])
        if step is not None:
            scale = step * FACTORS[unit] / np.sqrt(12)
            found[f"joint {j + 1}"] = Rounding(f"{step:g}{SYMBOLS[unit]}", float(scale))
    return found


def _choose_unit(data: Measurements, joint: int) -> str:
    slides = data.prismatic[joint] if data.prismatic else False
    return "mm" if slides else "rad"


def _find_step(values: Array, steps: tuple[float, ...]) -> float | None:
    for step in steps:
        # of very many readings the first tell most that are no multiples
        if not _are_multiples(values[:FIRST], step) or not _are_multiples(values, step):
            continue
        distinct = len(np.unique(values.round(9)))
        return step if distinct >= FEWEST_READINGS else None
    return None


def _are_multiples(values: Array, step: float) -> bool:
    multiples = values / step
    apart = np.abs(multiples - multiples.round())
    return bool(apart.max() < MULTIPLE)
