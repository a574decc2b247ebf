"""Explanations that nobody registered: cells of the error map, waves and free functions of a joint.

A cell is a place (an axis of a frame) with a cause: one function of the state, a sine and a cosine
(a wave of unknown phase), or any product of a wave of one joint and a wave of another. Waves of a
joint's own angle and free functions act at the joint's own rotation only."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ..._typing import Array
from ...fitting.problem import Problem
from ...measurements.campaign.reference_temperature import TEMPERATURE
from ...measurements.campaign.state_names import parse_state_name
from ...mechanisms.causes import Applied, Bump, Cause, Named, cos, q, sign, sin, torque
from ...mechanisms.drives import RIPPLING_PARTS, WAVES, wave_terms
from ...mechanisms.environment import temperature_rise
from ...mechanisms.gravity_effects import forearm_lever, upper_arm_lever
from ...mechanisms.terms import Mechanism, Screw, Term
from ...robot.gravity import find_arm_pair, find_gravity_joints
from ...robot.kinematics import Robot
from ...robot.rigid import AXES
from .campaign_clocks import build_warming_causes
from .candidate_kinds import CandidateKind
from .distinct_places import Place, find_frames
from .slide_waves import generate_pitch_waves

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
# how far apart these stand
QUARTER = BETWEEN[1] - BETWEEN[0]
# prior weight of rarer explanations (waves between whole numbers, free functions); a cell has 1
RARE_WEIGHT = 0.1


class Unregistered(NamedTuple):
    """An explanation that the registry does not have; `weight`: its prior relative to a cell's."""

    mechanism: Mechanism
    kind: CandidateKind
    weight: float


def generate_unregistered(problem: Problem, adjacent_only: bool) -> Iterator[Unregistered]:
    """Generate every unregistered explanation.

    With `adjacent_only`, the error map is restricted to causes of joints at or next to the place."""
    yield from _generate_cells(problem, adjacent_only)
    yield from build_waves(problem.robot)
    kind = CandidateKind.SLIDE_WAVE
    for wave, weight in generate_pitch_waves(problem):
        yield Unregistered(wave, kind, weight)
    kind = CandidateKind.FREE_FUNCTION
    for function in build_free_functions(problem):
        yield Unregistered(function, kind, RARE_WEIGHT)


# The error map: places and causes.


def list_places(problem: Problem) -> tuple[Place, ...]:
    """List (frame, axis) of every place where a screw can show.

    The target frame's rotations show only where orientations are measured."""
    robot = problem.robot
    target = robot.n + 1
    places: list[Place] = []
    for frame in range(1, target):
        places += [(frame, axis) for axis in AXES]
    target_axes = AXES
    if problem.components != 6:
        target_axes = AXES[:3]
    places += [(target, axis) for axis in target_axes]
    return tuple(places)


def list_distinct_places(problem: Problem) -> tuple[Place, ...]:
    """List the places where a screw can show, each motion of the target once."""
    distinct = find_frames(problem.robot)
    return tuple(place for place in list_places(problem) if place in distinct)


def build_cell_causes(problem: Problem) -> tuple[Causes, ...]:
    """List the causes of the error map's columns.

    Each is a tuple of functions with coefficients of their own."""
    return (
        *_causes_of_readings(problem),
        *_causes_of_joint_pairs(problem.robot),
        *_causes_of_gravity(problem.robot),
        *((Named(f"approach{j}"),) for j in range(1, problem.robot.n + 1)),
        *((cause,) for cause in build_warming_causes(problem)),
        *list_covariate_causes(problem),
    )


def _turning_joints(robot: Robot) -> list[int]:
    return [j for j, joint in enumerate(robot.joints, 1) if not joint.prismatic]


def _sliding_joints(robot: Robot) -> list[int]:
    return [j for j, joint in enumerate(robot.joints, 1) if joint.prismatic]


def _causes_of_readings(problem: Problem) -> Iterator[Causes]:
    """Generate causes of single readings.

    Proportional, one and two waves a turn; a slide's bow and thermal scale."""
    robot = problem.robot
    covariates = problem.data.covariates
    for j in range(1, robot.n + 1):
        unit = robot.unit(j)
        yield (q(j, unit),)
    for j in _turning_joints(robot):
        angle = q(j)
        yield sin(angle), cos(angle)
        twice = 2.0 * angle
        yield sin(twice), cos(twice)
    for j in _sliding_joints(robot):
        travel = q(j, "mm")
        square = travel * travel
        yield travel, square
        if TEMPERATURE in covariates:
            rise = temperature_rise(problem.data.reference_celsius)
            yield rise * travel, travel


def _causes_of_joint_pairs(robot: Robot) -> Iterator[Causes]:
    """Generate waves of the sum and of the difference of two angles.

    Together they are any product of a wave of one joint and a wave of the other."""
    turning = _turning_joints(robot)
    for j, k in combinations(turning, 2):
        first = q(j)
        second = q(k)
        total = first + second
        difference = first - second
        of_sum = sin(total), cos(total)
        of_difference = sin(difference), cos(difference)
        yield of_sum
        yield of_difference
        yield of_sum + of_difference


def _causes_of_gravity(robot: Robot) -> Iterator[Causes]:
    """Generate gravity torques of the joints and their signs, and moments of the two long links."""
    loaded = find_gravity_joints(robot)
    for j in loaded:
        yield (torque(j),)
    for j in loaded:
        yield (sign(torque(j)),)
    pair = find_arm_pair(robot)
    if pair is not None:
        yield (forearm_lever(pair),)
        yield (upper_arm_lever(pair),)
        yield (sign(forearm_lever(pair)),)


