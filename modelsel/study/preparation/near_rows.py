"""Rows that say less than as many others: held-out ones beside estimation rows of one path, and postures
that the arm came back to."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..._typing import Array, Index
from ...exceptions import count_words, write_percent
from ...measurements.campaign.near_readings import describe_returns
from ...measurements.campaign.visits import SAME_READING
from ...measurements.measurements import Measurements
from ...notices import Note

# configurations of either kind from which distances say something
FEWEST_ESTIMATION, FEWEST_HELD_OUT = 20, 5
# configurations whose nearest others are sought, and those of a campaign of very many
MOST_ASKED, FEWEST_ASKED = 300, 50
# pairs of configurations that are compared in all, but for the fewest
MOST_PAIRS = 30_000_000
# share of its largest reading by which a joint that rests varies
RESTS = 1e-9
# numbers that are compared at a time
COMPARED = 3_000_000
# share of the campaign around a configuration whose configurations may be of the same path
SAME_PATH = 0.1
# of the distance to other paths, below which held-out configurations are near
NEAR = 0.2


def note_near_rows(data: Measurements, estimation: NDArray[np.bool_]) -> list[Note]:
    """Note held-out configurations that are much nearer to estimation rows of the same path than to those
    of other paths; estimation: mask (m,) of the rows that fit."""
    share = _compare_distances(data, estimation)
    if share is None or share >= NEAR:
        return []
    written = write_percent(share, 1)
    sentence = (
        "Held-out configurations lie between estimation configurations of the same paths, at "
        f"{written} of the distance (median) at which other paths pass. Their error says what the model is worth "
        "on these paths, and may be too good for others: say in a column which rows estimate, by whole paths, "
        "and name it in split.column."
    )
    return [Note("held-out-near", sentence)]


def note_returns(data: Measurements, estimation: NDArray[np.bool_] | None = None) -> list[Note]:
    """Note configurations that are taken as repeats of a posture though their readings differ, and such
    postures on both sides of a split; `estimation`: mask (m,) of the rows that fit."""
    _, first = np.unique(data.configuration, return_index=True)
    readings, posture = data.q[first], data.block[first]
    sentence = describe_returns(readings, posture, data.prismatic, SAME_READING)
    if sentence is None:
        return []
    notes = [Note("postures-repeated", sentence)]
    fits = np.ones(len(data), bool) if estimation is None else estimation
    torn = np.intersect1d(data.block[fits], data.block[~fits])
    if len(torn):
        count = count_words(len(torn), "posture")
        notes.append(
            Note(
                "held-out-near",
                f"{count} of the estimation rows came back among the held-out ones, as the split's column has it: "
                "the held-out error says nothing of other postures.",
            )
        )
    return notes


def _compare_distances(data: Measurements, estimation: NDArray[np.bool_]) -> float | None:
    """Compare the distances in joints from held-out to estimation configurations with those to such as
    are far apart in the campaign: ratio of medians; None of few."""
    _, first = np.unique(data.configuration, return_index=True)
    fits = first[estimation[first]]
    held = first[~estimation[first]]
    if len(fits) < FEWEST_ESTIMATION or len(held) < FEWEST_HELD_OUT:
        return None
    spread = data.q[fits].std(axis=0)
    moves = spread > RESTS * np.abs(data.q).max(axis=0)
    scaled = data.q[:, moves] / spread[moves]
    beside = _measure_nearest(scaled, held, fits, data.progress, 0.0)
    apart = _measure_nearest(scaled, held, fits, data.progress, SAME_PATH)
    if not np.isfinite(apart) or not apart:
        return None
    return beside / apart


def _measure_nearest(q: Array, rows: Index, others: Index, progress: Array, apart: float) -> float:
    """Measure the median distance from rows, of many some, to the nearest of other rows that are at least
    so far `apart` in the campaign."""
    asked = min(MOST_ASKED, max(MOST_PAIRS // len(others), FEWEST_ASKED))
    step = -(-len(rows) // asked)
    some = rows[::step]
    together = max(COMPARED // len(others), 1)
    nearest = [
        _find_nearest(q, some[start : start + together], others, progress, apart)
        for start in range(0, len(some), together)
    ]
    return float(np.median(np.concatenate(nearest)))


def _find_nearest(q: Array, rows: Index, others: Index, progress: Array, apart: float) -> Array:
    """Compute the distance (k,) of every row to the nearest of the others that are far apart."""
    shape = len(rows), len(others)
    square = np.zeros(shape)
    for readings in q.T:
        difference = np.subtract.outer(readings[rows], readings[others])
        square += difference**2
    between = np.subtract.outer(progress[rows], progress[others])
    is_near = np.abs(between) < apart
    square[is_near] = np.inf
    nearest = square.min(axis=1)
    return np.asarray(np.sqrt(nearest))
