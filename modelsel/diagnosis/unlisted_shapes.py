"""Shapes that no list has, as rivals of a finding: what else could stand where an effect was named.

A rival is a free function of the finding's own drivers at its places, of one driver more or another
one there, or of its own drivers at another place; or the finding's own shape, changing along the
campaign. Free functions are smooth, with their usual prior. Together the rivals are as probable
beforehand as the finding itself: half of that for an unlisted shape of the same drivers, the rest for
other drivers, of which a fifth for changes along the campaign, and for other places. To a wave and a
bump come those with constants near its own, which are one question with it; to a covariate what else
changed when it did."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from ..fitting.problem import Problem
from ..mechanisms.causes import ONE, Bump, Cause, Named
from ..mechanisms.motors import joint_axis
from ..mechanisms.terms import Mechanism, Screw, Term
from .candidate_kinds import CandidateKind
from .candidates import Candidate
from .changing_shapes import generate_changing
from .confounded_covariates import generate_confounded
from .distinct_places import Place
from .driver_functions import level_off, scale_driver
from .finer_waves import generate_finer_waves
from .joint_bumps import generate_bumps, generate_finer_bumps
from .simple_shapes import generate_products, generate_pulls, generate_saws, generate_soft_lags
from .time_waves import generate_finer_time_waves
from .torque_powers import generate_loaded, generate_powers
from .unregistered import RARE_WEIGHT, build_bumps, list_distinct_places

Drivers = frozenset[str]

# knot intervals over a driver's range, and values that a driver needs to have a shape
INTERVALS = 6
MIN_VALUES = 8
PROGRESS = Named("progress")
# places times drivers from which a finding acts in too many ways for one free function
MAX_PARTS = 6
# simple shapes of a finding's drivers at its place
SIMPLE = {
    generate_bumps: CandidateKind.BUMP,
    generate_products: CandidateKind.SHAPE,
    generate_soft_lags: CandidateKind.SOFT_LAG,
    generate_saws: CandidateKind.SAW,
    generate_pulls: CandidateKind.PULL,
    generate_powers: CandidateKind.POWER,
}
# kinds of waves, whose number may lie between those that are looked for
OF_ANY_NUMBER = (CandidateKind.JOINT_WAVE, CandidateKind.SLIDE_WAVE, CandidateKind.TIME_WAVE)
# how a free function of one driver may change with another one
FACTORS = (scale_driver, level_off)
# prior probability of a further listed finding at a place, where one is
FURTHER = 0.1
# prior probability of all rivals over that of the finding, and how it is divided
ODDS = 1.0
SHARES = {"shape": 0.5, "drivers": 0.2, "changing": 0.05, "place": 0.25}


@dataclass(frozen=True)
class Rival:
    """Another explanation of a finding, with what it agrees in: "shape" (all but its constant),
    "drivers" (and so the place), "place" (other drivers there), or "" (another place)."""

    candidate: Candidate
    agrees: str


@dataclass(frozen=True)
class Company:
    """Findings of one place: their numbers, all of them as one candidate, and shapes of their
    drivers that no list has."""

    members: tuple[int, ...]
    listed: Candidate
    shapes: tuple[Candidate, ...]


def list_company(problem: Problem, effects: Mapping[int, Candidate]) -> list[Company]:
    """List the findings that share a place: every two, and all of a place together.

    Functions of one joint's own angle are left to `joint_curves`, but for waves: two of them may be
    one of a number between."""
    by_place: dict[Place, list[int]] = {}
    for g, candidate in effects.items():
        if candidate.asked:
            return []
        for place in candidate.mechanism.names_by_place():
            by_place.setdefault(place, []).append(g)
    groups: dict[tuple[int, ...], Place] = {}
    for place, members in by_place.items():
        for group in (*combinations(members, 2), tuple(members)):
            if len(group) > 1:
                groups.setdefault(group, place)
    company = [_build_company(problem, effects, group, place) for group, place in groups.items()]
    return [one for one in company if one is not None]


def _build_company(
    problem: Problem, effects: Mapping[int, Candidate], members: tuple[int, ...], place: Place
) -> Company | None:
    mechanisms = [effects[g].mechanism for g in members]
    drivers = frozenset[str]().union(*(mechanism.names() for mechanism in mechanisms))
    if drivers == {f"q{place[0]}"}:
        kind = CandidateKind.JOINT_WAVE if place[1] == "rz" else CandidateKind.SLIDE_WAVE
        waves = [wave for m in mechanisms for wave in generate_finer_waves(problem, m)]
        shapes = [(wave, kind) for wave in dict.fromkeys(waves)]
    else:
        shapes = _list_shapes(problem, mechanisms, place, drivers)
    if not shapes:
        return None
    terms = {term.key: term for mechanism in mechanisms for term in mechanism.terms}
    name = " & ".join(mechanism.name for mechanism in mechanisms)
    prior = max(effects[g].prior for g in members)
    listed = Candidate(
        Mechanism(name, tuple(terms.values())),
        CandidateKind.SHAPE,
        prior * FURTHER ** (len(members) - 1),
    )
    share = prior * ODDS * SHARES["shape"] / len(shapes)
    return Company(members, listed, tuple(Candidate(m, kind, share) for m, kind in shapes))


def _list_shapes(
    problem: Problem, mechanisms: Sequence[Mechanism], place: Place, drivers: Drivers
) -> list[tuple[Mechanism, CandidateKind]]:
    """List shapes of the drivers of several findings at one place; none where one of these is such."""
    free = list(_generate_shapes(problem, {place: drivers}))
    if any(m in free for m in mechanisms):
        return []
    powers = dict.fromkeys(power for m in mechanisms for power in generate_powers(problem, m))
    changing = [one for m in mechanisms for one in generate_changing(problem, m)]
    free += [one for one in changing if one.names() == drivers]
    shapes = [(m, CandidateKind.SHAPE) for m in free]
    return shapes + [(m, CandidateKind.POWER) for m in powers if m not in mechanisms]


def list_rivals(problem: Problem, candidate: Candidate) -> list[Rival]:
    """List the shapes that no list has beside a candidate, with their prior probabilities.

    None where the study considers no causes but those that it lists."""
    parts = candidate.mechanism.names_by_place()
    if candidate.asked or not parts or len(parts) > MAX_PARTS:
        return []
    drivers = candidate.mechanism.names()
    names = _list_drivers(problem)
    own = candidate.mechanism
    free = [m for m in _generate_shapes(problem, parts) if m != own]
    simple = [
        (kind, [m for m in generate(problem, own) if m != own]) for generate, kind in SIMPLE.items()
    ]
    others = list(_generate_other_drivers(problem, parts, drivers, names))
    changing = list(generate_changing(problem, own))
    elsewhere = list(_generate_other_places(problem, parts, drivers, names))
    prior = ODDS * candidate.prior
    sorts = 1 + sum(bool(mechanisms) for _, mechanisms in simple)
    alike = prior * SHARES["shape"] / sorts
    return [
        *_weigh(free, "drivers", alike),
        *(
            rival
            for kind, mechanisms in simple
            for rival in _weigh(mechanisms, _compare_drivers(mechanisms, drivers), alike, kind)
        ),
        *_list_finer_waves(problem, candidate),
        *_list_finer_bumps(problem, candidate),
        *_weigh(others, "place", prior * SHARES["drivers"]),
        *_weigh(changing, "place", prior * SHARES["changing"]),
        *_weigh(elsewhere, "", prior * SHARES["place"]),
        *_list_confounded(problem, candidate),
    ]


def _list_confounded(problem: Problem, candidate: Candidate) -> Iterator[Rival]:
    """List what else changed when a finding's covariate did: together as probable as the finding."""
    sorts = list(generate_confounded(problem, candidate.mechanism))
    for mechanisms in sorts:
        share = candidate.prior / len(sorts)
        yield from _weigh(mechanisms, "place", share, CandidateKind.CELL)


