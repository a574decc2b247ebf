"""Steps at some moment of the campaign: of the set-up between two sessions, at the moment where the one
ends and the other begins; of a joint's zero and of one target of several, told by the row from which
they stand.

What was moved between two groups of measurements stands elsewhere for every row of the later one, for
those that are held out, too. A step that is only placed between two estimation rows leaves such rows on
the wrong side."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from ..._typing import Array, Mask
from ...exceptions import one_line
from ...fitting.problem import Problem
from ...measurements.measurements import Measurements
from ...mechanisms import environment
from ...mechanisms.campaign_registry import TARGET_STEP
from ...mechanisms.moved_targets import JOINED, limit_to_targets
from ...mechanisms.step_moments import list_step_moments
from ...mechanisms.target_names import number_targets
from ...mechanisms.terms import Mechanism
from ...robot.kinematics import Robot
from .scanned_constants import drop_equal_constants, has_both_sides
from .slide_steps import add_steps_along_slides

Build = Callable[[Robot, float], Mechanism]
# what moves the instrument against the arm for every target, and whatever steps for some
SET_UP_STEPS: dict[str, Build] = {
    "tracker-step": environment.tracker_step,
    "fault:tracker-bumped": environment.tracker_bumped,
}
STEPS: dict[str, Build] = {**SET_UP_STEPS, TARGET_STEP: environment.target_step}
# moments where groups meet, at most: more groups are no sessions
MOST_CHANGES = 20
# digits of a moment of the campaign
FEWEST_DIGITS, MOST_DIGITS = 2, 12


class _Step(NamedTuple):
    """A step whose moment is scanned: what builds it, the estimation rows (m,) of what it moves, and
    whether the row is told from which it stands, even where sessions meet."""

    build: Build
    rows: Mask
    by_row: bool


def place_steps(
    problem: Problem, estimation: Mask, mechanisms: Sequence[Mechanism]
) -> tuple[Mechanism, ...]:
    """Place the steps among some mechanisms where sessions meet: those that the `estimation` rows (m,)
    cannot tell from a step there give way to it. Elsewhere steps are told by the row. What may have moved a few rows from where sessions meet, as held-out
    rows lie there, is told to stand from about there on.

    Sessions are the groups of the measurements, where they follow one another."""
    robot = problem.robot
    moments = _list_meetings(problem.data)
    placed = list(mechanisms)
    names = {m.name for m in placed}
    of_targets = _list_target_steps(problem.data, estimation)
    known = _list_steps(robot, estimation) | of_targets
    there = {name: step for name, step in known.items() if name in names}
    for _, step in sorted(there.items()):
        progress = problem.data.progress[step.rows]
        for moment, _ in moments:
            about = step.by_row or _has_open_rows(problem.data.progress, progress, moment)
            begins = _say_begin(moments, moment, progress, about)
            same = _list_same(robot, step.build, moment, progress)
            placed = [m for m in placed if m not in same]
            placed.append(_tell(step.build(robot, moment), begins))
    placed = _tell_rows(problem, there.values(), placed)
    if of_targets:
        placed = _limit_to_measured(problem.take(estimation), placed)
        placed = list(map(_tell_all_targets, placed))
    return add_steps_along_slides(problem, placed)


def _list_steps(robot: Robot, estimation: Mask) -> dict[str, _Step]:
    """List the steps of the set-up and those of every joint's zero by their names."""
    steps = {}
    for name, build in STEPS.items():
        steps[name] = _Step(build, estimation, by_row=False)
    joints = range(1, robot.n + 1)
    for joint in joints:
        name = f"zero-step:{joint}"
        build = partial(_build_zero_step, joint)
        step = _Step(build, estimation, by_row=True)
        steps[name] = step
    return steps


def name_steps(problem: Problem) -> frozenset[str]:
    """Name the mechanisms that are steps at a moment which the data tell."""
    every = np.ones(len(problem), bool)
    of_targets = _list_target_steps(problem.data, every)
    return frozenset(_list_steps(problem.robot, every) | of_targets)


def _build_zero_step(joint: int, robot: Robot, at: float) -> Mechanism:
    return environment.zero_step(robot, joint, at)


