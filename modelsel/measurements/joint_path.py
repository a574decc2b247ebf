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
            steps = own.tolist()
            opens = self.opens.tolist()
            lead = _stop(steps, opens, width)
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


def _stop(steps: list[float], opens: list[bool], width: float) -> Array:
    """Add up steps (v,), and cut the sum to [-width, width] after each; from 0 where a group opens."""
    lead = 0.0
    leads = []
    for step, is_first in zip(steps, opens, strict=True):
        if is_first:
            lead = 0.0
        ahead = lead + step
        bounded = max(ahead, -width)
        lead = min(bounded, width)
        leads.append(lead)
    return np.array(leads, dtype=float)
