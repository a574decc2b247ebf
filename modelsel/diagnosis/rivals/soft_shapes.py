"""Soft shapes: functions of one driver that level off by and by, without a corner or a period.

A spring that stiffens resembles a power of its torque, or a proportion and a step; a soft step over a
part of a turn resembles a wave. Where a soft shape would do as well, the driver is proven, its shape is
not."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from ...fitting.problem import Problem
from ...mechanisms.causes import Applied, Cause
from ...mechanisms.compliance import PAYLOAD
from ...mechanisms.motors import joint_axis
from ...mechanisms.terms import Mechanism
from ...robot.gravity import find_gravity_joints
from ..inference.credible_sets import ALIKE
from ..shapes.distinct_places import Place
from ..shapes.driver_functions import scale_driver
from ..shapes.shape_constants import find_own_wave
from ..shapes.torque_powers import build_powers, scale_torque
from ..shapes.unregistered import build_cell
from ..shapes.whole_torques import find_load, list_torques

# typical torques by how far a spring that levels off is softer than at none, and one that stiffens
# as a root does
LEVELLING = (0.25, 0.5, 1.0, 2.0, 4.0)
STIFFENING = (2.0, 8.0)
# typical torques up to which a spring of two stiffnesses has the first one
CORNERS = (0.25, 0.5, 1.0)
# where a soft step of a joint is steepest, in its range from -1 to 1, and how steep it is there
CENTRES = tuple(k / 20 for k in range(-12, 13))
SLOPES = (0.8, 1.0, 1.25, 1.55, 1.95, 2.45, 3.1, 4.0)
# soft steps that are far enough apart to count each as much as a shape without a constant
DISTINCT = 40
# waves over a joint's range from which a single step is no rival
MOST_WAVES = 1.5
TURN = 2 * np.pi


def generate_soft_springs(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate springs that stiffen with the torque about a joint, beside a power of it. None for any
    other finding."""
    joint, _ = next(iter(found.names_by_place()))
    if joint > problem.robot.n:
        return
    load = find_load(problem.robot, joint, found.names())
    if load is None:
        return
    powers = build_powers(problem, joint, load)
    if found in powers.values():
        yield from build_soft_springs(problem, joint, load)


def build_soft_springs(
    problem: Problem, joint: int, load: Cause | None = None
) -> Iterator[Mechanism]:
    """Build a joint's motions with functions of its torque that rise less and less; none without load.
    `load`: as of `build_powers`."""
    share = scale_torque(problem, joint, load)
    if share is None:
        return
    place = joint, joint_axis(problem.robot, joint)
    size = Applied("abs", share)
    for factor in LEVELLING:
        softer = factor * size + 1.0
        yield build_cell(place, (share / softer,))
    side = Applied("sign", share)
    for factor in STIFFENING:
        grown = factor * size + 1.0
        beyond = Applied("root", grown) - 1.0
        yield build_cell(place, (side * beyond,))


def build_cornered_springs(
    problem: Problem, joint: int, load: Cause | None = None
) -> Iterator[Mechanism]:
    """Build a joint's motions with its torque by one stiffness up to a corner, by another beyond it, as a
    catalogue of strain wave gears has it; none without load. `load`: as of `build_powers`."""
    share = scale_torque(problem, joint, load)
    if share is None:
        return
    place = joint, joint_axis(problem.robot, joint)
    for corner in CORNERS:
        above = Applied("abs", share + corner)
        below = Applied("abs", share - corner)
        yield build_cell(place, (share, above - below))


def list_springs(problem: Problem, place: Place, found: Sequence[Mechanism]) -> list[Mechanism]:
    """List powers of the torque about a joint and springs that stiffen, which several findings at its
    motion may approximate: one that follows this torque, or its sign, and others of it or of the
    readings that it depends on. Beside a play those of two stiffnesses are among them."""
    joint, axis = place
    robot = problem.robot
    loaded = find_gravity_joints(robot)
    if joint not in loaded or axis != joint_axis(robot, joint):
        return []
    own, *others = list_torques(robot, joint)
    drivers = frozenset[str]().union(*(m.names() for m in found))
    load = next((whole for whole in others if PAYLOAD in drivers), own)
    readings = (f"q{j}" for j in loaded)
    possible = {*load.names(), *readings}
    follow = [_follows_torque(problem, m, place, load) for m in found]
    is_alike = all(
        follows or m.names() <= possible for follows, m in zip(follow, found, strict=True)
    )
    if not is_alike or not any(follow):
        return []
    powers = build_powers(problem, joint, load)
    springs = [*powers.values(), *build_soft_springs(problem, joint, load)]
    if any(_is_play(problem, m) for m in found):
        springs += build_cornered_springs(problem, joint, load)
    return springs


def _is_play(problem: Problem, found: Mechanism) -> bool:
    """Return whether a finding has two sides and nothing between, as a play that gravity closes has."""
    cause = found.terms[0].screws[0].cause
    values = np.asarray(cause.of(problem.state))
    sides = np.unique(np.sign(values))
    return len(sides) > 1 and np.unique(values).size <= len(sides)


def _follows_torque(problem: Problem, found: Mechanism, place: Place, load: Cause) -> bool:
    """Return whether a finding of one number moves a place in proportion to the torque about that joint
    or to its sign."""
    screws = [screw for screw in found.terms[0].screws if (screw.frame, screw.axis) == place]
    if len(found.terms) > 1 or len(screws) != 1:
        return False
    torque = np.asarray(load.of(problem.state))
    values = np.asarray(screws[0].cause.of(problem.state))
    if not np.ptp(values) or not np.ptp(torque):
        return False
    sides = np.sign(torque)
    loads = [load for load in (torque, sides) if np.ptp(load)]
    return any(abs(np.corrcoef(values, load)[0, 1]) > ALIKE for load in loads)


def list_soft_steps(problem: Problem, found: Sequence[Mechanism]) -> list[Mechanism]:
    """List soft steps of a joint's own reading which several findings may approximate, all waves of it."""
    counts = [find_own_wave(m)[1] for m in found]
    if not all(counts):
        return []
    steps = [step for m in found for step in generate_soft_steps(problem, m)]
    return list(dict.fromkeys(steps))


def generate_soft_steps(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate soft steps of a joint's own reading, beside a wave of it of which little more than one
    is within its range. None for any other finding."""
    joint, count = find_own_wave(found)
    if not count:
        return
    readings = problem.data.q[:, joint - 1]
    waves = count * np.ptp(readings) / TURN
    if not 0 < waves < MOST_WAVES:
        return
    (place,) = found.names_by_place()
    scaled = scale_driver(problem, f"q{joint}")
    for slope, centre in product(SLOPES, CENTRES):
        offset = slope * (scaled - centre)
        root = Applied("root", offset * offset + 1.0)
        for step in (Applied("tanh", offset), offset / root):
            yield build_cell(place, (step,))