def _compare_drivers(mechanisms: Sequence[Mechanism], drivers: Drivers) -> str:
    """Say what shapes agree in with a finding of some drivers: "drivers", or "place" where they have
    others. A last move says its side, too; a side does not say how far the move was."""
    own = _leave_out_sides(drivers)
    agree = all(_leave_out_sides(m.names()) == own for m in mechanisms)
    return "drivers" if agree else "place"


def _leave_out_sides(drivers: Drivers) -> Drivers:
    """Leave out the sides that a joint comes from where its last move is among the drivers."""
    moves = {name for name in drivers if name.startswith("move")}
    sides = {name.replace("move", "approach") for name in moves}
    return drivers - sides


def _list_finer_waves(problem: Problem, candidate: Candidate) -> Iterator[Rival]:
    """List waves of about as many a turn as a found one: the same shape, but for a registered ripple,
    whose whole number is likelier."""
    kind = candidate.kind
    agrees, prior = "shape", candidate.prior
    if candidate.registered:
        kind = CandidateKind.JOINT_WAVE
        agrees = "drivers"
        prior *= RARE_WEIGHT
    if kind not in OF_ANY_NUMBER:
        return
    own = candidate.mechanism
    waves = [*generate_finer_waves(problem, own), *generate_finer_time_waves(problem, own)]
    yield from _weigh(waves, agrees, prior, kind)


