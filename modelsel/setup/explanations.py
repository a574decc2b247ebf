"""How well a mistake of the set-up explains the positions, and which mistakes explain them best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..fitting.design import residuals
from ..fitting.problem import Problem
from ..robot.kinematics import pose
from .improvement import EQUAL_FACTOR
from .offset_arms import Arm
from .registration import note_undetermined, register_each
from .simple_mistakes import NOTHING, Mistake

# a mistake explains the positions where its correction brings the median residual to this share of
# the positions' median spread
MAX_SPREAD_SHARE = 0.05
# mistakes that fit as well as the best and are named
MAX_NAMED = 2


class Explanation(NamedTuple):
    """A mistake and the median distance [mm] that its correction leaves."""

    mistake: Mistake
    left: float


def compute_left(problem: Problem) -> float:
    """Compute the median distance that is left [mm]."""
    residual = residuals(problem)
    distance = np.linalg.norm(residual, axis=1)
    median = np.median(distance)
    return float(median)


def compute_explained(problem: Problem) -> float:
    """Compute the median distance that is left [mm]; infinite where it is much of the positions'
    spread, because positions that hardly move fit anything."""
    left = compute_left(problem)
    x = problem.data.position
    middle = np.median(x, axis=0)
    distance = np.linalg.norm(x - middle, axis=1)
    spread = float(np.median(distance))
    is_small = left <= MAX_SPREAD_SHARE * spread
    return left if is_small else np.inf


def try_registration(problem: Problem) -> Problem | None:
    """Register a problem anew, with the target anywhere near the flange; None where the rows do not
    determine it."""
    (registered,) = register_each([_take_off_tools(problem)])
    return registered


def register_surely(problems: Sequence[Problem]) -> list[Problem | None]:
    """Register each of several problems anew, with the target anywhere near the flange; None of those
    whose rows do not determine it, or determine it poorly."""
    bare = [_take_off_tools(problem) for problem in problems]
    sure = []
    for registered in register_each(bare):
        is_refused = registered is None or _is_weak(registered)
        sure.append(None if is_refused else registered)
    return sure


def _take_off_tools(problem: Problem) -> Problem:
    return replace(problem, tools=np.zeros_like(problem.tools))


def _is_weak(problem: Problem) -> bool:
    """Return whether the rows of a registered problem determine its placement poorly."""
    every_row = np.ones(len(problem), bool)
    notes = note_undetermined(
        problem, every_row, per_group=False, usual=np.zeros_like(problem.tools)
    )
    codes = [note.code for note in notes]
    return "registration-weak" in codes


def assess_arm(problem: Problem, arm: Arm) -> float:
    """Compute what an arm that is not nominal explains; infinite where the rows do not determine its
    set-up."""
    applied = arm.apply(problem)
    if _is_weak(applied):
        return np.inf
    return compute_explained(applied)


def apply_correction(problem: Problem, mistake: Mistake) -> Problem:
    """Apply the correction of a mistake."""
    data = problem.data
    turned = data.q @ mistake.A.T
    corrected = replace(data, q=turned + mistake.c, position=data.position @ mistake.B.T)
    return replace(problem, data=corrected)


def find_least_left(explanations: Sequence[Explanation]) -> float:
    """Find the least median distance [mm] that any of the mistakes leaves; infinite without one."""
    distances = [left for _, left in explanations]
    return min(distances, default=np.inf)


def select_best(tried: Sequence[Explanation], limit: float) -> list[Explanation]:
    """Select the mistakes that leave least, best first: those within the limit and as good as the
    best, of the fewest parts."""
    least = find_least_left(tried)
    most = min(limit, EQUAL_FACTOR * least)
    good = []
    fewest = np.inf
    for explanation in tried:
        is_good = explanation.left <= most
        if is_good:
            good.append(explanation)
            parts = explanation.mistake.parts
            fewest = min(fewest, parts)
    simplest = [explanation for explanation in good if explanation.mistake.parts == fewest]
    simplest.sort(key=lambda explanation: explanation.left)
    return simplest[:MAX_NAMED]


def move_tool(problem: Problem) -> Explanation:
    """Move the target on the flange to where most rows have it (median)."""
    R, t = problem.placement
    group = problem.data.group
    at = pose(problem.robot, problem.data.q, np.zeros(3))
    axes = at.axes[-1, :3]
    offset_of_row = problem.data.position - t[group]
    base = np.einsum("mji,mj->mi", R[group], offset_of_row)
    on_flange = np.einsum("aim,mi->ma", axes, base - at.target.T)
    offset = np.median(on_flange, axis=0)
    targets = len(problem.tools)
    moved = replace(problem, tools=np.tile(offset, (targets, 1)))
    target = "the target"
    look = "check tool_mm in the study"
    if targets > 1:
        first = problem.data.target[0]
        target = f"target {problem.data.targets[first]}"
        look = "give its place in the study, under [robot.tools_mm]"
    x, y, z = offset
    mistake = replace(
        NOTHING, words=f"{target} sits at {x:z.1f}, {y:z.1f}, {z:z.1f} mm on the flange", look=look
    )
    left = compute_explained(moved)
    return Explanation(mistake, left)
