"""What could be wrong: every registered mechanism, every cell of the error map (place x cause),
every free function.

A candidate is one explanation: one effect with its own coefficients. Registered mechanisms share
REGISTERED of the prior, evenly by name (the constants of a scanned one share its part), the cells
the rest: physics first, but never only what was foreseen."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from .._typing import Array
from ..fitting.design import Model
from ..fitting.problem import Problem
from ..measurements.reference_temperature import TEMPERATURE
from ..mechanisms.causes import Applied, Bump, Cause, Named, cos, q, sign, sin, torque
from ..mechanisms.drives import WAVES, wave_terms
from ..mechanisms.environment import temperature_rise
from ..mechanisms.gravity_effects import forearm_lever, upper_arm_lever
from ..mechanisms.terms import Mechanism, Screw, Term, TermKey
from ..robot.gravity import find_arm_pair, find_gravity_joints
from ..robot.kinematics import Robot
from ..robot.rigid import AXES
from ..selection.comparison import MAX_CANDIDATES

REGISTERED = 0.6
Screws = tuple(np.radians(degrees) for degrees in (40.0, 20.0, 10.0, 4.0, 2.0))
DENSITY = 3.0  # configurations per knot interval that a free function needs
BETWEEN = tuple(
    k + part for k in range(3, 60) for part in (0.25, 0.5, 0.75)
)  # a gear ahead of the joint need not close
PITCHES = tuple(k / 8 for k in range(4, 481))  # waves over a slide's travel
# prior of what is more strange than most (waves between whole numbers, free functions), against a
# cell
ODD = 0.1
# cells of the error map; with more (some fifteen joints) a cell's cause is of joints beside its
# place
CELLS = 40_000
WARMING = (0.05, 0.1, 0.25, 0.5)  # time constants of a warm-up, in shares of the campaign


@dataclass(frozen=True)
class Candidate:
    """One explanation and its prior probability; `registered`: the catalogue has it.
    `but_for_sign`: of a cell, the registered mechanisms that do the same, with a sign that physics
    allows; `asked`: the study considers no cause but those it lists."""

    mechanism: Mechanism
    registered: bool
    prior: float
    but_for_sign: tuple[Mechanism, ...] = ()
    asked: bool = False

    @property
    def registered_name(self) -> str | None:
        """The registered name, None for a cell of the error map."""
        return self.mechanism.name if self.registered else None

    @property
    def label(self) -> str:
        """A short name: the registered one, or the cell."""
        if self.registered:
            return self.mechanism.name
        if self.mechanism.name.startswith("free("):
            return self.mechanism.name.partition(" ")[0]
        screw = self.mechanism.terms[0].screws[0]
        return f"frame {screw.frame} {screw.axis} · {self.causes(' & ')}"

    def causes(self, joint: str) -> str:
        """The causes of a cell; four of two joints are any product of a wave of the one and a wave
        of the other."""
        each = list(dict.fromkeys(str(s.cause) for t in self.mechanism.terms for s in t.screws))
        if len(each) == 4:
            return f"waves of {' times waves of '.join(sorted(self.mechanism.names()))}"
        return joint.join(each)


def places(problem: Problem) -> tuple[tuple[int, str], ...]:
    """(frame, axis) where a screw can show: the target's rotations only where orientation is
    measured."""
    n = problem.robot.n
    last = AXES if problem.components == 6 else AXES[:3]
    return tuple((f, a) for f in range(1, n + 1) for a in AXES) + tuple((n + 1, a) for a in last)


def cell_causes(problem: Problem) -> tuple[tuple[Cause, ...], ...]:
    """Causes of the map's columns: one function each, or a sine and cosine of unknown phase."""
    robot, out = problem.robot, list[tuple[Cause, ...]]()
    turning = [j for j in range(1, robot.n + 1) if not robot.joints[j - 1].prismatic]
    for j in range(1, robot.n + 1):
        out.append((q(j, robot.unit(j)),))
    for j in turning:
        out += [(sin(q(j)), cos(q(j))), (sin(2.0 * q(j)), cos(2.0 * q(j)))]
    for j in (
        j for j in range(1, robot.n + 1) if j not in turning
    ):  # a bowed rail; a scale that grows with temperature
        along = q(j, "mm")
        out.append((along, along * along))
        out += (
            [(temperature_rise(problem.data.reference_celsius) * along, along)]
            if TEMPERATURE in problem.data.covariates
            else []
        )
    for j, k in combinations(turning, 2):
        both, apart = (sin(q(j) + q(k)), cos(q(j) + q(k))), (sin(q(j) - q(k)), cos(q(j) - q(k)))
        out += [
            both,
            apart,
            both + apart,
        ]  # together: any product of a wave of the one and a wave of the other
    loaded = find_gravity_joints(robot)
    out += [(torque(j),) for j in loaded] + [(sign(torque(j)),) for j in loaded]
    if (pair := find_arm_pair(robot)) is not None:
        out += [(forearm_lever(pair),), (upper_arm_lever(pair),), (sign(forearm_lever(pair)),)]
    out += [(Named(f"approach{j}"),) for j in range(1, robot.n + 1)]
    out += [(cause,) for cause in warming(problem)]
    units = problem.names()
    for name in problem.data.covariates:
        out.append(
            (
                temperature_rise(problem.data.reference_celsius)
                if name == TEMPERATURE
                else Named(name, units[name]),
            )
        )
        if name == "payload_kg" and pair is not None:
            out += [
                (Named(name, "kg") * forearm_lever(pair),),
                (Named(name, "kg") * upper_arm_lever(pair),),
            ]
    return tuple(out)


