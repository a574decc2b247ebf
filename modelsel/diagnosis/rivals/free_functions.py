"""Free functions of drivers at places of the arm: shapes that no list has.

They are smooth, with their usual prior; of a covariate with few values they are powers. A free function
of two drivers is one of the first, and one times the second."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import product

import numpy as np

from ...fitting.problem import Problem
from ...mechanisms.causes import ONE, Cause, Named
from ...mechanisms.motors import joint_axis, moved_joints
from ...mechanisms.terms import Mechanism, Screw, Term
from ..shapes.distinct_places import Place
from ..shapes.driver_functions import level_off, list_varying, scale_driver
from ..shapes.torque_powers import generate_loaded
from ..shapes.unregistered import build_bumps, list_distinct_places

Drivers = frozenset[str]

# knot intervals over a driver's range, and values that a driver needs to have a smooth shape
INTERVALS = 6
MIN_VALUES = 8
# values that a covariate needs to have powers, and the highest power
FEW_VALUES = 3
HIGHEST_POWER = 3
PROGRESS = Named("progress")
# how a free function of one driver may change with another one
Factor = Callable[[Problem, str], Cause]
FACTORS: tuple[Factor, ...] = (scale_driver, level_off)


def has_shape(problem: Problem, name: str) -> bool:
    """Return whether the values of a driver are so many that a function of it has a shape."""
    fewest = FEW_VALUES if name in problem.data.covariates else MIN_VALUES
    return _count_values(problem, name) >= fewest


def _count_values(problem: Problem, name: str) -> int:
    values = problem.state.value(name)
    rounded = np.round(values, 9)
    distinct = np.unique(rounded)
    return len(distinct)


def name_time(problem: Problem) -> str:
    """Name the course of the campaign."""
    return "time_s" if "time_s" in problem.data.covariates else "progress"


def build_function(problem: Problem, place: Place, name: str, intervals: int) -> Mechanism:
    """Build a free function of one driver at a place, with so many knot intervals."""
    basis = _build_basis(problem, name, intervals)
    return _build((place, function) for function in basis)


def build_free(
    problem: Problem, places: Iterable[Place], name: str, times: Sequence[Cause] = (ONE,)
) -> Mechanism:
    """Build a free function of one driver at some places, times other causes."""
    return _build(_free(problem, places, name, times))


def build_surface(problem: Problem, place: Place, first: str, second: str) -> Mechanism:
    """Build a free function of one driver at a place whose coefficients are polynomials of another."""
    scaled = scale_driver(problem, second)
    factors = (ONE, *_list_powers(scaled, HIGHEST_POWER))
    return _build(_free(problem, [place], first, factors))


def _build_basis(problem: Problem, name: str, intervals: int = INTERVALS) -> list[Cause]:
    """Build the splines of a free function over the range of its driver; of few values, powers."""
    count = _count_values(problem, name)
    if count < MIN_VALUES:
        highest = min(count - 1, HIGHEST_POWER)
        scaled = scale_driver(problem, name)
        return _list_powers(scaled, highest)
    values = problem.state.value(name)
    low, high = float(values.min()), float(values.max())
    width = float(f"{(high - low) / intervals:.6g}")
    return list(build_bumps(name, low, high, width))


def _list_powers(driver: Cause, highest: int) -> list[Cause]:
    """List the powers of a driver, from the first to the highest."""
    powers = [driver]
    for _ in range(1, highest):
        power = powers[-1] * driver
        powers.append(power)
    return powers


def _build(functions: Iterable[tuple[Place, Cause]]) -> Mechanism:
    terms = tuple(
        Term(f"f{k}", (Screw(*place, cause),)) for k, (place, cause) in enumerate(functions, 1)
    )
    screws = [term.screws[0] for term in terms]
    name = "; ".join(dict.fromkeys(f"{s.frame} {s.axis} {s.cause}" for s in screws))
    return Mechanism(name, terms)


def _free(
    problem: Problem, places: Iterable[Place], name: str, times: Sequence[Cause] = (ONE,)
) -> list[tuple[Place, Cause]]:
    """List the functions of a free function of one driver at those of some places that show, times
    other causes: what turns the target alone shows in its orientation."""
    basis = _build_basis(problem, name)
    target = problem.robot.n + 1
    is_turned = problem.components == 6
    return [
        (place, bump if factor == ONE else factor * bump)
        for place in places
        if is_turned or place[0] != target or place[1][0] == "t"
        for factor in times
        for bump in basis
    ]


def generate_shapes(
    problem: Problem, parts: Mapping[Place, Drivers], factors: Sequence[Factor] = FACTORS
) -> Iterator[Mechanism]:
    """Generate free functions of the own drivers at the own places.

    Of two drivers each has its turn: a free function of it, and one times a factor of the other, which
    may level off towards the ends of its range. What depends on the course of the campaign may be a free
    function of the other driver that grows, too."""
    shaped = {
        place: sorted(name for name in drivers if has_shape(problem, name))
        for place, drivers in parts.items()
    }
    most = max(map(len, shaped.values()))
    if not all(shaped.values()) or most > 2:
        return
    for turn, shape in product(range(most), factors[:most]):
        functions: list[tuple[Place, Cause]] = []
        for place, names in shaped.items():
            first = names[turn % len(names)]
            times = (ONE, *(shape(problem, name) for name in names if name != first))
            functions += _free(problem, [place], first, times)
        yield _build(functions)
    if most == 2 and all("progress" in names for names in shaped.values()):
        grown = [name for names in shaped.values() for name in names if name != "progress"]
        growing = zip(shaped, grown, strict=True)
        yield _build(
            [one for place, name in growing for one in _free(problem, [place], name, (PROGRESS,))]
        )


def generate_other_drivers(problem: Problem, found: Mechanism) -> Iterator[list[Mechanism]]:
    """Generate free functions of another driver at a finding's places, or of fewer of its own, those of
    the same drivers together; where a joint moves with the direction that it came from, this times a
    load."""
    parts, drivers = found.names_by_place(), found.names()
    came_from = _find_joint_with_direction(problem, parts, drivers)
    if came_from is not None:
        yield list(generate_loaded(problem, came_from))
    fewer = _list_shaped(problem, drivers) if len(drivers) > 1 else []
    for name in (*fewer, *_list_others(problem, drivers)):
        yield [_build(_free(problem, parts, name))]


def generate_more_drivers(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate free functions at a finding's places of one of its drivers times another one, or, where a
    joint moves with the direction that it came from, of another one times this; of what depends on
    the side that a joint came from, of its last move times this."""
    parts, drivers = found.names_by_place(), found.names()
    shaped = _list_shaped(problem, drivers)
    for j in range(1, problem.robot.n + 1):
        side, move = Named(f"approach{j}"), f"move{j}"
        if drivers == side.names() and has_shape(problem, move):
            yield _build(_free(problem, parts, move, (side,)))
    came_from = _find_joint_with_direction(problem, parts, drivers)
    for other in _list_others(problem, drivers):
        if shaped:
            factors = (ONE, scale_driver(problem, other))
            yield _build(_free(problem, parts, shaped[0], factors))
        if came_from is not None:
            side = Named(f"approach{came_from}")
            yield _build(_free(problem, parts, other, (side,)))