def _list_finer_bumps(problem: Problem, candidate: Candidate) -> Iterator[Rival]:
    """List bumps near a found one. Of few readings there, their height, width and shape are one question."""
    kind = candidate.kind
    if kind is CandidateKind.BUMP:
        finer = list(generate_finer_bumps(problem, candidate.mechanism))
        yield from _weigh(finer, "drivers", candidate.prior, kind)


def _weigh(
    mechanisms: Sequence[Mechanism],
    agrees: str,
    prior: float,
    kind: CandidateKind = CandidateKind.SHAPE,
) -> Iterator[Rival]:
    for mechanism in mechanisms:
        share = prior / len(mechanisms)
        yield Rival(Candidate(mechanism, kind, share), agrees)


def _list_drivers(problem: Problem) -> tuple[str, ...]:
    """List what an error may depend on by a free function: joints, and the course of the campaign."""
    joints = [f"q{j}" for j in range(1, problem.robot.n + 1)]
    time = "time_s" if "time_s" in problem.data.covariates else "progress"
    return tuple(name for name in (*joints, time) if _has_shape(problem, name))


def _has_shape(problem: Problem, name: str) -> bool:
    values = problem.state.value(name)
    return len(np.unique(np.round(values, 9))) >= MIN_VALUES


def _build_basis(problem: Problem, name: str) -> list[Bump]:
    """Build the splines of a free function over the range of its driver."""
    values = problem.state.value(name)
    low, high = float(values.min()), float(values.max())
    width = float(f"{(high - low) / INTERVALS:.6g}")
    return build_bumps(name, low, high, width)


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
    """List the functions of a free function of one driver at some places, times other causes."""
    basis = _build_basis(problem, name)
    return [
        (place, bump if factor == ONE else factor * bump)
        for place in places
        for factor in times
        for bump in basis
    ]


def _generate_shapes(problem: Problem, parts: dict[Place, Drivers]) -> Iterator[Mechanism]:
    """Generate free functions of the own drivers at the own places.

    Of two drivers each has its turn: a free function of it, and one times the other, which may level
    off towards the ends of its range. What depends on the course of the campaign may be a free
    function of the other driver that grows, too."""
    shaped = {
        place: sorted(name for name in drivers if _has_shape(problem, name))
        for place, drivers in parts.items()
    }
    most = max(map(len, shaped.values()))
    if not all(shaped.values()) or most > 2:
        return
    for turn, shape in product(range(most), FACTORS[:most]):
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


def _generate_other_drivers(
    problem: Problem, parts: dict[Place, Drivers], drivers: Drivers, names: Sequence[str]
) -> Iterator[Mechanism]:
    """Generate free functions of another driver at the own places, and of an own one times another; where
    a joint moves with the direction that it came from, this times a free function of another, or times a
    load."""
    own = next((name for name in sorted(drivers) if _has_shape(problem, name)), None)
    came_from = _find_joint_with_direction(problem, parts, drivers)
    if came_from is not None:
        yield from generate_loaded(problem, came_from)
    for other in names:
        if other in drivers:
            continue
        yield _build(_free(problem, parts, other))
        if own is not None:
            yield _build(_free(problem, parts, own, (ONE, scale_driver(problem, other))))
        if came_from is not None:
            yield _build(_free(problem, parts, other, (Named(f"approach{came_from}"),)))


def _find_joint_with_direction(
    problem: Problem, parts: dict[Place, Drivers], drivers: Drivers
) -> int | None:
    """Find the joint that a finding moves with the direction it came from, if that is all it has."""
    robot = problem.robot
    for joint in range(1, robot.n + 1):
        axis = joint_axis(robot, joint)
        motion = joint, axis
        came_from = f"approach{joint}"
        if drivers == {came_from} and list(parts) == [motion]:
            return joint
    return None


def _generate_other_places(
    problem: Problem, parts: dict[Place, Drivers], drivers: Drivers, names: Sequence[str]
) -> Iterator[Mechanism]:
    """Generate free functions of each own driver at every other place."""
    for place in list_distinct_places(problem):
        if place in parts:
            continue
        for name in sorted(drivers):
            if _has_shape(problem, name):
                yield _build(_free(problem, [place], name))
