"""Rows whose positions stand in each other's place."""

from __future__ import annotations

import numpy as np

from ..._typing import Array, Index, Mask

# rows that are matched with each other at most: of more, every position has a reading that it fits
MOST_ROWS = 1000


def match_rows(measured: Array, predicted: Array, near: float) -> tuple[Index, Mask]:
    """Find for every position (k, 3) the other row with the nearest prediction (k, 3).

    Returns those rows (k,), and whether (k,) the prediction is within `near` [mm]."""
    distance = np.linalg.norm(measured[:, None] - predicted[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    partner = distance.argmin(1)
    apart = np.linalg.norm(measured - predicted[partner], axis=1)
    return np.asarray(partner, dtype=np.intp), np.asarray(apart < near)


def put_back_exchanged(measured: Array, predicted: Array, near: float) -> Array:
    """Put positions (k, 3) that stand in each other's place beside their own readings, which have them
    predicted (k, 3) within `near` [mm]; others stay where they are.

    Of two rows each has the other's position, of more each that of one other. Where a position is
    lost, as of rows that all have the one of the row before, nothing is put back."""
    count = len(measured)
    if not 2 <= count <= MOST_ROWS:
        return measured
    partner, is_exchanged = match_rows(measured, predicted, near)
    while True:
        # a row stays where exactly one position comes to it that is put back, too
        coming = np.bincount(partner[is_exchanged], minlength=count)
        still = is_exchanged & (coming == 1) & is_exchanged[partner]
        if (still == is_exchanged).all():
            break
        is_exchanged = still
    put_back = measured.copy()
    put_back[partner[is_exchanged]] = measured[is_exchanged]
    return put_back
