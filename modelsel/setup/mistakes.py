"""Which mistake of the set-up explains the positions: a joint's sense or zero, columns, units, a
mirrored axis, the tool, a link.

Every mistake is a change of the readings, q -> A q + c, or of the positions. All are tried at once:
for given readings the best free affine map from the tracker to frame 0 and the best target are
linear, and what they leave is what registration leaves at least. Whatever does well is then
registered as it stands. Zeros off by any angle and wrong links are fitted (`offsets`). Nothing is
applied: the sentence says what would fit. A mistake counts only where the rows tell how the tracker
then stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ..exceptions import DataError, NotEstimable
from ..fitting.design import residuals
from ..fitting.problem import Problem
from ..robot.kinematics import pose
from .joint_offsets import Arm, fit_several, of_joint, of_links
from .other_robots import describe_improvement
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

ROWS = 120  # that are looked at, spread over the file
LEAST = (
    10  # configurations, below which chance fits too much; twice as many for two mistakes at once
)
BAD, FAR = (
    3e-3,
    0.01,
    # of the reach: a median residual from which one mistake is looked for, from which the tool's or
    # several
)
FACTOR = 4.0  # a mistake explains the positions if without it they fit so much better,
GOOD = 0.05  # and to this share of what they spread (median)
ALIKE = 1.5  # mistakes that fit as well as the best, within this factor, are told with it
TWICE = 2.0  # a right angle is said as such unless an angle near it fits so much better
MAX_NAMED = 2  # mistakes in a sentence
TRIED = 8  # of the linear solutions that are registered
NEAR = 0.1  # of the logarithm of a scale, for a unit to be tried


def describe_setup_mistake(
    problem: Problem,
    use: NDArray[np.bool_],
    registered: bool,
    per_group: bool = False,
    links: bool = True,
) -> str | None:
    """A sentence that says which simple mistake of the set-up explains what the rows `use` (mask)
    of a problem leave at its placement and tools, with the median distance before and after; None
    where they leave little, or no mistake explains it. `registered`: placement and tools were found
    from the rows; else they are what the study says. `links`: whether links may be what is off."""
    some = _sample(problem, use, per_group)
    reach = problem.reach_mm
    if some is None or (before := _left(some)) < BAD * reach:
        return None
    singles, also = tuple(list_position_mistakes(problem.robot)), ""
    if registered:
        some = _registered(some, False) or some
        before = _left(some)
        if before < BAD * reach:  # orientations were at odds with the positions
            return None
    limit, far = before / FACTOR, before > FAR * reach
    if not registered:
        if found := _stated(some, singles, limit, far, links):
            return _sentence(before, found)
        some = _registered(some, False) or some
        also = "the tracker's frame and the target on the flange are found ([robot] register = true), and "
    tried, offsets = _tried(some, singles, 1), _offsets(some, True, links)
    simple = min((left for _, left in _best(tried, limit)), default=np.inf)
    tried += [
        (m, left)
        for m, arm in offsets
        if (left := _sure(some, arm)) < (simple / TWICE if arm.right_angle() else np.inf)
    ]
    best = _best(tried, limit)
    poor = min((left for _, left in best), default=np.inf) > FAR * reach
    if far and poor and len(np.unique(some.data.block)) >= 2 * LEAST:
        tried += _tried(some, singles, 2)
        best = _best(tried, limit)
        if min((left for _, left in best), default=np.inf) > FAR * reach:
            more = fit_several(some, min(limit, BAD * reach), [arm for _, arm in offsets], links)
            best = _best([*tried, *((m, _sure(some, arm)) for m, arm in more)], limit)
    return _sentence(before, best, also) if best else None


def _stated(
    problem: Problem, singles: Sequence[Mistake], limit: float, far: bool, links: bool
) -> list[tuple[Mistake, float]]:
    """What explains the positions where the study says the frame and the target."""
    simple = [
        (m, _explained(_changed(problem, m)))
        for m in (*singles, *list_reversed_joints(problem.robot.n, True))
    ]
    found = _best([*(_tool(problem) if far else []), *simple], limit)
    found = found or _best(
        [(m, _sure(problem, arm)) for m, arm in _offsets(problem, False, links)], limit
    )
    if (
        not found
        and far
        and (placed := _registered(problem)) is not None
        and (left := _explained(placed)) <= limit
    ):
        return [(REGISTER, left)]
    return found


def _offsets(problem: Problem, set_up: bool, links: bool) -> list[tuple[Mistake, Arm]]:
    """One joint's zero or, with `links`, one link off, each as it fits best."""
    return [*of_joint(problem, set_up), *(of_links(problem, set_up) if links else ())]


def _sentence(before: float, found: Sequence[tuple[Mistake, float]], also: str = "") -> str:
    after = min(left for _, left in found)
    looks = list(dict.fromkeys(m.look for m, _ in found))
    return (
        f"The positions fit {describe_improvement(before, after)} ({_mm(after)} in place of {_mm(before)}, median) if {also}"
        f"{', or if '.join(m.words for m, _ in found)}: {', or '.join(looks)}."
    )


def _mm(value: float) -> str:
    return f"{value:.0f} mm" if value >= 100 else f"{value:.2g} mm"


