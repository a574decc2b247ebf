"""The way of the arm from visit to visit, and what a joint drags along on it: hysteresis that
remembers."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._typing import Array

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
        lead = self._leads.get(key)
        if lead is None:
            own = self.steps[:, joint - 1]
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
    missing = blocks * length - count
    own = np.pad(steps, (0, missing)).reshape(blocks, length).T
    is_first = np.pad(opens, (0, missing)).reshape(blocks, length).T
    whole = np.repeat([[0.0], [-width], [width]], blocks, axis=1)
    moved, low, high = whole
    bounds = whole[1:]
    for step, restarts in zip(own, is_first, strict=True):
        whole[:, restarts] = 0.0
        whole += step
        np.clip(bounds, -width, width, out=bounds)
    lead = np.zeros(blocks)
    for k in range(1, blocks):
        lead[k] = min(max(lead[k - 1] + moved[k - 1], low[k - 1]), high[k - 1])
    leads = np.empty((length, blocks))
    for out, step, restarts in zip(leads, own, is_first, strict=True):
        lead[restarts] = 0.0
        lead += step
        np.clip(lead, -width, width, out=lead)
        out[:] = lead
    return leads.T.reshape(-1)[:count]
