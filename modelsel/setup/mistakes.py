"""Set-up mistakes: which simple mistake explains the positions, such as a joint's direction or zero,
columns, units, a mirrored axis, the tool, a link.

Every mistake is a change of the readings, q -> A q + c, or of the positions. All are scored at once:
for given readings the best free affine map from the tracker to frame 0 and the best target are a
linear problem, and what they leave is the least that registration can leave. The best are then
registered exactly. Zeros off by any angle and wrong links are fitted (`joint_offsets`). Nothing is
applied: the sentence says what would fit. A mistake counts only where the rows determine how the
tracker then stands."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from .._typing import Mask
from ..exceptions import DataError, NotEstimable
from ..fitting.design import residuals
from ..fitting.problem import Problem
from ..robot.kinematics import pose
from .joint_offsets import Arm, fit_each_link, fit_each_zero, fit_several
from .other_robots import describe_improvement, sample_positions
from .registration import note_undetermined, register
from .simple_mistakes import (
    NOTHING,
    REGISTER,
    SCALES,
    Mistake,
    list_joint_mistakes,
    list_position_mistakes,
    list_reversed_joints,
    score_linearly,
)

# configurations below which chance fits too much; twice as many for two mistakes at once
MIN_CONFIGURATIONS = 10
# median residual, as a share of the reach, from which one mistake is looked for, and from which the
# tool's or several are
BAD_SHARE = 3e-3
FAR_SHARE = 0.01
# a mistake explains the positions where its correction reduces the median residual by this factor,
# and to this share of the positions' median spread
MIN_IMPROVEMENT = 4.0
MAX_SPREAD_SHARE = 0.05
# factor within which mistakes fit as well as the best, and how many are named
EQUAL_FACTOR = 1.5
MAX_NAMED = 2
# factor by which an angle must fit better than the simple mistakes not to be called a right angle
RIGHT_ANGLE_FACTOR = 2.0
# linear solutions that are registered
MAX_REGISTERED = 8
# difference of the logarithms of scales up to which a unit is tried
NEAR_SCALE = 0.1

REGISTRATION = (
    "the tracker's frame and the target on the flange are found ([robot] register = true), and "
)


class Explanation(NamedTuple):
    """A mistake and the median distance [mm] that its correction leaves."""

    mistake: Mistake
    left: float


def describe_setup_mistake(
    problem: Problem, use: Mask, registered: bool, per_group: bool = False, links: bool = True
) -> str | None:
    """Describe the simple mistake of the set-up that explains what the rows `use` (mask) of a
    problem leave at its placement and tools, with the median distance before and after; None where
    they leave little, or no mistake explains it.

    `registered`: placement and tools were found from the rows; else they are what the study says.
    `links`: whether links may be wrong."""
    sample = sample_positions(problem, use, per_group)
    least = BAD_SHARE * problem.reach_mm
    if sample is None or _compute_left(sample) < least:
        return None
    if not registered:
        return _describe_stated(sample, links)
    # where orientations were at odds with the positions, the positions alone fit
    sample = _try_registration(sample, sure=False) or sample
    before = _compute_left(sample)
    if before < least:
        return None
    found = _explain_registered(sample, before, links)
    return _describe(before, found) if found else None


def _describe_stated(sample: Problem, links: bool) -> str | None:
    """Describe the mistake where the study states the tracker's frame and the target: with these as
    they are, or else with these found."""
    before = _compute_left(sample)
    found = _explain_stated(
        sample,
        before,
        links,
    )
    if found:
        return _describe(before, found)
    sample = _try_registration(sample, sure=False) or sample
    found = _explain_registered(
        sample,
        before,
        links,
    )
    if not found:
        return None
    return _describe(
        before,
        found,
        REGISTRATION,
    )


def _explain_stated(problem: Problem, before: float, links: bool) -> list[Explanation]:
    """Explain the positions with frame and target as the study states them."""
    limit = before / MIN_IMPROVEMENT
    far = FAR_SHARE * problem.reach_mm
    is_far = before > far
    tried = []
    if is_far:
        moved_tool = _move_tool(problem)
        tried.append(moved_tool)
    robot = problem.robot
    of_joints = list_joint_mistakes(robot)
    of_positions = list_position_mistakes(robot.n, True)
    for mistake in (*of_joints, *of_positions):
        corrected = _apply(problem, mistake)
        left = _compute_explained(corrected)
        tried.append(Explanation(mistake, left))
    found = _select_best(tried, limit)
    if not found:
        assessed = []
        for mistake, arm in _fit_offsets(problem, False, links):
            left = _assess_arm(problem, arm)
            assessed.append(Explanation(mistake, left))
        found = _select_best(assessed, limit)
    if not found and is_far:
        found = _explain_by_registration(problem, limit)
    return found


def _explain_by_registration(problem: Problem, limit: float) -> list[Explanation]:
    registered = _try_registration(problem)
    if registered is None:
        return []
    left = _compute_explained(registered)
    if left <= limit:
        return [Explanation(REGISTER, left)]
    return []


def _explain_registered(problem: Problem, before: float, links: bool) -> list[Explanation]:
    """Explain the positions with frame and target found: by one simple mistake, one offset, two
    simple mistakes, or several offsets."""
    limit = before / MIN_IMPROVEMENT
    far = FAR_SHARE * problem.reach_mm
    tried = _try_mistakes(problem, 1)
    offsets = _fit_offsets(
        problem,
        True,
        links,
    )
    simple = _find_least(_select_best(tried, limit))
    tried += _assess_offsets(
        problem,
        offsets,
        simple,
    )
    best = _select_best(tried, limit)
    configurations = len(np.unique(problem.data.block))
    has_few = configurations < 2 * MIN_CONFIGURATIONS
    if before <= far or _find_least(best) <= far or has_few:
        return best
    tried += _try_mistakes(problem, 2)
    best = _select_best(tried, limit)
    if _find_least(best) <= far:
        return best
    several = fit_several(
        problem,
        good=min(limit, BAD_SHARE * problem.reach_mm),
        first=[arm for _, arm in offsets],
        links=links,
    )
    for mistake, arm in several:
        left = _assess_arm(problem, arm)
        tried.append(Explanation(mistake, left))
    return _select_best(tried, limit)


def _assess_offsets(
    problem: Problem, offsets: Sequence[tuple[Mistake, Arm]], simple: float
) -> Iterator[Explanation]:
    """Assess fitted offsets; right angles only where they fit clearly better than `simple` [mm],
    what the simple mistakes leave."""
    for mistake, arm in offsets:
        limit = np.inf
        if arm.has_right_angles():
            limit = simple / RIGHT_ANGLE_FACTOR
        left = _assess_arm(problem, arm)
        if left < limit:
            yield Explanation(mistake, left)


def _fit_offsets(problem: Problem, set_up: bool, links: bool) -> list[tuple[Mistake, Arm]]:
    """Fit one joint's zero or, with `links`, one link at a time."""
    fitted = list(fit_each_zero(problem, set_up))
    if links:
        fitted += fit_each_link(problem, set_up)
    return fitted


