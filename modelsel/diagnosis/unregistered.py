"""Explanations that nobody registered: cells of the error map, waves and free functions of a joint.

A cell is a place (an axis of a frame) with a cause: one function of the state, a sine and a cosine
(a wave of unknown phase), or any product of a wave of one joint and a wave of another. Waves of a
joint's own angle and free functions act at the joint's own rotation only."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np

from .._typing import Array
from ..fitting.problem import Problem
from ..measurements.reference_temperature import TEMPERATURE
from ..mechanisms.causes import Applied, Bump, Cause, Named, cos, q, sign, sin, torque
from ..mechanisms.drives import WAVES, wave_terms
from ..mechanisms.environment import temperature_rise
from ..mechanisms.gravity_effects import forearm_lever, upper_arm_lever
from ..mechanisms.terms import Mechanism, Screw, Term
from ..robot.gravity import find_arm_pair, find_gravity_joints
from ..robot.kinematics import Robot
from ..robot.rigid import AXES
from .candidate_kinds import CandidateKind

Place = tuple[int, str]
Causes = tuple[Cause, ...]

# knot distances of free functions [rad]
KNOTS = tuple(np.radians(degrees) for degrees in (40.0, 20.0, 10.0, 4.0, 2.0))
# configurations per knot interval that a free function needs
MIN_DENSITY = 3.0
# smallest range of a joint's readings that carries a free function [rad]
MIN_RANGE = np.radians(20.0)
# knot intervals with data that a free function needs, and configurations that a knot needs
MIN_INTERVALS, MIN_READINGS = 4, 2
# waves a turn that are no whole numbers: a gear ahead of the joint need not close
BETWEEN = tuple(k + part for k in range(3, 60) for part in (0.25, 0.5, 0.75))
# waves over a slide's travel
PITCHES = tuple(k / 8 for k in range(4, 481))
# prior weight of rarer explanations (waves between whole numbers, free functions); a cell has 1
RARE_WEIGHT = 0.1
# time constants of a warm-up, in shares of the campaign
WARM_UP_SHARES = (0.05, 0.1, 0.25, 0.5)


class Unregistered(NamedTuple):
    """An explanation that the registry does not have; `weight`: its prior relative to a cell's."""

    mechanism: Mechanism
    kind: CandidateKind
    weight: float


def generate_unregistered(problem: Problem, adjacent_only: bool) -> Iterator[Unregistered]:
    """Generate every unregistered explanation; with `adjacent_only`, the error map is restricted to
    causes of joints at or next to the place."""
    yield from _generate_cells(problem, adjacent_only)
    yield from build_waves(problem.robot)
    yield from build_pitch_waves(problem)
    for function in build_free_functions(problem):
        yield Unregistered(function, CandidateKind.FREE_FUNCTION, RARE_WEIGHT)


# The error map: places and causes.


def list_places(problem: Problem) -> tuple[Place, ...]:
    """List (frame, axis) of every place where a screw can show: the target frame's rotations only
    where orientations are measured."""
    n = problem.robot.n
    target_axes = AXES if problem.components == 6 else AXES[:3]
    of_arm = [(frame, axis) for frame in range(1, n + 1) for axis in AXES]
    return (*of_arm, *((n + 1, axis) for axis in target_axes))


def build_cell_causes(problem: Problem) -> tuple[Causes, ...]:
    """List the causes of the error map's columns, each a tuple of functions with coefficients of
    their own."""
    return (
        *_causes_of_readings(problem),
        *_causes_of_joint_pairs(problem.robot),
        *_causes_of_gravity(problem.robot),
        *((Named(f"approach{j}"),) for j in range(1, problem.robot.n + 1)),
        *((cause,) for cause in build_warming_causes(problem)),
        *_causes_of_covariates(problem),
    )


def _turning_joints(robot: Robot) -> list[int]:
    return [j for j, joint in enumerate(robot.joints, 1) if not joint.prismatic]


def _sliding_joints(robot: Robot) -> list[int]:
    return [j for j, joint in enumerate(robot.joints, 1) if joint.prismatic]


