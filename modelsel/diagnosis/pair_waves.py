"""Waves of two joints' readings together, at a joint that seems not to repeat.

The error map has the first waves of a sum and of a difference; of higher ones there are hundreds at
every joint, which are looked for where something is left that no other candidate tells."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, product

from ..fitting.problem import Problem
from ..mechanisms.causes import Cause, Named, cos, q, sin
from ..mechanisms.terms import Mechanism
from .arm_shapes import list_turning
from .candidate_kinds import CandidateKind
from .candidates import Candidate, find_cell_prior
from .unregistered import RARE_WEIGHT, build_cell

# waves a turn of either joint, with the sign of the second, that the error map does not have
COUNTS = tuple(
    (first, second)
    for first, second in product((1, 2, 3), (-3, -2, -1, 1, 2, 3))
    if (first, abs(second)) != (1, 1)
)


def generate_pair_waves(problem: Problem, joint: int) -> Iterator[Mechanism]:
    """Generate waves of two readings at the rotation of a joint; none for a slide."""
    turning = list_turning(problem.robot)
    if joint not in turning:
        return
    for a, b in combinations(turning, 2):
        for first, second in COUNTS:
            own, other = _multiply(first, q(a)), _multiply(abs(second), q(b))
            angle = own + other if second > 0 else own - other
            yield build_cell(
                place=(joint, "rz"),
                causes=(sin(angle), cos(angle)),
                sentence=f"Joint {joint} turns unevenly, with the readings of joints {a} and {b} together",
            )


def _multiply(count: int, reading: Named) -> Cause:
    return reading if count == 1 else float(count) * reading


def list_pair_waves(problem: Problem, found: Sequence[Candidate], joint: int) -> list[Candidate]:
    """List the waves of two readings at a joint as candidates, beside others; none where these have
    no cells of the error map. Those of two joints weigh as much as a rare explanation."""
    cell = find_cell_prior(found)
    if not cell:
        return []
    prior = cell * RARE_WEIGHT / len(COUNTS)
    waves = generate_pair_waves(problem, joint)
    return [Candidate(wave, CandidateKind.WAVE, prior) for wave in waves]
