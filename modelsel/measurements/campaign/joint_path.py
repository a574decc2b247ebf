"""The way of the arm from visit to visit, and what a joint drags along on it: hysteresis that
remembers."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._typing import Array

# numbers that are kept
KEPT_NUMBERS = 2_000_000
# blocks of v visits, as a multiple of √v: a step of all blocks takes longer than one of one block
BLOCKS = 4


@dataclass(frozen=True, eq=False)
class JointPath:
    """How the joints (coupled: the motors) moved from visit to visit, waypoints too, in order of
    motion: `steps` (v, n) signed motion that led to each visit, rad or mm, 0 where `opens` (v,) has a
    group's first visit. Selections of rows share it."""

    steps: Array
    opens: NDArray[np.bool_]
    _leads: dict[tuple[int, float], Array] = field(default_factory=dict, repr=False)

    def lead(self, joint: int, width: float) -> Array:
        """Return how far a joint (from 1) is ahead of what it drags along (v,), at most `width` to
        either side: the stop operator of its motion, 0 at a group's first visit."""
        key = joint, width
        known = self._leads
        lead = known.get(key)
        if lead is None:
            column = joint - 1
            own = self.steps[:, column]
            lead = compute_stop(own, self.opens, width)
            self._keep(key, lead)
        return lead

    def _keep(self, key: tuple[int, float], lead: Array) -> None:
        """Keep what was computed, and forget the oldest where that is much."""
        known = self._leads
        most = KEPT_NUMBERS // max(len(lead), 1)
        for oldest in list(known)[: max(len(known) - most, 0)]:
            del known[oldest]
        known[key] = lead

    def __getstate__(self) -> dict[str, Any]:
        """Another process computes its own."""
        return {**self.__dict__, "_leads": {}}


def compute_stop(steps: Array, opens: NDArray[np.bool_], width: float) -> Array:
    """Add up steps (v,), and cut the sum to [-width, width] after each; from 0 where a group opens.

    A step followed by a cut is x → clip(x + a, low, high), and so are several in turn: visits are laid
    out in blocks that all go forward together, first to learn what each makes of its beginning, then
    from what it begins with."""
    count = len(steps)
    blocks = int(BLOCKS * np.sqrt(count)) + 1
    length = -(-count // blocks)
    shape = blocks, length
    own = _lay_out(steps, shape)
    is_first = _lay_out(opens, shape)
    beginning = [[0.0], [-width], [width]]
    whole = np.repeat(beginning, blocks, axis=1)
    moved, low, high = whole
    bounds = whole[1:]
    for step, restarts in zip(own, is_first, strict=True):
        whole[:, restarts] = 0.0
        whole += step
        np.clip(bounds, -width, width, out=bounds)
    lead = np.zeros(blocks)
    for k in range(blocks - 1):
        ahead = lead[k] + moved[k]
        bounded = max(ahead, low[k])
        lead[k + 1] = min(bounded, high[k])
    leads = np.empty((length, blocks))
    for out, step, restarts in zip(leads, own, is_first, strict=True):
        lead[restarts] = 0.0
        lead += step
        np.clip(lead, -width, width, out=lead)
        out[:] = lead
    in_order = leads.T.reshape(-1)
    return in_order[:count]


def _lay_out(values: NDArray[Any], shape: tuple[int, int]) -> NDArray[Any]:
    """Lay out the values (v,) of visits in blocks of some length: (length, blocks), filled with zeros."""
    blocks, length = shape
    room = blocks * length
    missing = room - len(values)
    margins = 0, missing
    filled = np.pad(values, margins)
    by_block = filled.reshape(shape)
    return by_block.T