def exceeds_cell_limit(problem: Problem) -> bool:
    """Whether the whole error map would have more than CELLS cells."""
    return len(places(problem)) * len(cell_causes(problem)) > CELLS


def _beside(causes: Sequence[Cause]) -> Callable[[int], bool]:
    """Whether a frame is the place of every joint that some causes look at, or next to it."""
    joints = {
        int(digits)
        for c in causes
        for name in c.names()
        for digits in re.findall(r"^[a-z]+(\d+)", name)
    }
    return lambda frame: all(abs(j - frame) <= 1 for j in joints)


def _cell(place: tuple[int, str], causes: Sequence[Cause], words: str) -> Mechanism:
    terms = tuple(
        Term(f"m{k}" if len(causes) > 1 else "m", (Screw(*place, cause),))
        for k, cause in enumerate(causes, 1)
    )
    return Mechanism(f"{place[0]} {place[1]} {words}", terms)


def warming(problem: Problem) -> tuple[Cause, ...]:
    """Drift and exponential warm-up, by the clock where the file has one, else by the place in the
    order of motion."""
    data = problem.data
    if "time_s" not in data.covariates:
        clock: Cause = Named("progress")
        return (clock, *(Applied("exp", clock / -share) for share in WARMING))
    start, span = float(data.covariates["time_s"].min()), float(np.ptp(data.covariates["time_s"]))
    since = Named("time_s", "s") - start if start else Named("time_s", "s")
    return tuple(Applied("exp", since / -float(f"{share * span:.6g}")) for share in WARMING if span)


def waves(robot: Robot) -> list[tuple[Mechanism, float]]:
    """(waves of a joint's own angle, 3 to 60 a turn, at its own rotation; weight in the prior):
    whole numbers where no registered ripple is offered, and quarters between."""
    turning = [j for j, joint in enumerate(robot.joints, 1) if not joint.prismatic]
    return [
        (
            Mechanism(
                f"{j} rz {count:g} waves",
                wave_terms(j, count, "rz", "m"),
                f"Joint {j} turns unevenly: {count:g} waves a turn",
            ),
            weight,
        )
        for j in turning
        for counts, weight in ((WAVES, 1.0), (BETWEEN, ODD))
        for count in counts
    ]


def pitches(problem: Problem) -> list[tuple[Mechanism, float]]:
    """(waves of a slide's own reading, half to 60 over the travel seen, weight in the prior): a
    screw's pitch, a rack's teeth, a scale's joints. The travel is no multiple of them, so eighths
    stand for all."""
    out = []
    for j in (j for j, joint in enumerate(problem.robot.joints, 1) if joint.prismatic):
        travel = float(np.ptp(problem.data.q[:, j - 1]))
        for count in PITCHES if travel > 0 else ():
            angle = float(f"{2 * np.pi * count / travel:.6g}") * q(j, "mm")
            out.append(
                (
                    Mechanism(
                        f"{j} tz {count:g} waves",
                        (
                            Term("ms", (Screw(j, "tz", sin(angle)),)),
                            Term("mc", (Screw(j, "tz", cos(angle)),)),
                        ),
                        f"Joint {j} slides unevenly, a wave every {travel / count:.3g} mm",
                    ),
                    1 / 8,
                )
            )
    return out


def free_functions(problem: Problem) -> list[Mechanism]:
    """Cubic splines of every turning joint's own angle at its own rotation, knots 10, 4 and 2
    degrees apart, where the data are dense enough to carry them."""
    out = []
    data = problem.data
    first = np.unique(data.block, return_index=True)[1]
    for j, joint in enumerate(problem.robot.joints, 1):
        values = np.sort(data.q[first, j - 1])
        if joint.prismatic or np.ptp(values) < np.radians(20.0):
            continue
        for width in Screws:
            centres = (
                np.arange(np.floor(values[0] / width), np.ceil(values[-1] / width) + 1) * width
            )
            filled = np.searchsorted(values, centres + width) - np.searchsorted(
                values, centres - width
            )
            if np.median(filled) / 2 < DENSITY or (filled > 0).sum() < 4:
                continue
            terms = tuple(
                Term(
                    f"f{j}[{np.degrees(c):.0f}]",
                    (Screw(j, "rz", Bump(f"q{j}", float(c), float(width))),),
                )
                for c, n in zip(centres, filled, strict=True)
                if n >= 2
            )
            out.append(
                Mechanism(
                    f"free(q{j}) {np.degrees(width):.0f}",
                    terms,
                    f"Joint {j} turns unevenly, by a shape no list has.",
                )
            )
    return out


