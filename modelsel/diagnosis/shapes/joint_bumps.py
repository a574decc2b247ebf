"""Errors that a joint has around one reading: a damaged tooth, a dent of a bearing's race, a cable that
catches. They are told as what they are, without a cause."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np

from ..._typing import Array
from ...fitting.problem import Problem
from ...fitting.splines import spline
from ...mechanisms.causes import Applied, Combined, Named, Number, q, shifted
from ...mechanisms.motors import joint_axis
from ...mechanisms.terms import Mechanism
from ...robot.kinematics import Joint, Robot
from .driver_functions import STILL
from .unregistered import build_cell

# width at half of the height that others are counted in: of a turning joint [rad], and of a slide as a
# share of its travel
TURN = float(f"{np.radians(20.0):.6g}")
TRAVEL = 1 / 16
# half of the width at half of the height over the standard deviation
HALF = float(np.sqrt(2 * np.log(2)))
# how many centres and which widths have what stands against another function of a reading
CENTRES = 24
OTHERS = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8)
# how far others stand beside a found one, in its widths, and how wide they are
SHIFTS = tuple(k / 8 for k in range(-4, 5))
FACTORS = (0.5, 0.6, 0.7, 0.85, 1.0, 1.2, 1.4, 1.7, 2.0)
# widths that are looked for, counted in it, and how far apart their centres stand, in widths
WIDTHS = (0.6, 1.2, 2.4)
APART = 1 / 3
# configurations that a width needs, and that the rest of the range needs
MIN_INSIDE = 4
# most centres of a width
MOST_CENTRES = 128
# what has such errors, as far as is known
PARTS = ("damaged tooth or bearing", "cable or hose that catches", "dirt on the encoder's ring")


def build_bump(robot: Robot, joint: int, centre: float, width: float) -> Mechanism:
    """Build a joint's motion by exp(-(q - centre)² / 2σ²), `width` wide [rad or mm] at half its height."""
    deviation = 0.5 * width / HALF
    twice = float(f"{2 * deviation * deviation:.6g}")
    offset = shifted(q(joint, robot.unit(joint)), -centre)
    cause = Applied("exp", offset * offset / -twice)
    own = robot.joints[joint - 1]
    where = describe_reading(own, centre, width / 10)
    wide = describe_reading(own, width, width / 10)
    bump = build_cell(
        place=(joint, joint_axis(robot, joint)),
        causes=(cause,),
        words=f"a bump around q{joint} = {where}, {wide} wide",
        sentence=f"Joint {joint} errs around a reading of {where}, over about {wide}",
    )
    return replace(bump, usual_causes=PARTS)


def generate_likely_bumps(problem: Problem) -> Iterator[tuple[Mechanism, int]]:
    """Generate the bumps of every joint that are looked for, and how many the joint has: where enough
    configurations are within their width, and beyond it."""
    data = problem.data
    _, first = np.unique(data.block, return_index=True)
    for column, joint in enumerate(problem.robot.joints):
        readings = np.sort(data.q[first, column])
        unit = _choose_unit(joint, readings)
        bumps = [
            build_bump(problem.robot, column + 1, centre, width)
            for width in (float(f"{factor * unit:.6g}") for factor in WIDTHS if unit)
            for centre in _list_centres(readings, width)
        ]
        for bump in bumps:
            yield bump, len(bumps)


def _choose_unit(joint: Joint, readings: Array) -> float:
    """Choose the width that others are counted in [rad or mm]; nought for a joint at rest."""
    travel = float(np.ptp(readings))
    if travel <= STILL:
        return 0.0
    return TRAVEL * travel if joint.prismatic else TURN


def _list_centres(readings: Array, width: float) -> list[float]:
    """List where bumps of a width may be, by the sorted readings of a joint, one a configuration."""
    step = APART * width
    numbers = np.unique(np.round(readings / step))
    beside = np.array([-1.0, 0.0, 1.0])
    centres = np.unique(numbers[:, None] + beside) * step
    half = width / 2
    inside = np.searchsorted(readings, centres + half) - np.searchsorted(readings, centres - half)
    is_told = (inside >= MIN_INSIDE) & (len(readings) - inside >= MIN_INSIDE)
    told = centres[is_told]
    count = min(len(told), MOST_CENTRES)
    chosen = np.linspace(0, max(len(told) - 1, 0), count).round().astype(np.intp)
    return [float(f"{centre:.6g}") for centre in told[chosen] + 0.0]


def generate_bumps(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate bumps that stand against another function of a joint's own reading. None for any other
    finding, for a bump, and for a free function, which shows a bump as it is."""
    robot = problem.robot
    places = list(found.names_by_place())
    joint, axis = places[0]
    is_own = found.names() == {f"q{joint}"} and len(places) == 1
    if not is_own or axis != joint_axis(robot, joint):
        return
    if _read_bump(found) or spline(found.terms[0]):
        return
    readings = problem.data.q[:, joint - 1]
    shares = (np.arange(CENTRES) + 0.5) / CENTRES
    unit = _choose_unit(robot.joints[joint - 1], readings)
    if not unit:
        return
    for centre, factor in product(np.quantile(readings, shares), OTHERS):
        place = float(f"{centre:.6g}")
        width = float(f"{factor * unit:.6g}")
        yield build_bump(robot, joint, place, width)


def generate_finer_bumps(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate bumps near a found one, narrower and wider ones too. None for any other finding."""
    known = _read_bump(found)
    if known is None:
        return
    joint, centre, width = known
    for shift, factor in product(SHIFTS, FACTORS):
        moved = centre + shift * width
        wider = factor * width
        place = float(f"{moved:.6g}")
        wide = float(f"{wider:.6g}")
        finer = build_bump(problem.robot, joint, place, wide)
        if finer != found:
            yield finer


def _read_bump(found: Mechanism) -> tuple[int, float, float] | None:
    """Read (joint, centre, width) off what `build_bump` has built; None of anything else."""
    screw = found.terms[0].screws[0]
    match screw.cause:
        case Applied("exp", Combined("/", Combined("*", offset, _), Number(minus_twice))):
            pass
        case _:
            return None
    match offset:
        case Combined("-", Named(), Number(centre)):
            pass
        case Combined("+", Named(), Number(less)):
            centre = -less
        case Named():
            centre = 0.0
        case _:
            return None
    deviation = np.sqrt(-minus_twice / 2)
    width = 2 * HALF * deviation
    return screw.frame, centre, float(width)


def describe_reading(joint: Joint, reading: float, step: float | None = None) -> str:
    """Describe a joint's reading [rad or mm], in degrees where it turns, with digits that tell two of
    them apart which differ by a `step`."""
    shown, unit = (reading, " mm") if joint.prismatic else (np.degrees(reading), "°")
    if step is None:
        # the least digits that a reading is told with: a degree, or four of a slide's
        return f"{shown:.4g}{unit}" if joint.prismatic else f"{shown + 0.0:.0f}{unit}"
    least = step if joint.prismatic else np.degrees(step)
    digits = max(0, -int(np.floor(np.log10(least))))
    rounded = round(float(shown), digits) + 0.0
    return f"{rounded:.{digits}f}{unit}"
