"""Stretches of a campaign: rows that follow one another along one line in joint space, as those of an arm
that is measured while it moves on do."""

from __future__ import annotations

import numpy as np

from .._linalg import TINY
from .._typing import Array, Index, Mask
from .measurements import Measurements

# of a step from visit to visit, by how much the next one may differ where both are of one line
SMOOTH = 0.25
# visits from which a line is one, and share of the rows that lines have to have
FEWEST_VISITS, LEAST_SHARE = 4, 0.5


def number_stretches(data: Measurements) -> Index | None:
    """Number the line (m,) that every row is of, each row by itself where it is of none; None where most rows
    are of none, or the order of motion is not known."""
    if data.path is None or data.on_path is None:
        return None
    path = data.path
    continues = _find_continuing(path.steps, path.opens)
    stretch = np.cumsum(~continues) - 1
    visits = np.bincount(stretch)
    of_row = stretch[data.on_path]
    on_line = visits[of_row] >= FEWEST_VISITS
    if on_line.mean() < LEAST_SHARE:
        return None
    # postures measured from elsewhere keep numbers of their own
    alone = len(visits) + data.block
    label = np.where(on_line, of_row, alone)
    _, number = np.unique(label, return_inverse=True)
    return number.reshape(-1)


def measure_row_steps(data: Measurements) -> Array:
    """Measure how far every motor went from row to row along the line that a row (m, n) is of, rad or mm: the
    mean of the steps to it and from it; 0 where it is of none. The order of motion has to be known."""
    assert data.path is not None
    steps = data.path.steps
    continues = _find_continuing(steps, data.path.opens)
    along = np.where(continues[:, None], steps, 0.0)
    onward, further = np.zeros_like(along), np.zeros(len(along), bool)
    onward[:-1], further[:-1] = along[1:], continues[1:]
    count = np.maximum(continues + further.astype(float), 1.0)
    means = (along + onward) / count[:, None]
    return np.asarray(means[data.on_path])


def _find_continuing(steps: Array, opens: Mask) -> Mask:
    """Find the visits (v,) that the arm came to along the line of the one before: by a step (v, n) that is about
    the one before it, or the next."""
    size = np.abs(steps)
    spread = size.max(axis=0)
    scaled = steps / np.maximum(spread, TINY)
    length = np.linalg.norm(scaled, axis=1)
    turns = np.diff(scaled, axis=0)
    change = np.linalg.norm(turns, axis=1)
    before, after = length[:-1], length[1:]
    longer = np.maximum(before, after)
    is_like = change <= SMOOTH * longer
    # a visit where the arm stays is no motion, and a group's first visit has none before it
    is_like &= after > 0
    is_like &= ~opens[1:]
    is_like &= ~opens[:-1]
    continues = np.zeros(len(steps), bool)
    continues[1:] |= is_like
    continues[:-1] |= is_like
    continues &= ~opens
    return continues