def _list_target_steps(data: Measurements, estimation: Mask) -> dict[str, _Step]:
    """List the steps of single targets by their names; none where there is one target."""
    steps: dict[str, _Step] = {}
    names = data.targets
    if len(names) == 1:
        return steps
    numbers = number_targets(names, data.listed_targets)
    for target, name in enumerate(names):
        is_own = data.target == target
        rows = estimation & is_own
        build = partial(_build_target_step, {target: name}, numbers)
        step = _Step(build, rows, by_row=True)
        label = f"{TARGET_STEP}:{name}"
        steps[label] = step
    return steps


def _build_target_step(
    targets: Mapping[int, str], numbers: Sequence[int], robot: Robot, at: float
) -> Mechanism:
    step = environment.target_step(robot, at)
    return limit_to_targets(step, targets, numbers)


def build_common_steps(
    problem: Problem, targets: Collection[int], moments: Collection[float]
) -> list[Mechanism]:
    """Build steps of some targets of several (0-based), shifted alike, at some moments, each told by
    where it begins. Those between the same rows of these targets are one."""
    built = []
    for at in sorted(moments):
        step = build_step_of(problem, targets, at)
        if step is not None:
            built.append(step)
    return drop_equal_constants(problem, built)


def build_step_of(problem: Problem, targets: Collection[int], at: float) -> Mechanism | None:
    """Build a step of some targets of several (0-based), shifted alike, at a moment, told by where it
    begins; None where all rows of these targets are on one side of it."""
    data = problem.data
    names = data.targets
    numbers = number_targets(names, data.listed_targets)
    places = sorted(targets)
    moved = {place: names[place] for place in places}
    is_own = np.isin(data.target, places)
    own = data.take(is_own)
    robot = problem.robot
    meetings = _list_meetings(data)
    step = _build_target_step(moved, numbers, robot, at)
    begins = _say_begin(meetings, at, own.progress, about=True)
    begins = begins or say_row(own, at)
    if not begins:
        return None
    return _tell(step, begins)


def have_own_name(data: Measurements, targets: Collection[int]) -> bool:
    """Whether the names of some targets (0-based), joined, are no target's."""
    names = data.targets
    places = sorted(targets)
    own = [names[place] for place in places]
    joined = JOINED.join(own)
    is_single = len(own) == 1
    is_new = joined not in names
    return is_single or is_new


def list_measured_targets(data: Measurements) -> frozenset[int]:
    """List the targets (0-based) that some rows measure."""
    measured = np.unique(data.target)
    numbers = measured.tolist()
    return frozenset(numbers)


def _limit_to_measured(problem: Problem, mechanisms: Sequence[Mechanism]) -> list[Mechanism]:
    """Limit steps of all targets to those that the rows of a problem tell of: whether a target moved
    that was measured on one side of a step alone, or not at all, nobody knows."""
    spans = _list_spans(problem.data)
    known = {m.terms for m in mechanisms}
    limited: list[Mechanism] = []
    for m in mechanisms:
        if m.name != TARGET_STEP:
            limited.append(m)
            continue
        own = _limit_step(problem, m, spans)
        if own is m or (own is not None and own.terms not in known):
            limited.append(own)
    return limited


def _list_spans(data: Measurements) -> dict[int, tuple[float, float]]:
    """List of every target that was measured (0-based) the progress of its first row and its last."""
    spans = {}
    for target in list_measured_targets(data):
        is_own = data.target == target
        own = data.progress[is_own]
        first = float(own.min())
        last = float(own.max())
        spans[target] = first, last
    return spans


def _limit_step(
    problem: Problem, step: Mechanism, spans: Mapping[int, tuple[float, float]]
) -> Mechanism | None:
    """Limit a step of all targets to those that were measured on both sides of it, if these have rows
    enough; else to those that were measured, None where these have rows on one side alone."""
    data = problem.data
    count = len(data.targets)
    (at,) = list_step_moments(step.terms)
    both = [target for target, (first, last) in spans.items() if first < at < last]
    if len(both) == count:
        return step
    if both and have_own_name(data, both):
        limited = build_step_of(problem, both, at)
        if limited is not None and has_both_sides(problem, limited):
            return limited
    if len(spans) == count or not have_own_name(data, spans):
        return step
    return build_step_of(problem, spans, at)


def say_row(data: Measurements, at: float) -> str:
    """Say with about which row of some a step begins; nothing where all are on one side of it."""
    after = np.flatnonzero(data.progress > at)
    if not 0 < len(after) < len(data):
        return ""
    earliest = data.progress[after].argmin()
    first = after[earliest]
    index = data.row[first]
    row = int(index)
    begins = data.where.name_row_alone(row)
    return f"from about {begins} on"


