"""Simple shapes beside the free functions that stand against a finding: few numbers, many constants.

A wave of a joint may be the first of a saw's; what two drivers do may be a product of two functions
that level off. Where one of them holds, it leaves less open than a free function."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import permutations, product

import numpy as np

from ..fitting.problem import Problem
from ..mechanisms.causes import Applied, Cause, q, shifted
from ..mechanisms.motors import joint_axis
from ..mechanisms.terms import Mechanism
from .arm_shapes import build_pulls, choose_onsets
from .driver_functions import level_off, scale_driver
from .unregistered import build_cell

# how far two drivers go beyond the linear part of what levels off
STRENGTHS = (1.5, 3.0)
# shares of a joint's range beyond which it may pull another one
ONSETS = tuple(k / 20 for k in range(2, 19))
# moments in a saw's tooth at which it may fall back
FALLS = 128
WAVE = re.compile(r"(?:sin|cos)\((?:([\d.]+)\*)?q\d+\)")


def generate_products(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate products of functions of a finding's two drivers at its one place: a function of one
    of them, and that times one of the other. None for any other finding."""
    parts = found.names_by_place()
    drivers = sorted(found.names())
    if len(parts) != 1 or len(drivers) != 2:
        return
    (place,) = parts
    functions: dict[str, list[Cause]] = {}
    for name in drivers:
        if np.ptp(problem.state.value(name)) == 0:
            return
        bent = [level_off(problem, name, strength) for strength in STRENGTHS]
        functions[name] = [scale_driver(problem, name), *bent]
    for first, second in permutations(drivers):
        for one, other in product(functions[first], functions[second]):
            yield build_cell(place, (one, one * other))


def generate_saws(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate saws of as many teeth a turn as a joint's wave has, which fall back between readings
    that were measured. None for any other finding."""
    joint, teeth = find_own_wave(found)
    if not teeth:
        return
    ((place, _),) = found.names_by_place().items()
    angle = float(teeth) * q(joint)
    phases = np.unique(np.mod(teeth * problem.data.q[:, joint - 1], 2 * np.pi))
    between = phases + 0.5 * np.diff(phases, append=phases[0] + 2 * np.pi)
    chosen = np.linspace(0, len(between) - 1, min(FALLS, len(between))).round().astype(np.intp)
    often = f"{teeth} times a turn" if teeth > 1 else "once a turn"
    for fall in between[chosen]:
        saw = Applied("saw", shifted(angle, -float(f"{fall:.6g}")))
        sentence = f"Joint {joint} errs more and more and falls back, {often}"
        yield build_cell(place, (saw,), sentence=sentence)


def generate_pulls(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate pulls of a joint by another one, beyond many readings of that. None for a finding
    that does not turn one joint with another one's reading."""
    parts = found.names_by_place()
    ((joint, axis), drivers), *others = parts.items()
    joints = problem.robot.joints
    turning = [f"q{k}" for k, one in enumerate(joints, 1) if k != joint and not one.prismatic]
    is_turn = joint <= len(joints) and axis == joint_axis(problem.robot, joint) == "rz"
    if others or len(drivers) != 1 or not is_turn or not drivers <= set(turning):
        return
    (driver,) = drivers
    for onset in choose_onsets(problem.state.value(driver), ONSETS):
        yield from build_pulls(joint, int(driver[1:]), onset)


def find_own_wave(found: Mechanism) -> tuple[int, int]:
    """Find the joint of whose own angle a finding is a wave, and how many it has a turn: 0 where it
    is none, or no whole number."""
    parts = found.names_by_place()
    ((joint, _), drivers), *others = parts.items()
    waves = [WAVE.fullmatch(str(term.screws[0].cause)) for term in found.terms]
    counts = [float(wave[1] or 1) for wave in waves if wave]
    is_own = not others and drivers == {f"q{joint}"} and len(counts) == len(waves)
    if not is_own or min(counts) % 1:
        return joint, 0
    return joint, int(min(counts))