def _list_shaped(problem: Problem, drivers: Drivers) -> list[str]:
    """List those of some drivers that have a shape."""
    return [name for name in sorted(drivers) if has_shape(problem, name)]


def _list_others(problem: Problem, drivers: Drivers) -> list[str]:
    """List what an error may depend on by a free function but for some drivers: joints, the course of
    the campaign, and covariates."""
    joints = [f"q{j}" for j in range(1, problem.robot.n + 1)]
    names = (*joints, name_time(problem), *list_varying(problem))
    return [n for n in names if n not in drivers and has_shape(problem, n)]


def _find_joint_with_direction(
    problem: Problem, parts: Mapping[Place, Drivers], drivers: Drivers
) -> int | None:
    """Find the joint, or the motor, that a finding moves with the direction it came from, if that is all it
    has."""
    robot = problem.robot
    for joint in range(1, robot.n + 1):
        came_from = f"approach{joint}"
        if drivers != {came_from}:
            continue
        moved = moved_joints(robot, joint)
        motions = {(one, joint_axis(robot, one)) for one in moved}
        if parts.keys() == motions:
            return joint
    return None


def generate_other_places(problem: Problem, found: Mechanism) -> Iterator[list[Mechanism]]:
    """Generate free functions of each of a finding's drivers, and of both of two, at every other place,
    those of the same drivers there together."""
    parts = found.names_by_place()
    drivers = found.names()
    shaped = _list_shaped(problem, drivers)
    for place in list_distinct_places(problem):
        if place in parts:
            continue
        for name in shaped:
            yield [_build(_free(problem, [place], name))]
        if len(shaped) == 2:
            yield list(generate_shapes(problem, {place: drivers}, FACTORS[:1]))
