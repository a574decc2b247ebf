"""What the measurements say about what mechanisms depend on."""

from __future__ import annotations

from collections.abc import Iterable

from ...fitting.problem import Problem
from ...measurements.campaign.state_names import NEED_INSTRUMENT, state_kind
from ...mechanisms.compliance import PAYLOAD, needs_both_loads
from ...mechanisms.drives import SERVO_LAG
from ...mechanisms.terms import Mechanism
from ..shapes.whole_torques import sees_loads_of


def list_lacking(problem: Problem, mechanisms: Iterable[Mechanism]) -> list[frozenset[str]]:
    """List for every mechanism the state variables that it depends on and of which the measurements
    say nothing: of a servo's lag the speed, where the arm stood still to be measured; of the torque of
    own weight and payload the payload, where these are not told apart."""
    usable = list_usable_names(problem)
    moves = problem.data.in_motion
    lacking = []
    for one in mechanisms:
        own = one.names()
        unknown = own - usable
        if one.stem == SERVO_LAG and not moves:
            unknown = own
        elif not unknown and needs_both_loads(one) and not sees_loads_of(problem, one):
            unknown = frozenset({PAYLOAD})
        lacking.append(unknown)
    return lacking


def list_usable_names(problem: Problem) -> frozenset[str]:
    """List the state variables that mechanisms may look at: angles of the beam only where the
    instrument is not taken to stand in the arm, for want of its place."""
    names = frozenset(problem.names())
    if problem.stands_apart:
        return names
    return frozenset(name for name in names if state_kind(name) not in NEED_INSTRUMENT)
