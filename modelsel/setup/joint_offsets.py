"""Joint zeros that are off by any angle and links that the nominal arm has wrong, from an exact fit
together with the set-up.

Unknown are the placement, the target and a few numbers of the arm: a reading's zero, or where a
joint sits on the link before it (the a b c of its frame). One at a time is descended on the exact
chain by Levenberg-Marquardt on a redescending loss, a zero from the angles at which an affine map
from the tracker would do best; then a second, a third and a fourth from where the best ended."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from .._typing import Array
from ..exceptions import sentence_list
from ..fitting.problem import Problem
from ..robot.kinematics import Pose, Robot, pose
from ..robot.rigid import nearest_rotation, transform
from .placement import (
    COARSE,
    LOSS,
    MEDIAN_3,
    ROUNDS,
    STATED_MM,
    USUAL_MM,
    cross_matrices,
    descend,
    fit_rigid_transform,
)
from .simple_mistakes import Mistake, list_joint_mistakes

STEP = np.pi / 18  # of the angles that are tried of a joint's zero
PEAKS = 2  # angles of each joint from which it is descended
DEGREES, LINK_MM = (
    3.0,
    15.0,
)  # smallest zero and link that are called a mistake: less is an arm's own error, which is fitted
ZERO, LENGTH_MM = 1.0, 200.0  # prior standard deviations: rad (mm of a slide: the next), mm
RIGHT = np.radians(5)  # nearness to a right angle, which has a sentence of its own
FALL = 0.8  # to which each more of them must bring what is left for a next to be looked for
MAX_PARTS, FRAMES = 4, 2  # numbers of the arm that are wrong at once: zeros, links
SCALE_ROUNDS = 4  # that the scale of the loss is taken anew
RESTS = 2e-3  # rad or mm of motion below which a joint rests
MOST_REST = 3  # such joints whose angles are looked for together,
THIRDS = (-2 * np.pi / 3, 0.0, 2 * np.pi / 3)  # from these

WHOSE = "check the robot file, and whether it is this robot's"


@dataclass(frozen=True, eq=False)
class Arm:
    """A set-up and an arm that is not nominal: R (3, 3), t (3,) mm, tool (3,) mm, zeros (n,) rad or
    mm added to the readings, links (n, 3) mm before every joint."""

    R: Array
    t: Array
    tool: Array
    zeros: Array
    links: Array

    def robot(self, nominal: Robot) -> Robot:
        """The arm with these links."""
        if not self.links.any():
            return nominal
        return replace(
            nominal,
            joints=tuple(
                replace(j, before=j.before @ transform(None, link))
                for j, link in zip(nominal.joints, self.links, strict=True)
            ),
        )

    def walked(self, problem: Problem) -> tuple[Pose, Array]:
        """(the chain at the rows' readings, (m, 3) measured minus predicted positions)."""
        robot = self.robot(problem.robot)
        at = pose(robot, problem.data.q + self.zeros, self.tool)
        return at, problem.data.position - at.target.T @ self.R.T - self.t

    def left(self, problem: Problem) -> float:
        """Median distance that is left [mm]."""
        return float(np.median(np.linalg.norm(self.walked(problem)[1], axis=1)))

    def right_angle(self) -> bool:
        """Whether only zeros are off, by right angles."""
        return bool(
            (np.abs((self.zeros + np.pi / 4) % (np.pi / 2) - np.pi / 4) < RIGHT).all()
            and not self.links.any()
        )

    def problem(self, problem: Problem) -> Problem:
        """The rows with this arm and set-up as the nominal ones."""
        G, T = len(problem.placement[0]), len(problem.tools)
        return replace(
            problem,
            robot=self.robot(problem.robot),
            data=replace(problem.data, q=problem.data.q + self.zeros),
            placement=(np.tile(self.R, (G, 1, 1)), np.tile(self.t, (G, 1))),
            tools=np.tile(self.tool, (T, 1)),
        )


def build_nominal_arm(problem: Problem) -> Arm:
    """The set-up of a problem of one target and one placement, the nominal arm."""
    n = problem.robot.n
    R, t = problem.placement
    g, k = problem.data.group[0], problem.data.target[0]
    return Arm(R[g], t[g], problem.tools[k], np.zeros(n), np.zeros((n, 3)))


def _columns(problem: Problem, arm: Arm, at: Pose) -> Array:
    """(m, 3, 9 + 4 n) change of the predicted positions per unit of turn and shift (about the
    middle), tool, zeros and links."""
    n, y = problem.robot.n, at.target.T @ arm.R.T
    field = at.displacement()
    zeros = np.stack(
        [field[j, 2 if slides else 5] for j, slides in enumerate(problem.robot.prismatic)]
    )
    own = np.concatenate(
        [at.axes[n, :3], zeros, at.axes[:n, :3].reshape(3 * n, 3, -1)]
    )  # (3 + 4 n, 3, m)
    turn = -cross_matrices(y - np.median(y, axis=0))
    return np.concatenate(
        [turn, np.tile(np.eye(3), (len(y), 1, 1)), np.einsum("ij,kjm->mik", arm.R, own)], axis=2
    )


def _moved(problem: Problem, arm: Arm, step: Array) -> Arm:
    from scipy.spatial.transform import Rotation

    n = problem.robot.n
    y = arm.walked(problem)[0].target.T @ arm.R.T
    W, middle = Rotation.from_rotvec(step[:3]).as_matrix(), np.median(y, axis=0)
    return Arm(
        nearest_rotation(W @ arm.R),
        arm.t + step[3:6] + middle - W @ middle,
        arm.tool + step[6:9],
        arm.zeros + step[9 : 9 + n],
        arm.links + step[9 + n :].reshape(n, 3),
    )


def adjusted(problem: Problem, arm: Arm, free: Sequence[int], set_up: bool) -> Arm:
    """The nearest minimum over the numbers `free` of the arm (0 … n-1 zeros, n … 4n-1 links) and,
    where `set_up`, the placement and target."""
    n, usual = problem.robot.n, problem.tools[problem.data.target[0]]
    use = np.array([*(range(9) if set_up else ()), *(9 + k for k in free)], dtype=np.intp)
    sd = np.concatenate(
        [
            np.full(3, STATED_MM if usual.any() else USUAL_MM),
            np.where(problem.robot.prismatic, LENGTH_MM, ZERO),
            np.full(3 * n, LENGTH_MM),
        ]
    )
    before = np.inf
    for _ in range(SCALE_ROUNDS):
        median = max(arm.left(problem), 1e-6)
        if median > 0.95 * before:
            break
        before, scale, weight = (
            median,
            LOSS * median,
            np.concatenate([np.zeros(6), (median / MEDIAN_3 / sd) ** 2]),
        )

        def away(a: Arm) -> Array:
            return np.concatenate([np.zeros(6), a.tool - usual, a.zeros, a.links.ravel()])

        def cost(a: Arm, scale: float = scale, weight: Array = weight) -> float:
            square = np.square(a.walked(problem)[1]).sum(1)
            return float((square / (1 + square / scale**2)).sum() + weight @ away(a) ** 2)

        def equations(a: Arm, scale: float = scale, weight: Array = weight) -> tuple[Array, Array]:
            at, rest = a.walked(problem)
            J = _columns(problem, a, at)[:, :, use]
            w = 1 / (1 + np.square(rest).sum(1) / scale**2) ** 2
            H = np.einsum("m,mik,mil->kl", w, J, J, optimize=True) + np.diag(weight[use])
            return H, np.einsum("m,mik,mi->k", w, J, rest) - weight[use] * away(a)[use]

        def moved(a: Arm, step: Array) -> Arm:
            whole = np.zeros(9 + 4 * n)
            whole[use] = step
            return _moved(problem, a, whole)

        arm = descend(arm, cost, equations, moved, COARSE)
    return arm


def _placed(problem: Problem, arm: Arm) -> Arm:
    """With the rigid fit of the placement, reweighted."""
    y = arm.walked(problem)[0].target.T
    weight = np.ones(len(y))
    for _ in range(ROUNDS):
        R, t = fit_rigid_transform(problem.data.position, y, weight)
        size = np.linalg.norm(problem.data.position - y @ R.T - t, axis=1)
        weight = 1 / (1 + (size / max(LOSS * float(np.median(size)), 1e-6)) ** 2) ** 2
    return replace(arm, R=R, t=t)


def of_joint(problem: Problem, set_up: bool) -> Iterator[tuple[Mistake, Arm]]:
    """Every turning joint's zero off by any angle, as it fits best."""
    nominal, angles = build_nominal_arm(problem), np.arange(1, 36) * STEP
    for j, slides in enumerate(problem.robot.prismatic):
        if slides:
            yield from _named(problem, adjusted(problem, nominal, [j], set_up))
            continue
        tried = [replace(nominal, zeros=angle * np.eye(problem.robot.n)[j]) for angle in angles]
        if set_up:
            score = list_joint_mistakes(
                problem,
                [Mistake("", "", np.eye(problem.robot.n), a.zeros, np.eye(3)) for a in tried],
            )[0]
        else:
            score = np.array([a.left(problem) for a in tried])
        first = [tried[k] for k in np.argsort(score, kind="stable")[:PEAKS]]
        ends = [adjusted(problem, _placed(problem, a) if set_up else a, [j], set_up) for a in first]
        yield from _named(
            problem,
            min([adjusted(problem, nominal, [j], set_up), *ends], key=lambda a: a.left(problem)),
        )


def of_links(problem: Problem, set_up: bool) -> Iterator[tuple[Mistake, Arm]]:
    """Every link's a b c off by any length."""
    n, nominal = problem.robot.n, build_nominal_arm(problem)
    for j in range(1 if set_up else 0, n):
        yield from _named(
            problem, adjusted(problem, nominal, [n + 3 * j + a for a in range(3)], set_up)
        )


def fit_several(
    problem: Problem, good: float, first: Sequence[Arm], links: bool = True
) -> Iterator[tuple[Mistake, Arm]]:
    """Several of them at once that leave no more than `good` [mm]: zeros, those of joints that
    rest, then, with `links`, links too; from the best of those that were tried `first`, always the
    one more that leaves least."""
    n = problem.robot.n
    zeros, frames = (
        [[j] for j in range(n)],
        [[n + 3 * j + a for a in range(3)] for j in range(1, n)],
    )
    for groups in (zeros, [*zeros, *frames]) if links else (zeros,):
        begun = [a for a in first if groups is not zeros or not a.links.any()] or [
            build_nominal_arm(problem)
        ]
        ends = [
            _extended(problem, good, arm, groups)
            for arm in sorted(begun, key=lambda a: a.left(problem))[:PEAKS]
        ]
        if groups is zeros:
            ends += _resting(problem)
        best = min(ends, key=lambda a: a.left(problem))
        if best.left(problem) <= good:
            yield from _named(problem, best)
            return


def _extended(problem: Problem, good: float, arm: Arm, groups: Sequence[list[int]]) -> Arm:
    wrong = np.concatenate([arm.zeros, arm.links.ravel()])
    taken = [g for g in groups if wrong[g].any()]
    before = np.inf
    while len(taken) < MAX_PARTS and good < arm.left(problem) < FALL * before:
        before = arm.left(problem)
        more = [
            (adjusted(problem, arm, [k for each in [*taken, g] for k in each], True), g)
            for g in groups
            if g not in taken and (len(g) == 1 or sum(len(each) > 1 for each in taken) < FRAMES)
        ]
        arm, chosen = min(more, key=lambda each: each[0].left(problem))
        taken.append(chosen)
    return arm


def _resting(problem: Problem) -> list[Arm]:
    """The joints that rest between others that move, all turned anyhow: readings that were not
    recorded."""
    moves = np.flatnonzero(np.ptp(problem.data.q, axis=0) >= RESTS)
    rest = (
        [j for j in range(moves[0], moves[-1]) if j not in moves and not problem.robot.prismatic[j]]
        if len(moves)
        else []
    )
    if not 2 <= len(rest) <= MOST_REST:
        return []
    n, nominal = problem.robot.n, build_nominal_arm(problem)
    turns = [
        replace(nominal, zeros=np.eye(n)[rest].T @ np.array(angles))
        for angles in product(THIRDS, repeat=len(rest))
    ]
    return [adjusted(problem, _placed(problem, arm), rest, True) for arm in turns]


def _named(problem: Problem, arm: Arm) -> Iterator[tuple[Mistake, Arm]]:
    """In words, without what is no mistake; not at all where nothing is."""
    robot, words, wrong = problem.robot, list[str](), list[int]()
    for j, zero in enumerate(arm.zeros):
        off = zero if robot.prismatic[j] else np.degrees((zero + np.pi) % (2 * np.pi) - np.pi)
        if abs(off) < (LINK_MM if robot.prismatic[j] else DEGREES):
            continue
        unit, sign = ("mm", " mm") if robot.prismatic[j] else ("degrees", "°")
        words.append(
            f"joint {j + 1}'s zero is off by {abs(off):.1f} {unit} ({abs(off):.1f}{sign} is "
            f"{'added to' if off > 0 else 'taken from'} q{j + 1})"
        )
        wrong.append(j)
    links = 0
    for j, link in enumerate(arm.links):
        far = [
            f"{'abc'[a]}{j + 1} is off by {link[a]:+.1f} mm"
            for a in range(3)
            if abs(link[a]) >= LINK_MM
        ]
        if far:
            words.append(f"the nominal arm's {' and '.join(far)}")
            links += 1
    looks = [
        *_looks(problem, wrong),
        *([WHOSE if len(words) > 1 else "check the robot file"] if links else []),
    ]
    if words:
        yield (
            Mistake(
                " and ".join(words),
                ", and ".join(looks),
                np.eye(robot.n),
                arm.zeros,
                np.eye(3),
                len(words),
            ),
            arm,
        )


def _looks(problem: Problem, wrong: Sequence[int]) -> Iterator[str]:
    """Where to look for the zeros of joints (counted from 0) that are off."""
    rests = [j for j in wrong if float(np.ptp(problem.data.q[:, j])) < RESTS]
    for joints, verbs, one in (
        (rests, ("rests", "rest"), False),
        ([j for j in wrong if j not in rests], ("is", "are"), True),
    ):
        if not joints:
            continue
        named = ("joint " if len(joints) == 1 else "joints ") + sentence_list(
            [str(j + 1) for j in joints]
        )
        verb = verbs[len(joints) > 1]
        yield (
            f"check where {named} {verb} zero in the controller and in the robot file"
            if one
            else f"check the readings of {named}, which {verb}: 0 may mean that nothing was recorded"
        )
