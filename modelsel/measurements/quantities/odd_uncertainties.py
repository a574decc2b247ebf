"""Stated uncertainties of which one column is out of line with the other two."""

from __future__ import annotations

import numpy as np

from ..._typing import Array
from ...exceptions import write_rounded
from ...notices import Note
from .contract_columns import ROTATION_UNCERTAINTY_COLUMNS, UNCERTAINTY_COLUMNS

# times the geometric mean of the other two from which a column is not believed, up or down: a camera's
# depth is ten times as uncertain as what is across, seldom thirty
ODD = 50.0
# times up to which these two are alike
ALIKE = 10.0
# the unit of a column, and what stands there instead, by about how many times too large that is
UNITS = {
    "mm": {1e3: "micrometres", 1e-3: "metres"},
    "rad": {180 / np.pi: "degrees", 1e3: "milliradians", 1e6: "microradians"},
}
NEAR = 5.0


def note_odd_uncertainties(sigma: Array | None, sigma_rotation: Array | None) -> list[Note]:
    """Return notes on the column of a set whose median is far from those of the other two.

    `sigma`: of positions (m, 3) [mm]; `sigma_rotation`: of orientations (m, 3) [rad]; None where they are
    not stated."""
    sets = [
        (sigma, UNCERTAINTY_COLUMNS, "mm"),
        (sigma_rotation, ROTATION_UNCERTAINTY_COLUMNS, "rad"),
    ]
    return [
        note
        for values, names, unit in sets
        if values is not None
        for note in _find_odd(np.median(values, axis=0), names, unit)
    ]


def _find_odd(median: Array, names: tuple[str, ...], unit: str) -> list[Note]:
    notes = []
    for k, name in enumerate(names):
        others = np.delete(median, k)
        typical = float(np.sqrt(others.prod()))
        ratio = float(median[k]) / typical
        are_alike = others.max() <= ALIKE * others.min()
        if are_alike and not 1 / ODD < ratio < ODD:
            notes.append(_describe(name, median[k], typical, ratio, unit))
    return notes


def _describe(name: str, own: float, typical: float, ratio: float, unit: str) -> Note:
    factor = write_rounded(max(ratio, 1 / ratio), 2)
    much = f"{factor} times larger than" if ratio > 1 else f"{factor} times smaller than"
    likely = [
        f"Most likely they are in {other}. "
        for times, other in UNITS[unit].items()
        if 1 / NEAR < ratio / times < NEAR
    ]
    return Note(
        "stated-uncertainty",
        f"{name}: its standard uncertainties (median {write_rounded(own, 2)} {unit}) are {much} "
        f"those of the other two coordinates ({write_rounded(typical, 2)} {unit}), and decide how much each "
        f"coordinate counts. {''.join(likely[:1])}Correct the column, or leave the uncertainties out.",
    )
