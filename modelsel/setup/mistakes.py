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

import numpy as np

from .._typing import Mask
from ..fitting.problem import Problem
from ..measurements.campaign.visits import count_distinct
from .explanations import (
    Explanation,
    apply_correction,
    assess_arm,
    compute_explained,
    compute_left,
    find_least_left,
    move_tool,
    register_surely,
    select_best,
    try_registration,
)
from .improvement import BAD_SHARE, EQUAL_FACTOR, MIN_IMPROVEMENT, describe_improvement
from .joint_offsets import fit_each_link, fit_each_zero, fit_several
from .linear_scores import score_linearly
from .offset_arms import Arm
from .other_robots import sample_positions, select_most_frequent
from .simple_mistakes import (
    NOTHING,
    REGISTER,
    Mistake,
    list_joint_mistakes,
    list_position_mistakes,
    list_reversed_joints,
)

# configurations below which chance fits too much; twice as many for two mistakes at once
MIN_CONFIGURATIONS = 10
# median residual, as a share of the reach, from which the tool's or several mistakes are looked for
FAR_SHARE = 0.01
# factor by which an angle must fit better than the simple mistakes not to be called a right angle
RIGHT_ANGLE_FACTOR = 2.0
# linear solutions that are registered
MAX_REGISTERED = 8
# difference of the logarithms of scales up to which a unit is tried
NEAR_SCALE = 0.1

REGISTRATION = (
    "the instrument's frame and the target on the flange are found ([robot] register = true), and "
)


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
    if sample is None or compute_left(sample) < least:
        return None
    if not registered:
        return _describe_stated(sample, least, links)
    # where orientations were at odds with the positions, the positions alone fit
    sample = try_registration(sample) or sample
    before = compute_left(sample)
    if before < least:
        return None
    found = _explain_registered(sample, before, links)
    return _describe(before, found) if found else None


def describe_moved_targets(problem: Problem, use: Mask) -> str | None:
    """Describe the targets that sit elsewhere on the flange than the study states, by the rows `use`
    (mask), but for the most frequent one, by which the set-up is checked; None where there are
    none."""
    target = problem.data.target
    checked = select_most_frequent(problem, use)
    measured = np.unique(target[use])
    others = np.setdiff1d(measured, target[checked])
    least = BAD_SHARE * problem.reach_mm
    sentences = []
    for number in others.tolist():
        is_of_target = target == number
        sample = sample_positions(problem, use & is_of_target)
        if sample is None:
            continue
        before = compute_left(sample)
        moved = move_tool(sample)
        limit = before / MIN_IMPROVEMENT
        if before < least or moved.left > limit:
            continue
        sentence = _describe(before, [moved])
        sentences.append(sentence)
    return " ".join(sentences) or None


def _describe_stated(sample: Problem, least: float, links: bool) -> str | None:
    """Describe the mistake where the study states the tracker's frame and the target: with these as
    they are, or else with these found, where that leaves at least `least` [mm] or explains all."""
    before = compute_left(sample)
    found = _explain_stated(sample, before, links)
    if found:
        return _describe(before, found)
    sample = try_registration(sample) or sample
    left = compute_left(sample)
    if before / MIN_IMPROVEMENT < left < least:
        return None
    # a mistake is judged by what it explains beyond frame and target
    found = _explain_registered(sample, min(before, left), links)
    if not found:
        return None
    return _describe(before, found, REGISTRATION)


def _explain_stated(problem: Problem, before: float, links: bool) -> list[Explanation]:
    """Explain the positions with frame and target as the study states them."""
    limit = before / MIN_IMPROVEMENT
    far = FAR_SHARE * problem.reach_mm
    is_far = before > far
    tried = []
    if is_far:
        moved_tool = move_tool(problem)
        tried.append(moved_tool)
    robot = problem.robot
    of_joints = list_joint_mistakes(robot)
    of_positions = list_position_mistakes(robot.n, True)
    for mistake in (*of_joints, *of_positions):
        corrected = apply_correction(problem, mistake)
        left = compute_explained(corrected)
        tried.append(Explanation(mistake, left))
    found = select_best(tried, limit)
    if not found:
        assessed = []
        for mistake, arm in _fit_offsets(problem, False, links):
            left = assess_arm(problem, arm)
            assessed.append(Explanation(mistake, left))
        found = select_best(assessed, limit)
    if not found and is_far:
        found = _explain_by_registration(problem, limit)
    return found


