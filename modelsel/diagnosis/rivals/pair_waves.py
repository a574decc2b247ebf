"""Waves of two joints' readings together, at a joint's rotation.

The error map has the first waves of a sum and of a difference; of higher ones there are hundreds at
every joint. They are looked for where a joint seems not to repeat, and stand against a finding that
depends on two readings."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from itertools import combinations, product

from ...fitting.problem import Problem
from ...mechanisms.causes import Cause, Named, cos, q, sin
from ...mechanisms.terms import Mechanism
from ..candidates.candidate import Candidate
from ..candidates.candidate_list import find_cell_prior
from ..shapes.arm_shapes import list_turning
from ..shapes.candidate_kinds import CandidateKind
from ..shapes.distinct_places import Place
from ..shapes.unregistered import RARE_WEIGHT, build_cell

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
    for pair in combinations(turning, 2):
        yield from _build_waves(joint, pair)


def generate_waves_together(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate waves of the two readings that a finding depends on, at the rotation of the one joint
    that it turns. None for any other finding."""
    places = list(found.names_by_place())
    if len(places) == 1:
        yield from generate_waves_of(problem, places[0], found.names())


def generate_waves_of(
    problem: Problem, place: Place, drivers: Collection[str]
) -> Iterator[Mechanism]:
    """Generate waves of two readings at a place; none but for two turning joints' readings at the
    rotation of a joint."""
    joint, axis = place
    turning = list_turning(problem.robot)
    pair = [j for j in turning if f"q{j}" in drivers]
    if axis == "rz" and joint in turning and len(pair) == len(drivers) == 2:
        yield from _build_waves(joint, pair)


def _build_waves(joint: int, pair: Sequence[int]) -> Iterator[Mechanism]:
    a, b = pair
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
