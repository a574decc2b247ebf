"""Kinks: a joint that errs in proportion to how far its own reading, or another joint's, is beyond some angle,
on one side of it or on both.

A hose that tightens there, a spring or a stop that is reached has them. A smooth function rounds them off, and what
it leaves was told as further effects."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..._typing import Array
from ...fitting.problem import Problem
from ...mechanisms.causes import Applied, Combined, Named, Number, q, shifted
from ...mechanisms.terms import Mechanism
from ...robot.rigid import AXES
from ..shapes.arm_shapes import build_excesses, choose_onsets, find_turning_reading
from ..shapes.unregistered import build_cell

# readings at which a joint may begin to err: so many in the range, or more where that leaves more than so much
# [rad] between two; and how often their distance is halved around a found one
STEPS, WIDEST = 48, 0.1
HALVINGS = 6
TIGHTENING = ("hose or cable that tightens", "spring or stop that is reached")
# what is seen of a reading: how far it is above an angle, below it, or from it
SIDES = {"above": "above {}", "below": "below {}", "both": "from {}, on either side"}


def generate_kinks(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate kinks of a joint at many readings of a finding's driver, and at that of a found one. None for a
    finding that does not turn one joint with one reading."""
    known = find_turning_reading(problem.robot, found)
    if known is None:
        return
    joint, other = known
    readings = problem.data.q[:, other - 1]
    steps = _count_steps(readings)
    shares = [k / steps for k in range(1, steps)]
    onsets = choose_onsets(readings, shares)
    kink = _read_kink(found)
    if kink is not None:
        onsets.append(kink[0])
    for onset in onsets:
        for side in SIDES:
            yield build_kink(joint, other, onset, side)


def list_kinks_together(problem: Problem, mechanisms: Sequence[Mechanism]) -> list[Mechanism]:
    """List the kinks that may stand for several findings, all of which turn one joint with one reading."""
    drivers = {find_turning_reading(problem.robot, found) for found in mechanisms}
    if len(drivers) > 1 or None in drivers:
        return []
    kinks: dict[Mechanism, None] = {}
    for found in mechanisms:
        for kink in generate_kinks(problem, found):
            kinks[kink] = None
    for found in mechanisms:
        kinks.pop(found, None)
    return list(kinks)


def generate_finer_kinks(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate kinks near a found one, of its side. None for any other finding."""
    known = find_turning_reading(problem.robot, found)
    kink = _read_kink(found)
    if known is None or kink is None:
        return
    joint, other = known
    onset, side = kink
    readings = problem.data.q[:, other - 1]
    step = float(np.ptp(readings)) / _count_steps(readings)
    for halving in range(HALVINGS):
        away = step / 2**halving
        for nearby in (onset - away, onset + away):
            rounded = float(f"{nearby:.4g}")
            yield build_kink(joint, other, rounded, side)


def _count_steps(readings: Array) -> int:
    """Count the steps into which the range of readings is parted."""
    width = np.ptp(readings)
    steps = math.ceil(width / WIDEST)
    return max(STEPS, steps)


def build_kink(joint: int, other: int, onset: float, side: str) -> Mechanism:
    """Build the error of a joint in proportion to how far a joint's reading is beyond an angle [rad]; `side`: one
    of SIDES."""
    size = Applied("abs", shifted(q(other), -onset))
    causes = {"both": size, **build_excesses(other, onset)}
    where = SIDES[side].format(f"{np.degrees(onset):.1f}°")
    whose = "it" if other == joint else f"joint {other}"
    cell = build_cell(
        place=(joint, AXES[5]),
        causes=(causes[side],),
        words=f"how far q{other} is {where}",
        sentence=f"Joint {joint} turns in proportion to how far {whose} reads {where}",
    )
    return replace(cell, usual_causes=TIGHTENING)


def _read_kink(found: Mechanism) -> tuple[float, str] | None:
    """Read the angle and the side off what `build_kink` has built; None of anything else."""
    if len(found.terms) != 1 or len(found.terms[0].screws) != 1:
        return None
    match found.terms[0].screws[0].cause:
        case Applied("abs", beyond):
            side = "both"
        case Combined("*", Number(0.5), Combined(("+" | "-") as sign, Applied("abs", beyond), _)):
            side = "above" if sign == "+" else "below"
        case _:
            return None
    match beyond:
        case Combined("-", Named(), Number(onset)):
            return onset, side
        case Combined("+", Named(), Number(less)):
            return -less, side
        case Named():
            return 0.0, side
        case _:
            return None
