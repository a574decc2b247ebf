"""Bases that tilt with their load more towards some sides than towards others, as a plate on unequal
corners does.

Such a tilt resembles a function of joint 1's reading at joint 2, with others of joint 1 and of its axis
that mend it. So what depends on nothing but the reading of joint 1 and the load of the base is weighed
against it, one by one and together."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..._typing import Array
from ...fitting.problem import Problem
from ...mechanisms.causes import Cause, Named, cos, q, shifted, sin
from ...mechanisms.gravity_effects import (
    UNITS,
    YIELDING_BASE,
    base_moment,
    base_screws,
    list_level_axes,
)
from ...mechanisms.terms import Mechanism, Screw, Term
from ...robot.gravity import loads_base
from ..shapes.arm_shapes import FEWEST_JOINTS, PER_METRE
from ..shapes.driver_functions import STILL

# frames of the base and of the column that turns with joint 1
FOOT = (1, 2)
# what says how far and where the arm reaches out
LOADS = frozenset(("q1", "reach_mm", "moment_x", "moment_y", "moment_z"))
# how often in a turn about axis 1 a base is stiff
SIDES = (1, 2)
OFTEN = {1: "once", 2: "twice"}
# digits after the point of an angle
DIGITS = 3
# directions in frame 0, and by how much a base turns about each
Tilt = Sequence[tuple[Array, Cause]]


def generate_uneven_bases(problem: Problem) -> Iterator[Mechanism]:
    """Generate tilts of the base with the reach, or with the moment of the arm's weight, that are larger
    towards some sides, once a turn, twice, or both. None where joint 1 does not turn, or stood still."""
    robot = problem.robot
    turned = np.ptp(problem.data.q[:, 0])
    if robot.n < FEWEST_JOINTS or robot.joints[0].prismatic or turned <= STILL:
        return
    loads = {"the reach": _build_reach(problem)}
    if loads_base(robot):
        moments = [(UNITS[axis], base_moment(axis)) for axis in list_level_axes(robot)]
        loads["the moment of the arm's weight about the base"] = moments
    for words, tilt in loads.items():
        for sides in ((SIDES[0],), (SIDES[1],), SIDES):
            yield _build(problem, tilt, words, sides)


def generate_uneven_beside(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate the tilts of an uneven base beside what depends on nothing but its load; none beside any
    other finding."""
    if depends_on_load(found):
        yield from (tilt for tilt in generate_uneven_bases(problem) if tilt != found)


def depends_on_load(found: Mechanism) -> bool:
    """Return whether a finding moves the base, or the column on it, with nothing but the reading of joint
    1, the reach and the moment of the arm's weight."""
    names = found.names()
    frames = {frame for frame, _ in found.names_by_place()}
    is_load = bool(names) and names <= LOADS
    return is_load and frames <= set(FOOT)


def _build_reach(problem: Problem) -> Tilt:
    """Build the tilt with the reach [m], away from axis 1."""
    ahead = _find_ahead(problem)
    towards = shifted(q(1), ahead) if ahead else q(1)
    metres = PER_METRE * Named("reach_mm")
    first, second = problem.robot.joints[0].before[:3, :2].T
    return [(-first, metres * sin(towards)), (second, metres * cos(towards))]


def _find_ahead(problem: Problem) -> float:
    """Find the direction in which the arm reaches about axis 1 where joint 1 reads nought [rad]."""
    state = problem.state
    place = np.stack([state.value(f"{axis}_mm") for axis in "xyz"], 1)
    before = problem.robot.joints[0].before
    rotation = before[:3, :3]
    x, y, _ = ((place - before[:3, 3]) @ rotation).T
    turned = np.exp(-1j * problem.data.q[:, 0])
    together = ((x + 1j * y) * turned).sum()
    angle = float(np.angle(together))
    return round(angle, DIGITS)


def _build(problem: Problem, tilt: Tilt, words: str, sides: tuple[int, ...]) -> Mechanism:
    """Build a base that tilts with its load, more towards some sides."""
    factors: list[Cause | None] = [None]
    for count in sides:
        angle = float(count) * q(1)
        factors += [cos(angle), sin(angle)]
    terms = []
    for number, factor in enumerate(factors, 1):
        screws: list[Screw] = []
        for direction, load in tilt:
            cause = load if factor is None else load * factor
            screws += base_screws(problem.robot, direction, cause)
        terms.append(Term(f"m{number}", tuple(screws)))
    often = " and ".join(OFTEN[count] for count in sides)
    name = f"1 rx {words}, unevenly {often} a turn"
    sentence = f"The base tilts with {words}, more towards some sides than towards others"
    return replace(Mechanism(name, tuple(terms), sentence), usual_causes=YIELDING_BASE)
