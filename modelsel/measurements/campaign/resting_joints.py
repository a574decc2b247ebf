"""Joints that rest while their encoders flicker: a difference of readings that is noise is no
motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..._typing import Array
from ...exceptions import sentence_list, write_rounded

FLICKER = (float(np.radians(0.1)), 0.1)  # rad, mm: a joint may rest whose readings stay within it
APART = 10.0  # by this factor the smallest motion is larger than the largest flicker
# flickers: of evenly spread motions the five smallest lie so far apart from the next once in
# 100,000 joints
FEWEST = 5


def find_resting_steps(step: Array, opening: NDArray[np.bool_], slides: bool) -> NDArray[np.bool_]:
    """Mask (v,) where a joint's reading changed by noise alone from the visit before: `step` (v,)
    [rad or mm], `opening` (v,) a group's first visit. A joint rests where its steps are of two
    kinds, a factor APART from each other, or all of the small kind, and readings of the small kind
    stay within FLICKER together, however long they last: a slow sweep does not."""
    limit = FLICKER[slides]
    size = np.abs(step)
    moved = np.sort(size[size > 0])
    gap = np.flatnonzero(np.append(moved[1:], np.inf) >= APART * moved) + 1  # so many flickers
    for count in gap[(gap >= FEWEST) & (moved[gap - 1] < limit)][::-1]:
        still: NDArray[np.bool_] = (size > 0) & (size <= moved[count - 1])
        if _span(step, (size > moved[count - 1]) | opening) < limit:
            return still
    return np.zeros(len(step), bool)


def _span(step: Array, begins: NDArray[np.bool_]) -> float:
    """Find the largest range of the readings between one motion and the next."""
    if not len(step):
        return 0.0
    run = np.cumsum(begins)
    before = run[0] - 1
    run_step = np.diff(run, prepend=before)
    order = np.flatnonzero(run_step)
    rest = np.where(begins, 0.0, step)
    place = np.cumsum(rest)
    highest = np.maximum.reduceat(place, order)
    lowest = np.minimum.reduceat(place, order)
    ranges = highest - lowest
    largest = ranges.max()
    return float(largest)


def describe_resting_joints(rest: Array, prismatic: Sequence[bool]) -> str | None:
    """Describe the largest flicker (n,) of each joint, 0 where it has none; None where no joint
    rests."""
    each = []
    for j, size in enumerate(rest.tolist(), 1):
        slides = bool(prismatic[j - 1]) if j <= len(prismatic) else False
        if size > 0:
            each.append(
                f"joint {j} (at most {write_rounded(size, 2)} mm)"
                if slides
                else f"joint {j} (at most {write_rounded(np.degrees(size), 2)} deg)"
            )
    if not each:
        return None
    return (
        f"Between some configurations {sentence_list(each)} did not move, and the reading only flickered: no "
        "direction of approach and no size of a move is taken from that."
    )
