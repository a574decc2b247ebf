"""Joint offsets: zeros that are off by any angle and links that the nominal arm has wrong, fitted
exactly together with the set-up.

Unknown are the placement, the target and a few numbers of the arm: a reading's zero, or where a
joint sits on the link before it (the a b c of its frame). One at a time is fitted on the exact chain
by Levenberg-Marquardt with a redescending loss, a zero from the angles at which an affine map from
the tracker would do best; then a second, a third and a fourth from where the best ended."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from .._typing import Array, Index
from ..fitting.problem import Problem
from ..robot.kinematics import Pose, Robot, pose
from ..robot.rigid import nearest_rotation, transform
from .minimisation import COARSE, minimise
from .offset_words import REST_RANGE, describe_offsets
from .placement import (
    LOSS,
    MAX_ROUNDS,
    MEDIAN_3,
    STATED_MM,
    USUAL_MM,
    cross_matrices,
    fit_rigid_transform,
)
from .robust_weights import compute_redescending_loss, compute_redescending_weights
from .simple_mistakes import Mistake, score_linearly

# angles of a joint's zero that are tried, and how many of the best are fitted from
ANGLE_STEP = np.pi / 18
PEAKS = 2
# prior standard deviations of zeros [rad; mm of a slide] and of lengths [mm]
ZERO_SIGMA = 1.0
LENGTH_SIGMA_MM = 200.0
# nearness to a right angle, which has a sentence of its own
NEAR_RIGHT = np.radians(5)
# share to which each more number must bring what is left for a next to be looked for
MIN_FALL = 0.8
# numbers of the arm that are wrong at once, and links among them
MAX_PARTS = 4
MAX_LINKS = 2
# times that the scale of the loss is taken anew, and share of the median before from which it has
# stalled
SCALE_ROUNDS = 4
STALLED = 0.95
# median below which the scale of the loss does not fall
MIN_MEDIAN_MM = 1e-6
# resting joints whose angles are looked for together, and the angles that are tried
MAX_RESTING = 3
THIRDS = (-2 * np.pi / 3, 0.0, 2 * np.pi / 3)


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
        """Build the arm with these links."""
        if not self.links.any():
            return nominal
        joints = tuple(
            replace(joint, before=joint.before @ transform(None, link))
            for joint, link in zip(nominal.joints, self.links, strict=True)
        )
        return replace(nominal, joints=joints)

    def compute_residuals(self, problem: Problem) -> tuple[Pose, Array]:
        """Compute (the chain at the rows' readings, (m, 3) measured minus predicted positions)."""
        arm = self.robot(problem.robot)
        at = pose(
            arm,
            problem.data.q + self.zeros,
            self.tool,
        )
        x = problem.data.position
        base = at.target.T
        predicted = base @ self.R.T
        residual = x - predicted
        residual -= self.t
        return at, residual

    def compute_misfit(self, problem: Problem) -> float:
        """Compute the median distance that is left [mm]."""
        _, residual = self.compute_residuals(problem)
        distance = np.linalg.norm(
            residual,
            axis=1,
        )
        return float(np.median(distance))

    def has_right_angles(self) -> bool:
        """Return whether only zeros are off, by right angles."""
        if self.links.any():
            return False
        quarter = np.pi / 2
        eighth = np.pi / 4
        from_right = (self.zeros + eighth) % quarter - eighth
        size = np.abs(from_right)
        is_near = size < NEAR_RIGHT
        return bool(is_near.all())

    def apply(self, problem: Problem) -> Problem:
        """Apply this arm and set-up to the rows as the nominal ones."""
        groups = len(problem.placement[0])
        targets = len(problem.tools)
        readings = problem.data.q + self.zeros
        data = replace(problem.data, q=readings)
        R = np.tile(self.R, (groups, 1, 1))
        t = np.tile(self.t, (groups, 1))
        return replace(
            problem,
            robot=self.robot(problem.robot),
            data=data,
            placement=(R, t),
            tools=np.tile(self.tool, (targets, 1)),
        )

    def offsets(self) -> Array:
        """(4 n,) zeros and lengths of the links."""
        lengths = self.links.ravel()
        return np.concatenate(
            [
                self.zeros,
                lengths,
            ]
        )


# The unknowns: turn and shift of the placement, target, zeros, lengths of the links.
SET_UP = 6
TARGET = 9


def build_nominal_arm(problem: Problem) -> Arm:
    """Build the nominal arm with the set-up of a problem of one target and one placement."""
    n = problem.robot.n
    R, t = problem.placement
    group = problem.data.group[0]
    target = problem.data.target[0]
    return Arm(
        R=R[group],
        t=t[group],
        tool=problem.tools[target],
        zeros=np.zeros(n),
        links=np.zeros((n, 3)),
    )


def _compute_jacobian(problem: Problem, arm: Arm, at: Pose) -> Array:
    """Compute (m, 3, 9 + 4 n) changes of the predicted positions per unit of turn and shift (about
    the middle), tool, zeros and links."""
    n = problem.robot.n
    y = at.target.T @ arm.R.T
    field = at.displacement()
    zeros = []
    for j, slides in enumerate(problem.robot.prismatic):
        motion = 2 if slides else 5
        zeros.append(field[j, motion])
    links = at.axes[:n, :3]
    # (3 + 4 n, 3, m)
    in_base = np.concatenate(
        [
            at.axes[n, :3],
            np.stack(zeros),
            links.reshape(3 * n, 3, -1),
        ]
    )
    middle = np.median(y, axis=0)
    turn = -cross_matrices(y - middle)
    shift = np.tile(np.eye(3), (len(y), 1, 1))
    of_arm = np.einsum(
        "ij,kjm->mik",
        arm.R,
        in_base,
    )
    return np.concatenate([turn, shift, of_arm], axis=2)


def _take_step(problem: Problem, arm: Arm, step: Array) -> Arm:
    """Take a step (9 + 4 n,) of the unknowns."""
    from scipy.spatial.transform import Rotation

    n = problem.robot.n
    turn = Rotation.from_rotvec(step[:3])
    W = turn.as_matrix()
    shift = step[3:SET_UP]
    tool = step[SET_UP:TARGET]
    zeros = step[TARGET : TARGET + n]
    lengths = step[TARGET + n :]
    links = lengths.reshape(n, 3)
    at, _ = arm.compute_residuals(problem)
    y = at.target.T @ arm.R.T
    middle = np.median(y, axis=0)
    turned_middle = W @ middle
    return Arm(
        R=nearest_rotation(W @ arm.R),
        t=arm.t + shift + middle - turned_middle,
        tool=arm.tool + tool,
        zeros=arm.zeros + zeros,
        links=arm.links + links,
    )


class _Objective:
    """The loss of an arm and its set-up, with the prior of all unknowns, for the minimisation.

    `free`: indices of the unknowns that are fitted; `median` [mm]: what is left, which scales the
    loss and the prior."""

    def __init__(self, problem: Problem, free: Index, median: float):
        self.problem = problem
        self.free = free
        self.scale = LOSS * median
        n = problem.robot.n
        target = problem.data.target[0]
        self.usual = problem.tools[target]
        is_stated = self.usual.any()
        tool_mm = STATED_MM if is_stated else USUAL_MM
        zero_sigma = np.where(
            problem.robot.prismatic,
            LENGTH_SIGMA_MM,
            ZERO_SIGMA,
        )
        sigma = np.concatenate(
            [
                np.full(3, tool_mm),
                zero_sigma,
                np.full(3 * n, LENGTH_SIGMA_MM),
            ]
        )
        of_set_up = np.zeros(SET_UP)
        of_offsets = (median / MEDIAN_3 / sigma) ** 2
        self.prior = np.concatenate([of_set_up, of_offsets])

    def _offset(self, arm: Arm) -> Array:
        """Compute (9 + 4 n,) offsets of the unknowns from where they are expected."""
        of_set_up = np.zeros(SET_UP)
        of_tool = arm.tool - self.usual
        return np.concatenate(
            [
                of_set_up,
                of_tool,
                arm.offsets(),
            ]
        )

    def cost(self, arm: Arm) -> float:
        """Compute the redescending loss and the prior's squares."""
        _, residual = arm.compute_residuals(self.problem)
        square = np.square(residual).sum(1)
        loss, _ = compute_redescending_loss(
            square,
            self.scale,
        )
        total = loss.sum()
        offset = self._offset(arm)
        penalty = self.prior @ offset**2
        return float(total + penalty)

    def equations(self, arm: Arm) -> tuple[Array, Array]:
        """Compute the normal equations of a step of the free unknowns."""
        free = self.free
        at, residual = arm.compute_residuals(self.problem)
        J = _compute_jacobian(self.problem, arm, at)
        J = J[:, :, free]
        square = np.square(residual).sum(1)
        _, weight = compute_redescending_loss(square, self.scale)
        prior = self.prior[free]
        offset = self._offset(arm)
        H = np.einsum(
            "m,mik,mil->kl",
            weight,
            J,
            J,
            optimize=True,
        )
        g = np.einsum(
            "m,mik,mi->k",
            weight,
            J,
            residual,
        )
        return H + np.diag(prior), g - prior * offset[free]

    def move(self, arm: Arm, step: Array) -> Arm:
        """Take a step of the free unknowns."""
        n = self.problem.robot.n
        unknowns = TARGET + 4 * n
        whole = np.zeros(unknowns)
        whole[self.free] = step
        return _take_step(
            self.problem,
            arm,
            whole,
        )


def fit_offsets(problem: Problem, arm: Arm, free: Sequence[int], set_up: bool) -> Arm:
    """Fit the numbers `free` of the arm (0 … n-1 zeros, n … 4n-1 lengths of links) and, where
    `set_up`, the placement and target, from where they are."""
    unknowns = [TARGET + k for k in free]
    if set_up:
        unknowns = [*range(TARGET), *unknowns]
    indices = np.array(unknowns, dtype=np.intp)
    before = np.inf
    for _ in range(SCALE_ROUNDS):
        misfit = arm.compute_misfit(problem)
        median = max(misfit, MIN_MEDIAN_MM)
        if median > STALLED * before:
            break
        before = median
        objective = _Objective(problem, indices, median)
        arm = minimise(
            arm,
            objective.cost,
            objective.equations,
            objective.move,
            COARSE,
        )
    return arm


def _place(problem: Problem, arm: Arm) -> Arm:
    """Place an arm by a reweighted rigid fit."""
    x = problem.data.position
    at, _ = arm.compute_residuals(problem)
    y = at.target.T
    weight = np.ones(len(y))
    for _ in range(MAX_ROUNDS):
        R, t = fit_rigid_transform(x, y, weight)
        rest = x - y @ R.T - t
        distance = np.linalg.norm(rest, axis=1)
        median = float(np.median(distance))
        scale = max(
            LOSS * median,
            MIN_MEDIAN_MM,
        )
        weight = compute_redescending_weights(
            distance,
            scale,
        )
    return replace(arm, R=R, t=t)


def _link_numbers(n: int, j: int) -> list[int]:
    """List the indices of the lengths of joint j's link among the numbers of an arm."""
    first = n + 3 * j
    beyond = first + 3
    numbers = range(first, beyond)
    return list(numbers)


def fit_each_zero(problem: Problem, set_up: bool) -> Iterator[tuple[Mistake, Arm]]:
    """Fit every joint's zero, off by any angle, one at a time."""
    for j, slides in enumerate(problem.robot.prismatic):
        nominal = build_nominal_arm(problem)
        arm = fit_offsets(
            problem,
            nominal,
            [j],
            set_up,
        )
        fitted = [arm]
        if not slides:
            peaks = _find_peaks(problem, j, set_up)
            fitted += [_fit_from(problem, start, j, set_up) for start in peaks]
        best = min(fitted, key=lambda a: a.compute_misfit(problem))
        yield from _describe(problem, best)


def _fit_from(problem: Problem, start: Arm, j: int, set_up: bool) -> Arm:
    if set_up:
        start = _place(problem, start)
    return fit_offsets(problem, start, [j], set_up)


def _find_peaks(problem: Problem, j: int, set_up: bool) -> list[Arm]:
    """Find the arms with a zero of joint j, among angles all around, that promise most."""
    n = problem.robot.n
    nominal = build_nominal_arm(problem)
    unit = np.eye(n)[j]
    arms = []
    for step in range(1, 36):
        angle = step * ANGLE_STEP
        arms.append(replace(nominal, zeros=angle * unit))
    if set_up:
        mistakes = []
        for arm in arms:
            mistake = Mistake(
                words="",
                look="",
                A=np.eye(n),
                c=arm.zeros,
                B=np.eye(3),
            )
            mistakes.append(mistake)
        misfit, _ = score_linearly(problem, mistakes)
    else:
        misfits = [arm.compute_misfit(problem) for arm in arms]
        misfit = np.array(misfits)
    likeliest = np.argsort(misfit, kind="stable")
    return [arms[k] for k in likeliest[:PEAKS]]


def fit_each_link(problem: Problem, set_up: bool) -> Iterator[tuple[Mistake, Arm]]:
    """Fit every link's a b c, off by any length, one link at a time."""
    n = problem.robot.n
    nominal = build_nominal_arm(problem)
    # a set-up found from the rows takes up the first link
    first = 1 if set_up else 0
    for j in range(first, n):
        numbers = _link_numbers(n, j)
        arm = fit_offsets(problem, nominal, numbers, set_up)
        yield from _describe(problem, arm)


def fit_several(
    problem: Problem, good: float, first: Sequence[Arm], links: bool = True
) -> Iterator[tuple[Mistake, Arm]]:
    """Fit several offsets at once that leave no more than `good` [mm]: zeros, those of joints that
    rest, then, with `links`, links too.

    Starts from the best of the arms that were fitted `first`, and always adds the offset that
    leaves least."""
    n = problem.robot.n
    zeros = [[j] for j in range(n)]
    of_zeros = [arm for arm in first if not arm.links.any()]
    resting = _fit_resting(problem)
    best = _fit_best(
        problem,
        good,
        of_zeros,
        zeros,
        resting,
    )
    is_bad = best.compute_misfit(problem) > good
    if is_bad and links:
        frames = [_link_numbers(n, j) for j in range(1, n)]
        best = _fit_best(
            problem,
            good,
            first,
            [*zeros, *frames],
            [],
        )
    misfit = best.compute_misfit(problem)
    if misfit <= good:
        yield from _describe(problem, best)


def _fit_best(
    problem: Problem,
    good: float,
    first: Sequence[Arm],
    groups: Sequence[list[int]],
    others: Sequence[Arm],
) -> Arm:
    """Add offsets, of `groups` of numbers, to the best of the arms `first`: the best of these and of
    `others`."""

    def compute_misfit(arm: Arm) -> float:
        return arm.compute_misfit(problem)

    nominal = build_nominal_arm(problem)
    starts = sorted(first or [nominal], key=compute_misfit)
    extended = []
    for start in starts[:PEAKS]:
        arm = _add_offsets(
            problem,
            good,
            start,
            groups,
        )
        extended.append(arm)
    return min([*extended, *others], key=compute_misfit)


def _add_offsets(problem: Problem, good: float, arm: Arm, groups: Sequence[list[int]]) -> Arm:
    """Add the group of numbers that leaves least, one after the other, until what is left is good or
    falls no more."""
    offsets = arm.offsets()
    taken = [group for group in groups if offsets[group].any()]
    before = np.inf
    misfit = arm.compute_misfit(problem)
    while len(taken) < MAX_PARTS and good < misfit < MIN_FALL * before:
        links = sum(len(group) > 1 for group in taken)
        offered = []
        for group in groups:
            is_link = len(group) > 1
            is_allowed = not is_link or links < MAX_LINKS
            if is_allowed and group not in taken:
                offered.append(group)
        if not offered:
            break
        present = [k for group in taken for k in group]
        fitted = []
        for group in offered:
            extended = fit_offsets(
                problem,
                arm,
                [*present, *group],
                True,
            )
            fitted.append(extended)
        misfits = [a.compute_misfit(problem) for a in fitted]
        best = int(np.argmin(misfits))
        arm = fitted[best]
        taken.append(offered[best])
        before = misfit
        misfit = misfits[best]
    return arm


def _fit_resting(problem: Problem) -> list[Arm]:
    """Fit joints that rest between others that move, from all combinations of angles: readings that
    were not recorded."""
    resting = _find_resting(problem)
    count = len(resting)
    if not 2 <= count <= MAX_RESTING:
        return []
    identity = np.eye(problem.robot.n)
    nominal = build_nominal_arm(problem)
    fitted = []
    for angles in product(THIRDS, repeat=count):
        zeros = identity[resting].T @ np.array(angles)
        turned = replace(nominal, zeros=zeros)
        start = _place(problem, turned)
        arm = fit_offsets(problem, start, resting, True)
        fitted.append(arm)
    return fitted


def _find_resting(problem: Problem) -> list[int]:
    """Find the turning joints that rest between the first and the last that moves."""
    spread = np.ptp(problem.data.q, axis=0)
    is_moving = spread >= REST_RANGE
    moving = np.flatnonzero(is_moving).tolist()
    if not moving:
        return []
    slides = problem.robot.prismatic
    resting = []
    for j in range(moving[0], moving[-1]):
        rests = j not in moving
        if rests and not slides[j]:
            resting.append(j)
    return resting


def _describe(problem: Problem, arm: Arm) -> Iterator[tuple[Mistake, Arm]]:
    """Pair an arm with its offsets as a mistake; nothing where these are too small to be one."""
    mistake = describe_offsets(problem, arm.zeros, arm.links)
    if mistake is not None:
        yield mistake, arm