def list_covariate_causes(problem: Problem) -> Iterator[Causes]:
    """List causes of every further column of the data.

    Temperature counts from its reference; payload also with moments."""
    pair = find_arm_pair(problem.robot)
    units = problem.names()
    reference = problem.data.reference_celsius
    for name in problem.data.covariates:
        if name == TEMPERATURE:
            rise = temperature_rise(reference)
            yield (rise,)
            # what is even about the reference has nothing in common with a slope
            yield (rise * rise,)
        else:
            yield (Named(name, units[name]),)
        if name == "payload_kg" and pair is not None:
            payload = Named(name, "kg")
            yield (payload * forearm_lever(pair),)
            yield (payload * upper_arm_lever(pair),)


def _generate_cells(problem: Problem, adjacent_only: bool) -> Iterator[Unregistered]:
    columns = []
    for causes in build_cell_causes(problem):
        words = " & ".join(map(str, causes))
        columns.append((causes, words, _classify(causes), _find_joints(causes)))
    for place in list_distinct_places(problem):
        frames = find_frames(problem.robot)[place]
        for causes, words, kind, joints in columns:
            if adjacent_only and not any(_is_adjacent(frame, joints) for frame in frames):
                continue
            cell = build_cell(place, causes, words)
            yield Unregistered(cell, kind, weight=1.0)


def _find_joints(causes: Causes) -> set[int]:
    """Find the joints whose readings, torques or approaches some causes depend on."""
    joints: set[int] = set()
    for cause in causes:
        for name in cause.names():
            variable = parse_state_name(name)
            if variable is not None and variable.joint is not None:
                joints.add(variable.joint)
    return joints


def _is_adjacent(frame: int, joints: Iterable[int]) -> bool:
    return all(abs(joint - frame) <= 1 for joint in joints)


def build_cell(place: Place, causes: Causes, words: str = "", sentence: str = "") -> Mechanism:
    """Build the mechanism of some causes at one place; `words` are those of its causes."""
    symbols = [f"m{k}" for k in range(1, len(causes) + 1)] if len(causes) > 1 else ["m"]
    screws = [Screw(*place, cause) for cause in causes]
    terms = tuple(Term(s, (screw,)) for s, screw in zip(symbols, screws, strict=True))
    words = words or " & ".join(map(str, causes))
    return Mechanism(f"{place[0]} {place[1]} {words}", terms, sentence)


def _classify(causes: Causes) -> CandidateKind:
    if len(causes) == 4:
        return CandidateKind.WAVE_PRODUCT
    if len(causes) != 2:
        return CandidateKind.CELL
    for cause in causes:
        if not isinstance(cause, Applied):
            return CandidateKind.CELL
        if cause.function not in ("sin", "cos"):
            return CandidateKind.CELL
    return CandidateKind.WAVE


# Waves and free functions of single joints.


def build_waves(robot: Robot) -> Iterator[Unregistered]:
    """Generate waves of every turning joint's own angle at its own rotation.

    They are 3 to 60 a turn: whole numbers (for joints whose ripple is not registered) and quarters
    between."""
    for j in _turning_joints(robot):
        for counts, weight in ((WAVES, 1.0), (BETWEEN, RARE_WEIGHT)):
            for count in counts:
                wave = build_wave(j, count)
                yield Unregistered(wave, CandidateKind.JOINT_WAVE, weight)


def build_wave(joint: int, count: float) -> Mechanism:
    """Build a wave of a turning joint's own angle, `count` a turn, at its own rotation."""
    return Mechanism(
        name=f"{joint} rz {count:g} waves",
        terms=wave_terms(joint, count, "rz", "m"),
        sentence=f"Joint {joint} turns unevenly, {count:g} waves a turn",
        usual_causes=RIPPLING_PARTS,
    )


def build_free_functions(problem: Problem) -> Iterator[Mechanism]:
    """Generate cubic splines of every turning joint's own angle at its own rotation.

    Knots are 40 to 2 degrees apart, where the data are dense enough to carry them."""
    data = problem.data
    _, first = np.unique(data.block, return_index=True)
    for j in _turning_joints(problem.robot):
        own_readings = data.q[first, j - 1]
        readings = np.sort(own_readings)
        if np.ptp(readings) < MIN_RANGE:
            continue
        for width in KNOTS:
            function = _build_free_function(j, readings, float(width))
            if function is not None:
                yield function


def build_bumps(name: str, low: float, high: float, width: float) -> list[Bump]:
    """Build the splines of a free function of a state variable from `low` to `high`."""
    first, last = np.floor(low / width), np.ceil(high / width)
    return [Bump(name, float(k * width), width) for k in np.arange(first, last + 1)]


def _build_free_function(joint: int, readings: Array, width: float) -> Mechanism | None:
    """Build a spline from sorted readings (k,); None where too few lie between the knots."""
    bumps = build_bumps(f"q{joint}", readings[0], readings[-1], width)
    centres = np.array([bump.centre for bump in bumps])
    upper = np.searchsorted(readings, centres + width)
    counts = upper - np.searchsorted(readings, centres - width)
    if np.median(counts) / 2 < MIN_DENSITY or (counts > 0).sum() < MIN_INTERVALS:
        return None
    terms = tuple(
        Term(f"f{joint}[{np.degrees(bump.centre):.0f}]", (Screw(joint, "rz", bump),))
        for bump, count in zip(bumps, counts, strict=True)
        if count >= MIN_READINGS
    )
    name = f"free(q{joint}) {np.degrees(width):.0f}"
    return Mechanism(
        name,
        terms,
        f"Joint {joint} turns unevenly, in a way that no registered mechanism describes.",
        usual_causes=("strain-wave gear", "encoder", "cable or hose that pulls"),
    )
