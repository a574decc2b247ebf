"""Springs of one joint, of one link or of the base of which two say together what any other two of them
say.

A drive, a link or the base yields to the arm's weight, to the payload, or to both by one stiffness. Beside
the payload, the torque of both says what the arm's own says: the same model, in other numbers. Then the
two are told apart, each with its own stiffness."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..._typing import Index
from ...mechanisms.bending import LINK_BENDING, PAYLOAD_BENDING
from ...mechanisms.compliance import PAYLOAD_DEFLECTION, TWISTS, has_known_masses, needs_both_loads
from ...mechanisms.terms import Mechanism
from .candidate import Candidate

# what yields to the arm's own weight, and what the same is called under the payload
COMPLIANCE = "joint-compliance"
OF_PAYLOAD = {
    PAYLOAD_DEFLECTION: COMPLIANCE,
    PAYLOAD_BENDING: LINK_BENDING,
    "payload-tilt": "base-tilt",
}


class _Springs(NamedTuple):
    """The candidates that are springs of one thing: of the arm's declared weight, of the payload, and of
    both; `twists`: what else has a joint yield to the arm's weight."""

    own: int
    payload: int
    whole: int
    twists: frozenset[int]

    @property
    def numbers(self) -> set[int]:
        """The springs."""
        return {self.own, self.payload, self.whole}


class _Yielding(NamedTuple):
    """What yields: the name of its spring under the arm's own weight, its joint or link, how many numbers
    it has, and where it moves the arm."""

    stem: str
    number: int | None
    numbers: int
    places: frozenset[tuple[int, str]]


@dataclass(frozen=True, eq=False)
class NestedLoads:
    """The springs of all that may yield to its own weight and to the payload by one stiffness."""

    each: Sequence[_Springs]

    def list_other_names(self, g: int, others: Collection[int]) -> Index:
        """List the candidates that say beside `others` what candidate g says."""
        names: set[int] = set()
        for springs in self.each:
            numbers = springs.numbers
            beside = numbers.intersection(others) - {g}
            if g in numbers and beside:
                names |= numbers - beside - {g}
            if g == springs.payload and springs.twists.intersection(others):
                names.add(springs.whole)
        return np.array(sorted(names), dtype=np.intp)

    def tell_apart(self, members: Sequence[int]) -> tuple[int, ...]:
        """Tell two springs of one thing among some candidates by the arm's weight and by the payload, and
        of one beside a twist by the arm's weight what it says of the payload."""
        told = set(members)
        for springs in self.each:
            numbers = springs.numbers
            if len(numbers & told) > 1:
                told -= numbers
                told |= {springs.own, springs.payload}
            elif springs.whole in told and springs.twists & told:
                told.remove(springs.whole)
                told.add(springs.payload)
        return tuple(sorted(told))


def find_nested_loads(candidates: Sequence[Candidate]) -> NestedLoads:
    """Find the springs of the joints, the links and the base of which all three kinds are candidates."""
    found: dict[_Yielding, dict[str, int]] = {}
    twists: dict[int, set[int]] = {}
    for g, candidate in enumerate(candidates):
        if not candidate.registered:
            continue
        mechanism = candidate.mechanism
        kind = _find_kind(mechanism)
        if kind:
            springs = found.setdefault(_find_yielding(mechanism), {})
            springs[kind] = g
        if mechanism.stem in TWISTS:
            for moved, _ in mechanism.names_by_place():
                twists.setdefault(moved, set()).add(g)
    complete = []
    for what, springs in found.items():
        if len(springs) != 3:
            continue
        others: Collection[int] = ()
        if what.stem == COMPLIANCE:
            joint = what.number or 0
            others = twists.get(joint, ())
        every = _Springs(**springs, twists=frozenset(others))
        complete.append(every)
    return NestedLoads(complete)


def _find_yielding(mechanism: Mechanism) -> _Yielding:
    """Find what yields by a spring."""
    name = mechanism.stem
    stem = OF_PAYLOAD.get(name, name)
    numbers = len(mechanism.terms)
    places = mechanism.names_by_place()
    moved = frozenset(places)
    return _Yielding(stem, mechanism.joint, numbers, moved)


def _find_kind(mechanism: Mechanism) -> str:
    """Find which spring a mechanism is; "" of anything else."""
    if mechanism.stem in OF_PAYLOAD:
        return "payload"
    if mechanism.stem not in OF_PAYLOAD.values():
        return ""
    if needs_both_loads(mechanism):
        return "whole"
    return "own" if has_known_masses(mechanism) else ""
