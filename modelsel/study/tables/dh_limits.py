"""Limits of the joints in a table of DH parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..._typing import Array
from ...measurements.formats.row_places import Where

# degrees or radians: a joint turns by less than four turns
MOST_RADIANS = 8 * np.pi
FACTORS = {"degrees": 1.0, "radians": 180 / np.pi, "mm": 1.0, "m": 1e3}


def combine_limits(
    low: Array,
    high: Array,
    units: tuple[str | None, str | None],
    slides: Sequence[bool],
    senses: Array,
    where: Where,
) -> list[list[float]]:
    """Combine columns of least and greatest readings (m,) into limits of the joints' own values, in
    degrees or mm. A joint that counts the other way has them the other way. Raises DataError."""
    limits = []
    for row, is_slide in enumerate(slides):
        ends = [
            _convert(column[row], unit, is_slide, max(abs(low).max(), abs(high).max()))
            for column, unit in zip((low, high), units, strict=True)
        ]
        if not ends[0] < ends[1]:
            raise where.refuse(
                f"the least reading of a joint, {low[row]:g}, is not below the greatest, "
                f"{high[row]:g}.",
                row=row,
                remedy="Correct the two limits.",
            )
        sense = float(senses[row])
        own = [sense * end for end in ends]
        own.sort()
        limits.append(own)
    return limits


def _convert(value: float, unit: str | None, is_slide: bool, largest: float) -> float:
    """Convert a limit to degrees or mm."""
    if unit is None:
        unit = "mm" if is_slide else "radians" if largest < MOST_RADIANS else "degrees"
    return float(value) * FACTORS[unit]
