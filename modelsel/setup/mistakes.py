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
    found = _explain_stated(sample, before, links)
    if found:
        return _describe(before, found)
    sample = _try_registration(sample, sure=False) or sample
    found = _explain_registered(sample, before, links)
    return _describe(before, found, REGISTRATION) if found else None


def _explain_stated(problem: Problem, before: float, links: bool) -> list[Explanation]:
    """Explain the positions with frame and target as the study states them."""
    limit = before / MIN_IMPROVEMENT
    is_far = before > FAR_SHARE * problem.reach_mm
    tried = [_move_tool(problem)] if is_far else []
    robot = problem.robot
    simple = (*list_joint_mistakes(robot), *list_position_mistakes(robot.n, True))
    tried += [Explanation(m, _compute_explained(_apply(problem, m))) for m in simple]
    found = _select_best(tried, limit)
    if not found:
        offsets = _fit_offsets(problem, False, links)
        found = _select_best(
            [Explanation(m, _assess_arm(problem, arm)) for m, arm in offsets], limit
        )
    if not found and is_far:
        found = _explain_by_registration(problem, limit)
    return found


def _explain_by_registration(problem: Problem, limit: float) -> list[Explanation]:
    registered = _try_registration(problem)
    left = np.inf if registered is None else _compute_explained(registered)
    return [Explanation(REGISTER, left)] if left <= limit else []


def _explain_registered(problem: Problem, before: float, links: bool) -> list[Explanation]:
    """Explain the positions with frame and target found: by one simple mistake, one offset, two
    simple mistakes, or several offsets."""
    limit, far = before / MIN_IMPROVEMENT, FAR_SHARE * problem.reach_mm
    tried = _try_mistakes(problem, 1)
    offsets = _fit_offsets(problem, True, links)
    tried += _assess_offsets(problem, offsets, _find_least(_select_best(tried, limit)))
    best = _select_best(tried, limit)
    has_rows = len(np.unique(problem.data.block)) >= 2 * MIN_CONFIGURATIONS
    if before <= far or _find_least(best) <= far or not has_rows:
        return best
    tried += _try_mistakes(problem, 2)
    best = _select_best(tried, limit)
    if _find_least(best) <= far:
        return best
    good = min(limit, BAD_SHARE * problem.reach_mm)
    several = fit_several(problem, good, [arm for _, arm in offsets], links)
    tried += [Explanation(m, _assess_arm(problem, arm)) for m, arm in several]
    return _select_best(tried, limit)


def _assess_offsets(
    problem: Problem, offsets: Sequence[tuple[Mistake, Arm]], simple: float
) -> Iterator[Explanation]:
    """Assess fitted offsets; right angles only where they fit clearly better than `simple` [mm],
    what the simple mistakes leave."""
    for mistake, arm in offsets:
        limit = simple / RIGHT_ANGLE_FACTOR if arm.has_right_angles() else np.inf
        left = _assess_arm(problem, arm)
        if left < limit:
            yield Explanation(mistake, left)


def _fit_offsets(problem: Problem, set_up: bool, links: bool) -> list[tuple[Mistake, Arm]]:
    """Fit one joint's zero or, with `links`, one link at a time."""
    zeros = list(fit_each_zero(problem, set_up))
    return [*zeros, *fit_each_link(problem, set_up)] if links else zeros


def _describe(before: float, found: Sequence[Explanation], also: str = "") -> str:
    after = _find_least(found)
    looks = dict.fromkeys(mistake.look for mistake, _ in found)
    words = ", or if ".join(mistake.words for mistake, _ in found)
    return (
        f"The positions fit {describe_improvement(before, after)} ({_format_length(after)} instead "
        f"of {_format_length(before)}, median) if {also}{words}: {', or '.join(looks)}."
    )


def _format_length(value: float) -> str:
    return f"{value:.0f} mm" if value >= 100 else f"{value:.2g} mm"


def _compute_left(problem: Problem) -> float:
    """Compute the median distance that is left [mm]."""
    return float(np.median(np.linalg.norm(residuals(problem), axis=1)))


def _compute_explained(problem: Problem) -> float:
    """Compute the median distance that is left [mm]; infinite where it is much of the positions'
    spread, because positions that hardly move fit anything."""
    x, left = problem.data.position, _compute_left(problem)
    spread = float(np.median(np.linalg.norm(x - np.median(x, axis=0), axis=1)))
    return left if left <= MAX_SPREAD_SHARE * spread else np.inf


def _try_registration(problem: Problem, sure: bool = True) -> Problem | None:
    """Register a problem anew, with the target anywhere near the flange; None where the rows do not
    determine it (`sure`: or determine it poorly)."""
    bare = replace(problem, tools=np.zeros_like(problem.tools))
    use = np.ones(len(problem), bool)
    try:
        registered = register(bare, use, per_group=False)
    except (DataError, NotEstimable):
        return None
    return None if sure and _is_weak(registered) else registered


