"""What rounding of the joint readings does to the target, beside the noise.

A reading that is rounded to a step d is off by an error uniform within the step, whose variance is
d² / 12: the joint's column of the Jacobian makes a displacement of it. Whether readings were rounded or
commanded so, no reading tells; what a model leaves tells that they were not rounded, where rounding
alone would leave more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..._typing import Array
from ...exceptions import sentence_list, write_rounded
from ...fitting.design import PLACE, field_of
from ...fitting.least_squares import Fit
from ...fitting.problem import Problem
from ...mechanisms.motors import joint_axis
from ...notices import Note
from .rounded_readings import Rounding, find_rounding

# rows that are looked at, at most
MAX_ROWS = 4000
# of the noise: a part of it below a third is commonly neglected (Eurachem/CITAC guide to uncertainty,
# QUAM), as the others alone would be no more than 6 % smaller
MATTERS = 1 / 3
# probability below which rounding does not leave as little as is left
MAX_CHANCE = 0.01


def note_rounding(
    problem: Problem, fitted: Fit, left_mm: float | None, floor_mm: float
) -> tuple[Note, ...]:
    """Say which joints' readings are multiples of a coarse step, where rounding to it matters beside the
    noise of a row.

    `problem`: the rows that a model was `fitted` to, of which it leaves `left_mm` rms. The noise is
    that, corrected for the model's parameters, or `floor_mm` where that is larger: repeats and pairs
    of targets do not show what all rows of a configuration share, as they do rounding. Joints whose
    rounding would leave more are not said: these readings were not rounded."""
    rounding = find_rounding(problem.data)
    if not rounding or not left_mm or fitted.freedom <= 0:
        return ()
    moved = _measure_moved(problem, rounding)
    readings = problem.data.configurations
    left = _Left(left_mm, fitted.freedom / fitted.rows, readings)
    kept = {joint: mm for joint, mm in moved.items() if left.allows(mm)}
    sizes = list(kept.values())
    together = float(np.linalg.norm(sizes))
    noise_mm = max(floor_mm, left.noise_mm)
    if together < MATTERS * noise_mm or not left.allows(together):
        return ()
    steps = _list_steps(list(kept), rounding)
    off = write_rounded(together, 2)
    beside = f"where the noise in all is {write_rounded(noise_mm, 2)} mm"
    if together >= noise_mm:
        # the noise is estimated: a part that makes all of it up may come out larger
        beside = "as much as the noise in all"
    sentence = (
        f"The readings of {steps}. If they were rounded to that, and not commanded so, this alone puts "
        f"the target {off} mm rms off, {beside}: record them with more digits."
    )
    return (Note("readings-rounded", sentence),)


def _measure_moved(problem: Problem, rounding: Mapping[str, Rounding]) -> dict[int, float]:
    """Measure how far [mm rms] its rounding moves the target, of every joint that is rounded."""
    step = max(len(problem) // MAX_ROWS, 1)
    some = problem.take(slice(None, None, step)).bare
    everything = slice(0, len(some))
    field = field_of(some, some.pose(everything), everything)
    moved = {}
    for number in range(1, problem.robot.n + 1):
        known = rounding.get(f"joint {number}")
        if known is None:
            continue
        axis = PLACE[joint_axis(problem.robot, number)]
        shift: Array = field[number - 1, axis, :3]
        squares = np.square(shift)
        length = np.sqrt(squares.sum(0).mean())
        moved[number] = float(length) * known.scale
    return moved


class _Left(NamedTuple):
    """What a model leaves: the rms length of a row [mm], the share of the rows' freedom that it has not
    used, and the number of readings of each joint."""

    mm: float
    freedom_share: float
    readings: int

    @property
    def noise_mm(self) -> float:
        """The rms length of a row's noise [mm], as the model leaves it."""
        return float(self.mm / np.sqrt(self.freedom_share))

    def allows(self, moved_mm: float) -> bool:
        """Whether errors of so many mm rms, one a reading, may leave as little as this."""
        from scipy.special import chdtr

        if moved_mm == 0:
            return True
        freedom = self.readings * self.freedom_share
        ratio = (self.noise_mm / moved_mm) ** 2
        chance = chdtr(freedom, freedom * ratio)
        return bool(chance > MAX_CHANCE)


def _list_steps(joints: Sequence[int], rounding: Mapping[str, Rounding]) -> str:
    """List which joints' readings are multiples of which steps."""
    by_step: dict[str, list[str]] = {}
    for joint in joints:
        known = rounding[f"joint {joint}"]
        of_step = by_step.setdefault(known.step, [])
        of_step.append(str(joint))
    parts = []
    for step, numbers in by_step.items():
        noun = "joint" if len(numbers) == 1 else "joints"
        part = f"{noun} {sentence_list(numbers)} are multiples of {step}"
        parts.append(part)
    return ", those of ".join(parts)
