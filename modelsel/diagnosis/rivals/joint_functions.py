"""Functions of any shape at a joint that seems not to repeat, of one driver or of two together.

The error map has what is smooth in one reading, and products of first waves. What a joint does as
another one turns, after a long move, or more and more along the campaign may have any shape; such
functions are too many for every place, and are looked for where a joint is off by what no other
candidate tells."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import permutations

from ...fitting.problem import Problem
from ...mechanisms.motors import joint_axis
from ...mechanisms.terms import Mechanism
from ..candidates.candidate import Candidate
from ..candidates.candidate_list import find_cell_prior
from ..shapes.candidate_kinds import CandidateKind
from ..shapes.driver_functions import list_varying
from .finding_groups import FURTHER
from .free_functions import build_function, build_surface, has_shape, name_time
from .joint_drags import generate_drags
from .unlisted_shapes import UNLISTED_ODDS

# knot intervals over the range of one driver alone
FINENESS = (6, 12)
# functions of two drivers: either is the first
TURNS = 2


def list_joint_functions(
    problem: Problem, found: Sequence[Candidate], joint: int
) -> list[Candidate]:
    """List functions of any shape at a joint as candidates, and its hysteresis, beside others; none
    where these have no cells of the error map. They are as probable beforehand as unlisted shapes
    elsewhere."""
    cell = find_cell_prior(found)
    if not cell:
        return []
    prior = UNLISTED_ODDS * cell
    of_one = list(generate_curves(problem, joint))
    of_two = list(generate_surfaces(problem, joint))
    curves = [Candidate(one, CandidateKind.SHAPE, prior / len(FINENESS)) for one in of_one]
    surfaces = [Candidate(one, CandidateKind.SHAPE, FURTHER * prior / TURNS) for one in of_two]
    drags = list(generate_drags(problem, joint))
    hysteresis = [Candidate(one, CandidateKind.HYSTERESIS, prior / len(drags)) for one in drags]
    return curves + surfaces + hysteresis


def generate_curves(problem: Problem, joint: int) -> Iterator[Mechanism]:
    """Generate functions of another joint's reading, or of the joint's own last move, at its motion."""
    axis = joint_axis(problem.robot, joint)
    place = joint, axis
    own = f"q{joint}"
    move = f"move{joint}"
    names = [name for name in _list_readings(problem) if name != own]
    if move in problem.names():
        names.append(move)
    for name in names:
        if has_shape(problem, name):
            for intervals in FINENESS:
                yield build_function(problem, place, name, intervals)


def generate_surfaces(problem: Problem, joint: int) -> Iterator[Mechanism]:
    """Generate functions of two drivers at a joint's motion: its own reading and another's or a
    covariate, or any reading and the course of the campaign."""
    place = joint, joint_axis(problem.robot, joint)
    own = f"q{joint}"
    readings = _list_readings(problem)
    time = name_time(problem)
    pairs = [(own, other) for other in readings if other != own]
    pairs += [(reading, time) for reading in readings]
    pairs += [(own, covariate) for covariate in list_varying(problem)]
    for pair in pairs:
        if all(has_shape(problem, name) for name in pair):
            for first, second in permutations(pair):
                yield build_surface(problem, place, first, second)


def _list_readings(problem: Problem) -> list[str]:
    return [f"q{j}" for j in range(1, problem.robot.n + 1)]