def _causes_of_readings(problem: Problem) -> Iterator[Causes]:
    """Single readings: proportional, one and two waves a turn; a slide's bow and thermal scale."""
    robot = problem.robot
    for j in range(1, robot.n + 1):
        yield (q(j, robot.unit(j)),)
    for j in _turning_joints(robot):
        yield sin(q(j)), cos(q(j))
        yield sin(2.0 * q(j)), cos(2.0 * q(j))
    for j in _sliding_joints(robot):
        travel = q(j, "mm")
        yield travel, travel * travel
        if TEMPERATURE in problem.data.covariates:
            yield temperature_rise(problem.data.reference_celsius) * travel, travel


def _causes_of_joint_pairs(robot: Robot) -> Iterator[Causes]:
    """Waves of the sum and of the difference of two angles; together, any product of a wave of one
    joint and a wave of the other."""
    for j, k in combinations(_turning_joints(robot), 2):
        of_sum = sin(q(j) + q(k)), cos(q(j) + q(k))
        of_difference = sin(q(j) - q(k)), cos(q(j) - q(k))
        yield of_sum
        yield of_difference
        yield of_sum + of_difference


def _causes_of_gravity(robot: Robot) -> Iterator[Causes]:
    """Gravity torques of the joints and their signs; moments of the arm's two long links."""
    loaded = find_gravity_joints(robot)
    yield from ((torque(j),) for j in loaded)
    yield from ((sign(torque(j)),) for j in loaded)
    pair = find_arm_pair(robot)
    if pair is not None:
        yield (forearm_lever(pair),)
        yield (upper_arm_lever(pair),)
        yield (sign(forearm_lever(pair)),)


def build_warming_causes(problem: Problem) -> Causes:
    """List drift and exponential warm-up, by the clock where the data have one, else by the place
    in the order of motion."""
    covariates = problem.data.covariates
    if "time_s" not in covariates:
        clock: Cause = Named("progress")
        return (clock, *(Applied("exp", clock / -share) for share in WARM_UP_SHARES))
    start, duration = float(covariates["time_s"].min()), float(np.ptp(covariates["time_s"]))
    if not duration:
        return ()
    since_start = Named("time_s", "s") - start if start else Named("time_s", "s")
    constants = (float(f"{share * duration:.6g}") for share in WARM_UP_SHARES)
    return tuple(Applied("exp", since_start / -constant) for constant in constants)


def _causes_of_covariates(problem: Problem) -> Iterator[Causes]:
    """Every further column of the data; temperature from its reference; payload with moments."""
    pair, units = find_arm_pair(problem.robot), problem.names()
    for name in problem.data.covariates:
        if name == TEMPERATURE:
            yield (temperature_rise(problem.data.reference_celsius),)
        else:
            yield (Named(name, units[name]),)
        if name == "payload_kg" and pair is not None:
            yield (Named(name, "kg") * forearm_lever(pair),)
            yield (Named(name, "kg") * upper_arm_lever(pair),)


def _generate_cells(problem: Problem, adjacent_only: bool) -> Iterator[Unregistered]:
    columns = build_cell_causes(problem)
    joints = [_find_joints(causes) for causes in columns]
    for place in list_places(problem):
        for causes, causing in zip(columns, joints, strict=True):
            if not adjacent_only or _is_adjacent(place[0], causing):
                yield Unregistered(_build_cell(place, causes), _classify(causes), 1.0)


def _find_joints(causes: Causes) -> set[int]:
    """Find the joints whose readings, torques or approaches some causes depend on."""
    names = (name for cause in causes for name in cause.names())
    matches = (re.match(r"[a-z]+(\d+)", name) for name in names)
    return {int(match.group(1)) for match in matches if match}


def _is_adjacent(frame: int, joints: Iterable[int]) -> bool:
    return all(abs(joint - frame) <= 1 for joint in joints)


def _build_cell(place: Place, causes: Causes) -> Mechanism:
    symbols = [f"m{k}" for k in range(1, len(causes) + 1)] if len(causes) > 1 else ["m"]
    screws = [Screw(*place, cause) for cause in causes]
    terms = tuple(Term(s, (screw,)) for s, screw in zip(symbols, screws, strict=True))
    return Mechanism(f"{place[0]} {place[1]} {' & '.join(map(str, causes))}", terms)