def _say_rows(data: Measurements, at: float) -> str:
    """Say between which of some rows a step begins; nothing where all are on one side of it."""
    begins = say_row(data, at)
    if not begins:
        return ""
    progress, where = data.progress, data.where
    # a row at that very moment is not after it
    is_before = progress <= at
    before = np.flatnonzero(is_before)
    after = np.flatnonzero(~is_before)
    latest = progress[before].argmax()
    earliest = progress[after].argmin()
    ends = before[latest]
    starts = after[earliest]
    last = int(data.row[ends])
    first = int(data.row[starts])
    number = where.number(last)
    following = where.number(first)
    if following == number + 1:
        return begins
    place = where.name_row_alone(last)
    return f"{begins}, after {place}"


def _tell_rows(
    problem: Problem, steps: Iterable[_Step], mechanisms: Sequence[Mechanism]
) -> list[Mechanism]:
    """Tell scanned steps by the first of the rows after them, those that some rows are before and
    others after. Noise leaves the row open by a few."""
    said: dict[bytes, dict[float, str]] = {}
    told = {}
    for step in steps:
        rows = step.rows.tobytes()
        if rows not in said:
            data = problem.data.take(step.rows)
            said[rows] = {at: _say_rows(data, at) for at in environment.STEPS}
        for at, begins in said[rows].items():
            if begins:
                scanned = step.build(problem.robot, at)
                told[scanned] = _tell(scanned, begins)
    renamed = []
    for m in mechanisms:
        known = told.get(m, m)
        renamed.append(known)
    return renamed


def _list_same(robot: Robot, build: Build, moment: float, progress: Array) -> list[Mechanism]:
    """List the scanned steps that rows with some progress (m,) cannot tell from a moment's."""
    before = progress < moment
    same = []
    for at in environment.STEPS:
        own = progress < at
        if (own == before).all() and at not in progress:
            step = build(robot, at)
            same.append(step)
    return same


def list_changes(data: Measurements) -> list[tuple[float, str]]:
    """List the moments of the campaign before which some groups have ended and after which the others
    begin, with what begins in words; none of many."""
    return [(moment, f"from the group {name} on") for moment, name in _list_meetings(data)]


def _list_meetings(data: Measurements) -> list[tuple[float, str]]:
    """List the moments where groups meet, with the name of the group that begins."""
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
        name = f'"{one_line(data.groups[begins])}"'
        moment = round_between(float(ends[k]), float(starts[k]))
        moments.append((moment, name))
    return moments


def _has_open_rows(every: Array, progress: Array, moment: float) -> bool:
    """Whether some of `every` row (m,) lie between the two around a moment of which the progress (n,)
    is given."""
    before = progress[progress < moment]
    after = progress[progress > moment]
    last = before.max(initial=-np.inf)
    first = after.min(initial=np.inf)
    between = (last < every) & (every < first)
    return bool(between.any())


def _say_begin(
    moments: Sequence[tuple[float, str]], moment: float, progress: Array, about: bool
) -> str:
    """Say with which group a step begins; with which it may, where no row of some progress (m,) lies
    between them; nothing where it does not begin with one. What begins `about` there need not have
    happened between two groups."""
    before = progress < moment
    alike = []
    for other, name in moments:
        is_same = (progress < other) == before
        if is_same.all():
            alike.append(name)
    if not alike:
        return ""
    names = " or ".join(alike)
    if about:
        return f"from about the beginning of the group {names} on"
    return f"from the group {names} on"


def round_between(low: float, high: float) -> float:
    """Round the middle of two numbers to the fewest digits that leave it between them."""
    middle = (low + high) / 2
    for digits in range(FEWEST_DIGITS, MOST_DIGITS):
        rounded = round(middle, digits)
        if low < rounded < high:
            return rounded
    return middle


def _tell_all_targets(mechanism: Mechanism) -> Mechanism:
    """Tell a step of all of several targets as that; anything else as it is."""
    if mechanism.name != TARGET_STEP:
        return mechanism
    sentence = mechanism.sentence.replace("The target stands", "All targets stand", 1)
    return replace(mechanism, sentence=sentence)


def _tell(step: Mechanism, begins: str) -> Mechanism:
    """Tell from what on a step stands, in the place of the share of the campaign."""
    told, _, _ = step.sentence.rpartition(" after ")
    sentence = f"{told} {begins}."
    return replace(step, sentence=sentence)
