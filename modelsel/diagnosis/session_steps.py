"""Steps of the set-up between two sessions, at the moment where the one ends and the other begins.

What was moved between two groups of measurements stands elsewhere for every row of the later one, for
those that are held out, too. A step that is only placed between two estimation rows leaves such rows on
the wrong side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from .._typing import Array, Mask
from ..exceptions import one_line
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
# moments where groups meet, at most: more groups are no sessions
MOST_CHANGES = 20
# digits of a moment of the campaign
FEWEST_DIGITS, MOST_DIGITS = 2, 12


def place_steps(
    problem: Problem, estimation: Mask, mechanisms: Sequence[Mechanism]
) -> tuple[Mechanism, ...]:
    """Place the steps among some mechanisms where sessions meet: those that the `estimation` rows (m,)
    cannot tell from a step there give way to it.

    Sessions are the groups of the measurements, where they follow one another."""
    moments = list_changes(problem.data)
    placed = list(mechanisms)
    if not moments:
        return tuple(placed)
    progress = problem.data.progress[estimation]
    names = {m.name for m in mechanisms}
    for name in sorted(names & STEPS.keys()):
        for moment, begins in moments:
            same = _list_same(problem.robot, name, moment, progress)
            placed = [m for m in placed if m not in same]
            step = STEPS[name](problem.robot, moment)
            told = _tell(step.sentence, begins)
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


def list_changes(data: Measurements) -> list[tuple[float, str]]:
    """List the moments of the campaign before which some groups have ended and after which the others
    begin, with what begins in words; none of many."""
    there, group = np.unique(data.group, return_inverse=True)
    first = np.full(len(there), np.inf)
    last = np.full(len(there), -np.inf)
    np.minimum.at(first, group, data.progress)
    np.maximum.at(last, group, data.progress)
    order = np.argsort(first, kind="stable")
    ends = np.maximum.accumulate(last[order])[:-1]
    starts = first[order][1:]
    changes = np.flatnonzero(ends < starts)
    if len(changes) > MOST_CHANGES:
        return []
    moments = []
    for k in changes.tolist():
        begins = there[order[k + 1]]
        name = one_line(data.groups[begins])
        moment = round_between(float(ends[k]), float(starts[k]))
        moments.append((moment, f'from the group "{name}" on'))
    return moments


def round_between(low: float, high: float) -> float:
    """Round the middle of two numbers to the fewest digits that leave it between them."""
    middle = (low + high) / 2
    for digits in range(FEWEST_DIGITS, MOST_DIGITS):
        rounded = round(middle, digits)
        if low < rounded < high:
            return rounded
    return middle


def _tell(sentence: str, begins: str) -> str:
    """Tell from what on a step stands, in the place of the share of the campaign."""
    told, _, _ = sentence.partition(" after ")
    return f"{told} {begins}."