def _is_weak(problem: Problem) -> bool:
    """Return whether the rows of a registered problem determine its placement poorly."""
    use, expected = np.ones(len(problem), bool), np.zeros_like(problem.tools)
    notes = note_undetermined(problem, use, False, expected)
    return "registration-weak" in {note.code for note in notes}


def _assess_arm(problem: Problem, arm: Arm) -> float:
    """Compute what an arm that is not nominal explains; infinite where the rows do not determine its
    set-up."""
    applied = arm.apply(problem)
    return np.inf if _is_weak(applied) else _compute_explained(applied)


def _apply(problem: Problem, mistake: Mistake) -> Problem:
    """Apply the correction of a mistake."""
    q = problem.data.q @ mistake.A.T + mistake.c
    position = problem.data.position @ mistake.B.T
    return replace(problem, data=replace(problem.data, q=q, position=position))


def _find_least(explanations: Sequence[Explanation]) -> float:
    return min((left for _, left in explanations), default=np.inf)


def _select_best(tried: Sequence[Explanation], limit: float) -> list[Explanation]:
    """Select the mistakes that leave least, best first: those within the limit and as good as the
    best, of the fewest parts."""
    most = min(limit, EQUAL_FACTOR * _find_least(tried))
    good = [explanation for explanation in tried if explanation.left <= most]
    fewest = min((mistake.parts for mistake, _ in good), default=0)
    simplest = [explanation for explanation in good if explanation.mistake.parts == fewest]
    return sorted(simplest, key=lambda explanation: explanation.left)[:MAX_NAMED]


def _move_tool(problem: Problem) -> Explanation:
    """Move the target on the flange to where most rows have it (median)."""
    R, t = problem.placement
    group = problem.data.group
    flange = pose(problem.robot, problem.data.q, np.zeros(3))
    base = np.einsum("mji,mj->mi", R[group], problem.data.position - t[group])
    on_flange = np.einsum("aim,mi->ma", flange.axes[-1, :3], base - flange.target.T)
    offset = np.median(on_flange, axis=0)
    moved = replace(problem, tools=np.tile(offset, (len(problem.tools), 1)))
    name = problem.data.targets[problem.data.target[0]]
    target = f"target {name}" if len(problem.tools) > 1 else "the target"
    coordinates = ", ".join(f"{value:.1f}" for value in offset)
    words = f"{target} sits at {coordinates} mm on the flange"
    mistake = replace(NOTHING, words=words, look="check tool_mm in the study")
    return Explanation(mistake, _compute_explained(moved))


def _try_mistakes(problem: Problem, count: int) -> list[Explanation]:
    """Try up to `count` mistakes at once: register those that do best in the linear solution."""
    joints = _list_combinations(problem, count)
    score, factor = score_linearly(problem, joints)
    is_good = score <= EQUAL_FACTOR * score.min()
    parts = np.where(is_good, [mistake.parts for mistake in joints], np.inf)
    explanations = []
    for k in np.lexsort((score, parts))[:MAX_REGISTERED]:
        for mistake in _generate_with_positions(problem, joints[k], float(factor[k]), count):
            registered = _try_registration(_apply(problem, mistake))
            if registered is not None:
                explanations.append(Explanation(mistake, _compute_explained(registered)))
    return explanations


def _list_combinations(problem: Problem, count: int) -> list[Mistake]:
    """List mistakes of the readings: none and single ones, or single ones, pairs of them, and three
    and more joints that turn the other way."""
    n = problem.robot.n
    singles = list(list_joint_mistakes(problem.robot))
    if count == 1:
        nothing = replace(NOTHING, A=np.eye(n), c=np.zeros(n), parts=0)
        return [nothing, *singles]
    pairs = (first.then(second) for first, second in combinations(singles, 2))
    return [*singles, *pairs, *list_reversed_joints(n)]


def _generate_with_positions(
    problem: Problem, joint: Mistake, factor: float, count: int
) -> Iterator[Mistake]:
    """Generate a mistake of the readings alone and, if it may have another part, with mistakes of
    the positions whose scale is near the affine map's `factor`."""
    if joint.parts:
        yield joint
    if joint.parts >= count:
        return
    scales = (*(unit.scale for unit in SCALES), -1.0)
    for mistake, scale in zip(list_position_mistakes(problem.robot.n, False), scales, strict=True):
        has_same_sign = factor * scale > 0
        if has_same_sign and abs(np.log(factor / scale)) < NEAR_SCALE:
            yield joint.then(mistake) if joint.parts else mistake