def _describe(before: float, found: Sequence[Explanation], also: str = "") -> str:
    after = _find_least(found)
    looks = dict.fromkeys(mistake.look for mistake, _ in found)
    remedy = ", or ".join(looks)
    words = ", or if ".join(mistake.words for mistake, _ in found)
    improvement = describe_improvement(before, after)
    left_before = _format_length(before)
    left_after = _format_length(after)
    return (
        f"The positions fit {improvement} "
        f"({left_after} instead of {left_before}, median) "
        f"if {also}{words}: {remedy}."
    )


def _format_length(value: float) -> str:
    digits = ".0f" if value >= 100 else ".2g"
    number = format(value, digits)
    return f"{number} mm"


def _compute_left(problem: Problem) -> float:
    """Compute the median distance that is left [mm]."""
    residual = residuals(problem)
    distance = np.linalg.norm(
        residual,
        axis=1,
    )
    return float(np.median(distance))


def _compute_explained(problem: Problem) -> float:
    """Compute the median distance that is left [mm]; infinite where it is much of the positions'
    spread, because positions that hardly move fit anything."""
    left = _compute_left(problem)
    x = problem.data.position
    middle = np.median(x, axis=0)
    distance = np.linalg.norm(
        x - middle,
        axis=1,
    )
    spread = float(np.median(distance))
    is_small = left <= MAX_SPREAD_SHARE * spread
    return left if is_small else np.inf


def _try_registration(problem: Problem, sure: bool = True) -> Problem | None:
    """Register a problem anew, with the target anywhere near the flange; None where the rows do not
    determine it (`sure`: or determine it poorly)."""
    bare = replace(
        problem,
        tools=np.zeros_like(problem.tools),
    )
    every_row = np.ones(len(problem), bool)
    try:
        registered = register(
            bare,
            every_row,
            per_group=False,
        )
    except (DataError, NotEstimable):
        return None
    is_refused = sure and _is_weak(registered)
    return None if is_refused else registered


