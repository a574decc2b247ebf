"""State variables that mechanisms may look at."""

from __future__ import annotations

from ..fitting.problem import Problem
from ..measurements.state_names import NEED_INSTRUMENT, state_kind


def list_usable_names(problem: Problem) -> frozenset[str]:
    """List the state variables that mechanisms may look at: angles of the beam only where the
    instrument is not taken to stand in the arm, for want of its place."""
    names = frozenset(problem.names())
    if problem.stands_apart:
        return names
    return frozenset(name for name in names if state_kind(name) not in NEED_INSTRUMENT)