def _explain_by_registration(problem: Problem, limit: float) -> list[Explanation]:
    (registered,) = register_surely([problem])
    if registered is None:
        return []
    left = compute_explained(registered)
    if left <= limit:
        return [Explanation(REGISTER, left)]
    return []


def _explain_registered(problem: Problem, before: float, links: bool) -> list[Explanation]:
    """Explain the positions with frame and target found: by one simple mistake, one offset, two
    simple mistakes, or several offsets."""
    limit = before / MIN_IMPROVEMENT
    far = FAR_SHARE * problem.reach_mm
    tried = _try_mistakes(problem, 1)
    offsets = _fit_offsets(problem, True, links)
    simple = find_least_left(select_best(tried, limit))
    tried += _assess_offsets(problem, offsets, simple)
    best = select_best(tried, limit)
    configurations = count_distinct(problem.data.block)
    has_few = configurations < 2 * MIN_CONFIGURATIONS
    if before <= far or find_least_left(best) <= far or has_few:
        return best
    tried += _try_mistakes(problem, 2)
    best = select_best(tried, limit)
    if find_least_left(best) <= far:
        return best
    several = fit_several(
        problem,
        good=min(limit, BAD_SHARE * problem.reach_mm),
        first=[arm for _, arm in offsets],
        links=links,
    )
    for mistake, arm in several:
        left = assess_arm(problem, arm)
        tried.append(Explanation(mistake, left))
    return select_best(tried, limit)


def _assess_offsets(
    problem: Problem, offsets: Sequence[tuple[Mistake, Arm]], simple: float
) -> Iterator[Explanation]:
    """Assess fitted offsets; right angles only where they fit clearly better than `simple` [mm],
    what the simple mistakes leave."""
    for mistake, arm in offsets:
        limit = np.inf
        if arm.has_right_angles():
            limit = simple / RIGHT_ANGLE_FACTOR
        left = assess_arm(problem, arm)
        if left < limit:
            yield Explanation(mistake, left)


def _fit_offsets(problem: Problem, set_up: bool, links: bool) -> list[tuple[Mistake, Arm]]:
    """Fit one joint's zero or, with `links`, one link at a time."""
    fitted = list(fit_each_zero(problem, set_up))
    if links:
        fitted += fit_each_link(problem, set_up)
    return fitted


def _describe(before: float, found: Sequence[Explanation], also: str = "") -> str:
    after = find_least_left(found)
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
    digits = ",.0f" if value >= 100 else ".2g"
    number = format(value, digits)
    return f"{number} mm"


def _try_mistakes(problem: Problem, count: int) -> list[Explanation]:
    """Try up to `count` mistakes at once: register those that do best in the linear solution."""
    joints = _list_combinations(problem, count)
    score, factor = score_linearly(problem, joints)
    most = EQUAL_FACTOR * score.min()
    parts = np.where(score <= most, [mistake.parts for mistake in joints], np.inf)
    likeliest = np.lexsort((score, parts))
    tried: list[Mistake] = []
    for k in likeliest[:MAX_REGISTERED]:
        tried += _generate_with_positions(problem, joints[k], float(factor[k]), count)
    corrected = [apply_correction(problem, mistake) for mistake in tried]
    explanations = []
    for mistake, registered in zip(tried, register_surely(corrected), strict=True):
        if registered is not None:
            left = compute_explained(registered)
            explanations.append(Explanation(mistake, left))
    return explanations


def _list_combinations(problem: Problem, count: int) -> list[Mistake]:
    """List mistakes of the readings: none and single ones, or single ones, pairs of them, and three
    and more joints that turn the other way."""
    n = problem.robot.n
    singles = list(list_joint_mistakes(problem.robot))
    if count == 1:
        nothing = replace(NOTHING, A=np.eye(n), c=np.zeros(n), parts=0)
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
    for mistake in list_position_mistakes(n, False):
        scale = float(np.cbrt(np.linalg.det(mistake.B)))
        if factor * scale <= 0:
            continue
        difference = abs(np.log(factor / scale))
        if difference < NEAR_SCALE:
            yield joint.then(mistake) if has_joint else mistake