def _is_weak(problem: Problem) -> bool:
    """Return whether the rows of a registered problem determine its placement poorly."""
    every_row = np.ones(len(problem), bool)
    notes = note_undetermined(
        problem,
        every_row,
        per_group=False,
        usual=np.zeros_like(problem.tools),
    )
    codes = [note.code for note in notes]
    return "registration-weak" in codes


def _assess_arm(problem: Problem, arm: Arm) -> float:
    """Compute what an arm that is not nominal explains; infinite where the rows do not determine its
    set-up."""
    applied = arm.apply(problem)
    if _is_weak(applied):
        return np.inf
    return _compute_explained(applied)


def _apply(problem: Problem, mistake: Mistake) -> Problem:
    """Apply the correction of a mistake."""
    data = problem.data
    turned = data.q @ mistake.A.T
    corrected = replace(
        data,
        q=turned + mistake.c,
        position=data.position @ mistake.B.T,
    )
    return replace(problem, data=corrected)


def _find_least(explanations: Sequence[Explanation]) -> float:
    distances = [left for _, left in explanations]
    return min(
        distances,
        default=np.inf,
    )


def _select_best(tried: Sequence[Explanation], limit: float) -> list[Explanation]:
    """Select the mistakes that leave least, best first: those within the limit and as good as the
    best, of the fewest parts."""
    least = _find_least(tried)
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


def _move_tool(problem: Problem) -> Explanation:
    """Move the target on the flange to where most rows have it (median)."""
    R, t = problem.placement
    group = problem.data.group
    at = pose(
        problem.robot,
        problem.data.q,
        np.zeros(3),
    )
    axes = at.axes[-1, :3]
    offset_of_row = problem.data.position - t[group]
    base = np.einsum(
        "mji,mj->mi",
        R[group],
        offset_of_row,
    )
    on_flange = np.einsum(
        "aim,mi->ma",
        axes,
        base - at.target.T,
    )
    offset = np.median(on_flange, axis=0)
    targets = len(problem.tools)
    moved = replace(
        problem,
        tools=np.tile(offset, (targets, 1)),
    )
    target = "the target"
    if targets > 1:
        first = problem.data.target[0]
        target = f"target {problem.data.targets[first]}"
    x, y, z = offset
    mistake = replace(
        NOTHING,
        words=f"{target} sits at {x:.1f}, {y:.1f}, {z:.1f} mm on the flange",
        look="check tool_mm in the study",
    )
    left = _compute_explained(moved)
    return Explanation(mistake, left)


def _try_mistakes(problem: Problem, count: int) -> list[Explanation]:
    """Try up to `count` mistakes at once: register those that do best in the linear solution."""
    joints = _list_combinations(problem, count)
    score, factor = score_linearly(problem, joints)
    most = EQUAL_FACTOR * score.min()
    parts = np.where(
        score <= most,
        [mistake.parts for mistake in joints],
        np.inf,
    )
    likeliest = np.lexsort((score, parts))
    explanations = []
    for k in likeliest[:MAX_REGISTERED]:
        tried = _generate_with_positions(
            problem,
            joints[k],
            float(factor[k]),
            count,
        )
        for mistake in tried:
            corrected = _apply(problem, mistake)
            registered = _try_registration(corrected)
            if registered is not None:
                left = _compute_explained(registered)
                explanations.append(Explanation(mistake, left))
    return explanations


def _list_combinations(problem: Problem, count: int) -> list[Mistake]:
    """List mistakes of the readings: none and single ones, or single ones, pairs of them, and three
    and more joints that turn the other way."""
    n = problem.robot.n
    singles = list(list_joint_mistakes(problem.robot))
    if count == 1:
        nothing = replace(
            NOTHING,
            A=np.eye(n),
            c=np.zeros(n),
            parts=0,
        )
        return [nothing, *singles]
    pairs = []
    for first, second in combinations(singles, 2):
        pair = first.then(second)
        pairs.append(pair)
    reversed_joints = list_reversed_joints(n)
    return [*singles, *pairs, *reversed_joints]


def _generate_with_positions(
    problem: Problem, joint: Mistake, factor: float, count: int
) -> Iterator[Mistake]:
    """Generate a mistake of the readings alone and, if it may have another part, with mistakes of
    the positions whose scale is near the affine map's `factor`."""
    has_joint = joint.parts > 0
    if has_joint:
        yield joint
    if joint.parts >= count:
        return
    n = problem.robot.n
    scales = [unit.scale for unit in SCALES]
    scales.append(-1.0)
    mistakes = list_position_mistakes(n, False)
    for mistake, scale in zip(mistakes, scales, strict=True):
        if factor * scale <= 0:
            continue
        difference = abs(np.log(factor / scale))
        if difference < NEAR_SCALE:
            yield joint.then(mistake) if has_joint else mistake
