"""Steps of the set-up between two sessions, at the moment where the one ends and the other begins.

What was moved between two groups of measurements stands elsewhere for every row of the later one, for
those that are held out, too. A step that is only placed between two estimation rows leaves such rows on
the wrong side."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from .._typing import Array, Mask
from ..fitting.problem import Problem
from ..measurements.measurements import Measurements
from ..mechanisms import environment
from ..mechanisms.terms import Mechanism
from ..robot.kinematics import Robot

STEPS: dict[str, Callable[[Robot, float], Mechanism]] = {
    "tracker-step": environment.tracker_step,
    "fault:tracker-bumped": environment.tracker_bumped,
    "target-step": environment.target_step,
}
# digits of a moment of the campaign
FEWEST_DIGITS, MOST_DIGITS = 2, 12


def place_steps(
    problem: Problem, estimation: Mask, mechanisms: Sequence[Mechanism]
) -> tuple[Mechanism, ...]:
    """Place the steps among some mechanisms where sessions meet: those that the `estimation` rows (m,)
    cannot tell from a step there give way to it.

    Sessions are the groups of the measurements, where they follow one another."""
    moments = list(list_changes(problem.data))
    placed = list(mechanisms)
    if not moments:
        return tuple(placed)
    progress = problem.data.progress[estimation]
    names = {m.name for m in mechanisms}
    for name in sorted(names & STEPS.keys()):
        for moment, group in moments:
            same = _list_same(problem.robot, name, moment, progress)
            placed = [m for m in placed if m not in same]
            step = STEPS[name](problem.robot, moment)
            told = _tell_group(step.sentence, group)
            placed.append(replace(step, sentence=told))
    return tuple(placed)


def _list_same(robot: Robot, name: str, moment: float, progress: Array) -> list[Mechanism]:
    """List the scanned steps of a name that rows with some progress (m,) cannot tell from a moment's."""
    before = progress < moment
    same = []
    for at in environment.STEPS:
        own = progress < at
        if (own == before).all() and at not in progress:
            step = STEPS[name](robot, at)
            same.append(step)
    return same


def list_changes(data: Measurements) -> Iterator[tuple[float, str]]:
    """List the moments of the campaign where a group ends and another begins, with the latter's name."""
    ranges = []
    for group in np.unique(data.group):
        own = data.progress[data.group == group]
        first = float(own.min())
        last = float(own.max())
        ranges.append((first, last, int(group)))
    ranges.sort()
    for (_, end, _), (start, _, group) in pairwise(ranges):
        if end < start:
            yield round_between(end, start), data.groups[group]


def round_between(low: float, high: float) -> float:
    """Round the middle of two numbers to the fewest digits that leave it between them."""
    middle = (low + high) / 2
    for digits in range(FEWEST_DIGITS, MOST_DIGITS):
        rounded = round(middle, digits)
        if low < rounded < high:
            return rounded
    return middle


def _tell_group(sentence: str, group: str) -> str:
    """Tell from which group on a step stands, in the place of the share of the campaign."""
    told, _, _ = sentence.partition(" after ")
    return f'{told} from the group "{group}" on.'