def build_candidates(
    problem: Problem, base: Model, mechanisms: Sequence[Mechanism], cells: bool = True
) -> tuple[Candidate, ...]:
    """Every explanation the data could carry beyond the base, with priors that sum to one.
    `cells=False`: the given mechanisms alone."""
    names, inside = problem.names(), {t.key for t in base.terms}
    fitting = _distinct(
        problem,
        [
            m
            for m in mechanisms
            if m.names() <= names.keys() and not {t.key for t in m.terms} <= inside
        ],
    )
    count: dict[str, int] = {}
    for m in fitting:
        count[m.name] = count.get(m.name, 0) + 1
    seen, one_sided = _taken(fitting)
    others: list[tuple[Mechanism, float]] = []
    if cells:
        every_cause = [(causes, " & ".join(map(str, causes))) for causes in cell_causes(problem)]
        some = exceeds_cell_limit(problem)
        beside = [_beside(causes) if some else lambda frame: True for causes, _ in every_cause]
        pool = [
            (_cell(place, causes, words), 1.0)
            for place in places(problem)
            for (causes, words), near in zip(every_cause, beside, strict=True)
            if near(place[0])
        ]
        for m, weight in [
            *pool,
            *waves(problem.robot),
            *pitches(problem),
            *((f, ODD) for f in free_functions(problem)),
        ]:
            key = frozenset(t.key for t in m.terms)
            if key not in seen and not key <= inside:
                seen.add(key)
                others.append((m, weight))
    share = REGISTERED if others and fitting else 1.0 if fitting else 0.0
    whole = sum(weight for _, weight in others)
    return (
        *(Candidate(m, True, share / len(count) / count[m.name], asked=not cells) for m in fitting),
        *(
            Candidate(
                m,
                False,
                (1 - share) * weight / whole,
                one_sided.get(frozenset(t.key for t in m.terms), ()),
            )
            for m, weight in others
        ),
    )


def _taken(
    mechanisms: Sequence[Mechanism],
) -> tuple[set[frozenset[TermKey]], dict[frozenset[TermKey], tuple[Mechanism, ...]]]:
    """(screws of which no cell is offered beside the mechanisms; the mechanisms by their screws
    that have these with one sign only: with the other they are a cell without a name)."""
    by_screws: dict[frozenset[TermKey], list[Mechanism]] = {}
    for m in mechanisms:
        by_screws.setdefault(frozenset(t.key for t in m.terms), []).append(m)
    one_sided = {
        key: tuple(same)
        for key, same in by_screws.items()
        if not any(0 in m.signs for m in same) and len({m.signs for m in same}) == 1
    }
    return set(by_screws) - set(one_sided), one_sided


def _distinct(problem: Problem, mechanisms: Sequence[Mechanism]) -> list[Mechanism]:
    """Of a scanned mechanism's constants, those that differ on these rows: a step between the same
    two configurations is one."""
    seen: set[tuple[object, ...]] = set()
    out = []
    for m in mechanisms:
        values = (np.asarray(problem.cause(s.cause)).tobytes() for t in m.terms for s in t.screws)
        key = (m.name, *((s.frame, s.axis) for t in m.terms for s in t.screws), *values)
        if key not in seen:
            seen.add(key)
            out.append(m)
    return out


def choose_strongest(
    found: Sequence[Candidate],
    single_f: Array,
    named: Sequence[Candidate] = (),
    most: int = MAX_CANDIDATES,
) -> tuple[tuple[Mechanism, ...], tuple[str, ...]]:
    """(at most `most` registered mechanisms: the `named`, then those of largest single F, in the
    registry's order; names of the others). Of a scanned mechanism the best constant, or the named
    one, stands for it."""
    best: dict[str, tuple[float, int]] = {}
    for g, candidate in enumerate(found):
        f = np.inf if any(candidate is n for n in named) else float(single_f[g])
        if candidate.registered and f > best.get(candidate.mechanism.name, (0.0, -1))[0]:
            best[candidate.mechanism.name] = (f, g)
    ranked = [g for _, g in sorted(best.values(), key=lambda pair: -pair[0])]
    screws = {g: {t.key for t in found[g].mechanism.terms} for g in ranked}
    first = {g for f, g in best.values() if f == np.inf}
    parts = {g for g in ranked if g not in first and any(screws[g] < screws[h] for h in first)}
    unions = {
        g
        for g in ranked
        if g not in first
        and screws[g] == set().union(*(screws[h] for h in ranked if screws[h] < screws[g]))
    }
    single = [
        g for g in ranked if g not in unions | parts
    ]  # gravity-twist is joint2-twist and joint3-twist, no third thing
    aside = tuple(found[g].mechanism.name for g in ranked if g not in single[:most])
    return tuple(found[g].mechanism for g in sorted(single[:most])), aside
