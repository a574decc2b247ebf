"""A finding's own shape that changes along the campaign, as what creeps or warms up does.

It stands against the finding: a cause that stays the same is proven only where it does."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from ...fitting.problem import Problem
from ...mechanisms.causes import Cause
from ...mechanisms.terms import Mechanism, Screw, Term
from ..shapes.campaign_clocks import build_warming_causes
from ..shapes.driver_functions import IN_TIME

# terms from which a finding is a free function, whose changes are asked elsewhere
MOST_TERMS = 4


def generate_changing(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate a finding's shape with that shape times what grows evenly, or settles, along the
    campaign. None for a finding that depends on that already."""
    drivers = found.names()
    count = len(found.terms)
    if count > MOST_TERMS or drivers & IN_TIME:
        return
    for course in build_warming_causes(problem):
        yield change(found, course)


def change(found: Mechanism, course: Cause) -> Mechanism:
    """Build a finding's shape with that shape times a course, in either direction."""
    own = [replace(term, sign=0) for term in found.terms]
    changed = []
    for number, term in enumerate(found.terms, 1):
        screws = tuple(Screw(s.frame, s.axis, s.cause * course) for s in term.screws)
        changed.append(Term(f"c{number}", screws))
    terms = (*own, *changed)
    # not the finding's own name, by which its numbers would be measured
    acts = dict.fromkeys(str(screw) for term in terms for screw in term.screws)
    return Mechanism("; ".join(acts), terms)
