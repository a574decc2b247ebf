"""Simple shapes beside the free functions that stand against a finding: few numbers, many constants.

A wave of a joint may be the first of a saw's; what two drivers do may be a product of two functions
that level off; a joint may lag behind its last move by an amount that levels off. Where one of them holds, it leaves less open than a free function."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations, product

import numpy as np

from ..._typing import Array
from ...fitting.problem import Problem
from ...mechanisms.causes import Applied, Cause, Named, q, shifted
from ...mechanisms.motors import joint_axis
from ...mechanisms.terms import Mechanism
from ..shapes.arm_shapes import build_pulls, choose_onsets, find_turning_reading
from ..shapes.driver_functions import STILL, level_off, scale_driver
from ..shapes.joint_bumps import describe_reading
from ..shapes.shape_constants import find_own_wave
from ..shapes.unregistered import build_cell

# how far two drivers go beyond the linear part of what levels off, and in the middle of which part
# of their range, from -1 to 1, they are linear
STRENGTHS = (1.5, 3.0)
CENTRES = (-0.4, 0.0, 0.4)
# shares of a joint's range beyond which it may pull another one
ONSETS = tuple(k / 20 for k in range(2, 19))
# moments in a saw's tooth at which it may fall back
FALLS = 128
# what has such lags, as far as is known
BEFORE_SLIDING = (
    "friction before it slides",
    "play between soft faces",
    "a controller's dead band",
)
# shares of a joint's moves that are shorter than what a lag takes to level off
LEVELLED = (0.1, 0.2, 0.35, 0.5, 0.7)


def generate_products(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate products of functions of a finding's two drivers at its one place: a function of one
    of them, and that times one of the other. None for any other finding."""
    places = list(found.names_by_place())
    drivers = sorted(found.names())
    if len(places) != 1 or len(drivers) != 2:
        return
    if not all(_varies(problem, name) for name in drivers):
        return
    functions = {name: _list_functions(problem, name) for name in drivers}
    for first, second in permutations(drivers):
        pairs = product(functions[first], functions[second])
        for one, other in pairs:
            both = one * other
            yield build_cell(places[0], (one, both))


def _varies(problem: Problem, name: str) -> bool:
    values = problem.state.value(name)
    width = np.ptp(values)
    return bool(width)


def _list_functions(problem: Problem, name: str) -> list[Cause]:
    """List what may be a factor: a driver as it is, and levelling off."""
    straight = scale_driver(problem, name)
    functions = [straight]
    for strength, centre in product(STRENGTHS, CENTRES):
        bent = level_off(problem, name, strength, centre)
        functions.append(bent)
    return functions


def generate_saws(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate saws of as many teeth a turn as a joint's wave has, which fall back between readings
    that were measured. None for any other finding."""
    joint, count = find_own_wave(found)
    if not count or count % 1:
        return
    teeth = int(count)
    (place,) = found.names_by_place()
    angle = count * q(joint)
    readings = problem.data.q[:, joint - 1]
    often = "once a turn"
    if teeth > 1:
        often = f"{teeth} times a turn"
    for fall in _choose_falls(teeth * readings):
        saw = Applied("saw", shifted(angle, -fall))
        yield build_cell(
            place=place,
            causes=(saw,),
            sentence=f"Joint {joint} errs more and more and falls back, {often}",
        )


def _choose_falls(angles: Array) -> Iterator[float]:
    """Choose angles within a turn between those that were measured, at most FALLS."""
    turn = 2 * np.pi
    phases = np.mod(angles, turn)
    distinct = np.unique(phases)
    end = distinct[0] + turn
    gaps = np.diff(distinct, append=end)
    half_gaps = 0.5 * gaps
    between = distinct + half_gaps
    number = len(between)
    count = min(FALLS, number)
    chosen = np.linspace(0, number - 1, count)
    for place in chosen:
        nearest = round(place)
        fall = between[nearest]
        rounded = f"{fall:.6g}"
        yield float(rounded)


def generate_pulls(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate pulls of a joint by another one, beyond many readings of that. None for a finding
    that does not turn one joint with another one's reading."""
    known = find_turning_reading(problem.robot, found)
    if known is None:
        return
    joint, other = known
    if joint == other:
        return
    readings = problem.data.q[:, other - 1]
    for onset in choose_onsets(readings, ONSETS):
        yield from build_pulls(joint, other, onset)


def generate_soft_lags(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate lags of a joint behind its last move that level off, as friction has them before it
    slides (Dahl 1968, Aerospace Corp. TOR-0158(3107-18)-1). None for a finding that does not move one
    joint with its own last move, or with the side that it came from."""
    places = list(found.names_by_place())
    joint, _ = places[0]
    motion = {f"approach{joint}", f"move{joint}"}
    if joint > problem.robot.n or not found.names() or not found.names() <= motion:
        return
    if places != [(joint, joint_axis(problem.robot, joint))]:
        return
    name = f"move{joint}"
    units = problem.names()
    lengths = problem.state.value(name) if name in units else np.zeros(0)
    travelled = lengths[lengths > STILL]
    if not len(travelled):
        return
    side = Named(f"approach{joint}")
    move = Named(name, units[name])
    for distance in np.quantile(travelled, LEVELLED):
        rounded = float(f"{distance:.6g}")
        levelled = Applied("tanh", move / rounded)
        over = describe_reading(problem.robot.joints[joint - 1], rounded, rounded / 10)
        lag = build_cell(
            place=places[0],
            causes=(side * levelled,),
            words=f"a part of the last move that levels off over {over}",
            sentence=f"Joint {joint} is off its reading by a part of its last move that levels off over {over}",
        )
        yield replace(lag, usual_causes=BEFORE_SLIDING)