def _sample(problem: Problem, use: NDArray[np.bool_], per_group: bool) -> Problem | None:
    """At most ROWS measured positions of one target, and of one group where each has its placement;
    None where too few."""
    data = problem.data
    rows = np.flatnonzero(use if data.gauges is None else use & data.gauges.of("point"))
    for index in (data.target, *([data.group] if per_group else [])):
        if len(rows):
            rows = rows[index[rows] == np.bincount(index[rows]).argmax()]
    rows = (
        rows[np.unique(np.linspace(0, len(rows) - 1, min(len(rows), ROWS)).astype(int))]
        if len(rows)
        else rows
    )
    if len(np.unique(data.block[rows])) < LEAST:
        return None
    return problem.take(rows).plain_points()


def _left(problem: Problem) -> float:
    return float(np.median(np.linalg.norm(residuals(problem), axis=1)))


def _explained(problem: Problem) -> float:
    """What is left, infinite where it is much of what the positions spread: positions that hardly
    move fit anything."""
    x, left = problem.data.position, _left(problem)
    return (
        left
        if left <= GOOD * float(np.median(np.linalg.norm(x - np.median(x, axis=0), axis=1)))
        else np.inf
    )


def _registered(problem: Problem, sure: bool = True) -> Problem | None:
    """Placed anew, the target anywhere near the flange; None where the rows do not tell it (`sure`:
    hardly)."""
    bare, use = replace(problem, tools=np.zeros_like(problem.tools)), np.ones(len(problem), bool)
    try:
        found = register(bare, use, per_group=False)
    except (DataError, NotEstimable):
        return None
    return (
        None
        if sure
        and "registration-weak"
        in {n.code for n in note_undetermined(found, use, False, bare.tools)}
        else found
    )


def _sure(problem: Problem, arm: Arm) -> float:
    """`_explained` of an arm that is not nominal, infinite where the rows do not tell its
    set-up."""
    at = arm.problem(problem)
    weak = note_undetermined(at, np.ones(len(at), bool), False, np.zeros_like(at.tools))
    return np.inf if "registration-weak" in {n.code for n in weak} else _explained(at)


def _changed(problem: Problem, m: Mistake) -> Problem:
    data = replace(
        problem.data, q=problem.data.q @ m.A.T + m.c, position=problem.data.position @ m.B.T
    )
    return replace(problem, data=data)


def _best(tried: Sequence[tuple[Mistake, float]], limit: float) -> list[tuple[Mistake, float]]:
    """The mistakes that leave least, best first: those within the limit and as good as the best, of
    the fewest parts."""
    least = min((left for _, left in tried), default=np.inf)
    good = [(m, left) for m, left in tried if left <= min(limit, ALIKE * least)]
    fewest = min((m.parts for m, _ in good), default=0)
    return sorted((each for each in good if each[0].parts == fewest), key=lambda each: each[1])[
        :MAX_NAMED
    ]


def _tool(problem: Problem) -> list[tuple[Mistake, float]]:
    """The target elsewhere on the flange: where most rows have it (median)."""
    R, t = problem.placement
    at = pose(problem.robot, problem.data.q, np.zeros(3))
    base = np.einsum(
        "mji,mj->mi", R[problem.data.group], problem.data.position - t[problem.data.group]
    )
    offset = np.median(np.einsum("aim,mi->ma", at.axes[-1, :3], base - at.target.T), axis=0)
    moved = replace(problem, tools=np.tile(offset, (len(problem.tools), 1)))
    name = problem.data.targets[problem.data.target[0]]
    called = f"target {name}" if len(problem.tools) > 1 else "the target"
    words = f"{called} sits at {', '.join(f'{v:.1f}' for v in offset)} mm on the flange"
    return [(replace(NOTHING, words=words, look="check tool_mm in the study"), _explained(moved))]


def _tried(problem: Problem, singles: Sequence[Mistake], count: int) -> list[tuple[Mistake, float]]:
    """Up to `count` mistakes at once, with what is left once registered; of what does best in the
    linear solution alone."""
    n = problem.robot.n
    nothing = replace(NOTHING, A=np.eye(n), c=np.zeros(n), parts=0)
    joints = (
        [nothing, *singles]
        if count == 1
        else [*singles, *(a.then(b) for a, b in combinations(singles, 2)), *score_linearly(n)]
    )
    score, factor = list_joint_mistakes(problem, joints)
    order = np.lexsort(
        (score, np.where(score <= ALIKE * score.min(), [m.parts for m in joints], np.inf))
    )
    out = []
    for k in order[:TRIED]:
        joint = joints[k]
        more = [joint] if joint.parts else []
        if joint.parts < count:
            more += [
                joint.then(m) if joint.parts else m
                for m, scale in zip(
                    list_reversed_joints(n, False),
                    (*(unit.scale for unit in SCALES), -1.0),
                    strict=True,
                )
                if factor[k] * scale > 0 and abs(np.log(factor[k] / scale)) < NEAR
            ]
        placed = ((m, _registered(_changed(problem, m))) for m in more)
        out += [(m, _explained(at)) for m, at in placed if at is not None]
    return out
