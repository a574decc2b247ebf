"""Springs of one joint of which two say together what any other two of them say.

A drive yields to the arm's weight, to the payload, or to both by one stiffness. Beside the payload, the
torque of both says what the arm's own says: the same model, in other numbers. Then the two are told
apart, each with its own stiffness."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .._typing import Index
from ..measurements.state_names import StateKind, state_kind
from ..mechanisms.compliance import needs_both_loads
from .candidates import Candidate

COMPLIANCE, DEFLECTION = "joint-compliance", "payload-deflection"
# by which shoulder and elbow yield to the arm's weight, too
TWISTS = ("joint2-twist", "joint3-twist", "gravity-twist")


class _Springs(NamedTuple):
    """The candidates that are springs of one joint: of the arm's declared weight, of the payload, and of
    both; `twists`: what else has the joint yield to the arm's weight."""

    own: int
    payload: int
    whole: int
    twists: frozenset[int]

    @property
    def numbers(self) -> set[int]:
        """The springs."""
        return {self.own, self.payload, self.whole}


@dataclass(frozen=True, eq=False)
class NestedLoads:
    """The springs of every joint that may yield to its own weight and to the payload by one stiffness."""

    joints: Sequence[_Springs]

    def list_other_names(self, g: int, others: Collection[int]) -> Index:
        """List the candidates that say beside `others` what candidate g says."""
        names: set[int] = set()
        for springs in self.joints:
            numbers = springs.numbers
            beside = numbers.intersection(others) - {g}
            if g in numbers and beside:
                names |= numbers - beside - {g}
            if g == springs.payload and springs.twists.intersection(others):
                names.add(springs.whole)
        return np.array(sorted(names), dtype=np.intp)

    def tell_apart(self, members: Sequence[int]) -> tuple[int, ...]:
        """Tell two springs of one joint among some candidates by the arm's weight and by the payload, and
        of one beside a twist by the arm's weight what it says of the payload."""
        told = set(members)
        for springs in self.joints:
            numbers = springs.numbers
            if len(numbers & told) > 1:
                told -= numbers
                told |= {springs.own, springs.payload}
            elif springs.whole in told and springs.twists & told:
                told.remove(springs.whole)
                told.add(springs.payload)
        return tuple(sorted(told))


def find_nested_loads(candidates: Sequence[Candidate]) -> NestedLoads:
    """Find the springs of the joints of which all three kinds are candidates."""
    joints: dict[int, dict[str, int]] = {}
    twists: dict[int, set[int]] = {}
    for g, candidate in enumerate(candidates):
        joint = candidate.mechanism.joint
        kind = _find_kind(candidate)
        if joint is not None and kind:
            springs = joints.setdefault(joint, {})
            springs[kind] = g
        if candidate.registered and candidate.mechanism.stem in TWISTS:
            for moved, _ in candidate.mechanism.names_by_place():
                twists.setdefault(moved, set()).add(g)
    complete = []
    for joint, springs in joints.items():
        if len(springs) == 3:
            others = frozenset(twists.get(joint, ()))
            complete.append(_Springs(**springs, twists=others))
    return NestedLoads(complete)


def _find_kind(candidate: Candidate) -> str:
    """Find which spring a candidate is; "" of anything else."""
    mechanism = candidate.mechanism
    if not candidate.registered:
        return ""
    if mechanism.stem == DEFLECTION:
        return "payload"
    if mechanism.stem != COMPLIANCE:
        return ""
    if needs_both_loads(mechanism):
        return "whole"
    kinds = {state_kind(name) for name in mechanism.names()}
    return "own" if kinds == {StateKind.TORQUE} else ""
