"""What the measurements say about what mechanisms depend on."""

from __future__ import annotations

from ..fitting.problem import Problem
from ..measurements.state_names import NEED_INSTRUMENT, state_kind
from ..mechanisms.drives import SERVO_LAG
from ..mechanisms.terms import Mechanism


def find_lacking(problem: Problem, mechanism: Mechanism) -> frozenset[str]:
    """Find the state variables that a mechanism depends on and of which the measurements say nothing:
    of a servo's lag the speed, where the arm stood still to be measured."""
    own = mechanism.names()
    is_lag = mechanism.stem == SERVO_LAG
    moves = problem.data.in_motion
    if is_lag and not moves:
        return own
    usable = list_usable_names(problem)
    return own - usable


def list_usable_names(problem: Problem) -> frozenset[str]:
    """List the state variables that mechanisms may look at: angles of the beam only where the
    instrument is not taken to stand in the arm, for want of its place."""
    names = frozenset(problem.names())
    if problem.stands_apart:
        return names
    return frozenset(name for name in names if state_kind(name) not in NEED_INSTRUMENT)
