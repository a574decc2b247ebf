"""The rows that a calibration was estimated from, known again by where the target was measured: in
any format, order or unit, and beside others.

A position is known by its cell of a grid of 1 µm, of which a hash is kept. Cells begin at an
irrational part of their width, where no decimal number lies; a position that was rounded to
micrometres is looked for in the cells that it may come from."""

from __future__ import annotations

import base64
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import NDArray

from .._hashing import HASH_FACTOR
from .._typing import Array
from ..exceptions import count_words
from ..measurements.measurements import Measurements

Codes = NDArray[np.uint64]

CELL_MM = 1e-3
FIRST_CELL = (np.sqrt(5) - 1) / 2  # where cells begin, in cells
HALF_BITS = np.uint64(32)
STORED_TYPE = np.dtype("<u8")
# of more rows those with the smallest hashes are kept: a share of them, drawn evenly
MAX_KEPT = 50_000
# steps in which positions may be written [mm], the widest first
STEPS_MM = (10.0, 1.0, 0.1, 0.01)
# of a step: what a position may lie beside it
STEP_TOLERANCE = 1e-6
# a density of the difference of two measurements at zero is 1 / (this times their deviation)
DENSITY_FACTOR = np.sqrt(4 * np.pi)
# standard deviations by which rows that agree by chance are exceeded
MIN_EXCESS = 3.0


@dataclass(frozen=True, eq=False)
class EstimationRows:
    """The `count` rows that models were fitted to, by the hashes (k,) of their positions, in order:
    all of them, or the smallest MAX_KEPT; none in files of earlier versions."""

    count: int = 0
    codes: Codes = field(default_factory=lambda: np.zeros(0, np.uint64))

    @classmethod
    def of(cls, position: Array) -> EstimationRows:
        """The rows of positions (m, 3) [mm]."""
        is_whole = np.isfinite(position).all(1)
        whole = position[is_whole]
        codes = _code_positions(whole)
        ordered = np.unique(codes)
        return cls(len(whole), ordered[:MAX_KEPT])

    @classmethod
    def from_text(cls, count: int, text: str) -> EstimationRows:
        """Read the codes of a file. Raises ValueError."""
        stored = base64.b64decode(text, validate=True)
        numbers = np.frombuffer(stored, STORED_TYPE)
        codes = numbers.astype(np.uint64)
        return cls(count, codes)

    @property
    def text(self) -> str:
        """The codes as text."""
        stored = self.codes.astype(STORED_TYPE)
        content = stored.tobytes()
        text = base64.b64encode(content)
        return text.decode()

    def count_among(self, position: Array) -> int:
        """Count the positions (m, 3) [mm] that are of these rows; where not all are kept, the number
        that is expected."""
        if not len(self.codes):
            return 0
        is_whole = np.isfinite(position).all(1)
        whole = position[is_whole]
        is_found = np.zeros(len(whole), bool)
        half = CELL_MM / 2
        for shift in product((-half, half), repeat=3):
            codes = _code_positions(whole + shift)
            is_found |= np.isin(codes, self.codes)
        matched = int(is_found.sum())
        if len(self.codes) < MAX_KEPT:
            return matched
        expected = matched * self.count / MAX_KEPT
        return min(round(expected), len(position))


def _code_positions(position: Array) -> Codes:
    """Hash the cells of positions (m, 3) [mm], each row to one number (m,)."""
    cells = np.floor(position / CELL_MM + FIRST_CELL)
    numbers = cells.astype(np.int64)
    code = np.zeros(len(numbers), np.uint64)
    for column in numbers.T:
        bits = column.astype(np.uint64)
        mixed = (code ^ bits) * HASH_FACTOR
        code = mixed ^ (mixed >> HALF_BITS)
    return code


def count_own_rows(rows: EstimationRows, data: Measurements, noise_mm: float) -> int:
    """Count the rows of new data that a calibration was estimated from; none where only as many
    agree as do by chance when its configurations are measured again, with noise of `noise_mm` a
    coordinate and positions as coarse as these are."""
    position = data.position
    total = len(position)
    matched = rows.count_among(position)
    if not matched or matched == total:
        return matched
    width = max(_find_step(position), 2 * CELL_MM)
    share = 1.0
    if noise_mm > 0:
        of_coordinate = width / (DENSITY_FACTOR * noise_mm)
        share = min(of_coordinate, 1.0) ** 3
    expected = total * share
    deviation = np.sqrt(expected)
    limit = expected + MIN_EXCESS * deviation
    if matched <= limit:
        return 0
    return matched


def _find_step(position: Array) -> float:
    """Find the step [mm] in which whole positions are written; 0 where it is fine."""
    for step in STEPS_MM:
        steps = position / step
        excess = steps - np.round(steps)
        if np.abs(excess).max() < STEP_TOLERANCE:
            return step
    return 0.0


def describe_own_rows(rows: EstimationRows, own: int, total: int) -> str:
    """Say that `own` of `total` rows are those that a calibration was estimated from."""
    estimated = f"it was estimated from {count_words(rows.count, 'row')}"
    if own == total:
        return (
            f"These are the measurements that made the calibration ({estimated}), so they cannot "
            "contradict it: measure new configurations to learn whether it still holds."
        )
    verb = "is one of the measurements" if own == 1 else "are measurements"
    they = "it" if own == 1 else "they"
    others = total - own
    rest = "other row has" if others == 1 else f"other {others:,} rows have"
    those = "that one" if others == 1 else "those"
    return (
        f"{own:,} of the {total:,} rows {verb} that made the calibration ({estimated}), so {they} "
        f"cannot contradict it. The {rest} no part in it: judge by {those}, or measure new "
        "configurations."
    )