def _classify(causes: Causes) -> CandidateKind:
    if len(causes) == 4:
        return CandidateKind.WAVE_PRODUCT
    is_wave = all(isinstance(c, Applied) and c.function in ("sin", "cos") for c in causes)
    return CandidateKind.WAVE if len(causes) == 2 and is_wave else CandidateKind.CELL


# Waves and free functions of single joints.


def build_waves(robot: Robot) -> Iterator[Unregistered]:
    """Generate waves of every turning joint's own angle, 3 to 60 a turn, at its own rotation: whole
    numbers (for joints whose ripple is not registered) and quarters between."""
    for j in _turning_joints(robot):
        for counts, weight in ((WAVES, 1.0), (BETWEEN, RARE_WEIGHT)):
            for count in counts:
                sentence = f"Joint {j} turns unevenly: {count:g} waves a turn"
                terms = wave_terms(j, count, "rz", "m")
                mechanism = Mechanism(f"{j} rz {count:g} waves", terms, sentence)
                yield Unregistered(mechanism, CandidateKind.JOINT_WAVE, weight)


def build_pitch_waves(problem: Problem) -> Iterator[Unregistered]:
    """Generate waves of every slide's own reading, half to 60 over the measured travel: a screw's
    pitch, a rack's teeth, a scale's joints.

    The travel is no multiple of their length, so that eighths of a wave are offered, with an eighth
    of the weight each."""
    for j in _sliding_joints(problem.robot):
        travel = float(np.ptp(problem.data.q[:, j - 1]))
        for count in PITCHES if travel > 0 else ():
            mechanism = _build_pitch_wave(j, count, travel)
            yield Unregistered(mechanism, CandidateKind.SLIDE_WAVE, 1 / 8)


def _build_pitch_wave(joint: int, count: float, travel: float) -> Mechanism:
    angle = float(f"{2 * np.pi * count / travel:.6g}") * q(joint, "mm")
    terms = (
        Term("ms", (Screw(joint, "tz", sin(angle)),)),
        Term("mc", (Screw(joint, "tz", cos(angle)),)),
    )
    sentence = f"Joint {joint} slides unevenly, a wave every {travel / count:.3g} mm"
    return Mechanism(f"{joint} tz {count:g} waves", terms, sentence)


def build_free_functions(problem: Problem) -> Iterator[Mechanism]:
    """Generate cubic splines of every turning joint's own angle at its own rotation, with knots 40
    to 2 degrees apart, where the data are dense enough to carry them."""
    first = np.unique(problem.data.block, return_index=True)[1]
    for j in _turning_joints(problem.robot):
        readings = np.sort(problem.data.q[first, j - 1])
        if np.ptp(readings) < MIN_RANGE:
            continue
        for width in KNOTS:
            function = _build_free_function(j, readings, float(width))
            if function is not None:
                yield function


def _build_free_function(joint: int, readings: Array, width: float) -> Mechanism | None:
    """Build a spline from sorted readings (k,); None where too few lie between the knots."""
    first, last = np.floor(readings[0] / width), np.ceil(readings[-1] / width)
    centres = np.arange(first, last + 1) * width
    upper = np.searchsorted(readings, centres + width)
    counts = upper - np.searchsorted(readings, centres - width)
    if np.median(counts) / 2 < MIN_DENSITY or (counts > 0).sum() < MIN_INTERVALS:
        return None
    bumps = [Bump(f"q{joint}", float(centre), width) for centre in centres]
    terms = tuple(
        Term(f"f{joint}[{np.degrees(bump.centre):.0f}]", (Screw(joint, "rz", bump),))
        for bump, count in zip(bumps, counts, strict=True)
        if count >= MIN_READINGS
    )
    name = f"free(q{joint}) {np.degrees(width):.0f}"
    return Mechanism(name, terms, f"Joint {joint} turns unevenly, by a shape no list has.")
