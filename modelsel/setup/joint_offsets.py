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
        at = pose(self.robot(problem.robot), problem.data.q + self.zeros, self.tool)
        return at, problem.data.position - at.target.T @ self.R.T - self.t

    def compute_misfit(self, problem: Problem) -> float:
        """Compute the median distance that is left [mm]."""
        residual = self.compute_residuals(problem)[1]
        return float(np.median(np.linalg.norm(residual, axis=1)))

    def has_right_angles(self) -> bool:
        """Return whether only zeros are off, by right angles."""
        from_right = (self.zeros + np.pi / 4) % (np.pi / 2) - np.pi / 4
        return bool((np.abs(from_right) < NEAR_RIGHT).all() and not self.links.any())

    def apply(self, problem: Problem) -> Problem:
        """Apply this arm and set-up to the rows as the nominal ones."""
        groups, targets = len(problem.placement[0]), len(problem.tools)
        return replace(
            problem,
            robot=self.robot(problem.robot),
            data=replace(problem.data, q=problem.data.q + self.zeros),
            placement=(np.tile(self.R, (groups, 1, 1)), np.tile(self.t, (groups, 1))),
            tools=np.tile(self.tool, (targets, 1)),
        )

    def offsets(self) -> Array:
        """(4 n,) zeros and lengths of the links."""
        return np.concatenate([self.zeros, self.links.ravel()])


# The unknowns: turn and shift of the placement, target, zeros, lengths of the links.
SET_UP = 6
TARGET = 9


def build_nominal_arm(problem: Problem) -> Arm:
    """Build the nominal arm with the set-up of a problem of one target and one placement."""
    n = problem.robot.n
    R, t = problem.placement
    group, target = problem.data.group[0], problem.data.target[0]
    return Arm(R[group], t[group], problem.tools[target], np.zeros(n), np.zeros((n, 3)))


def _compute_jacobian(problem: Problem, arm: Arm, at: Pose) -> Array:
    """Compute (m, 3, 9 + 4 n) changes of the predicted positions per unit of turn and shift (about
    the middle), tool, zeros and links."""
    n, y = problem.robot.n, at.target.T @ arm.R.T
    field = at.displacement()
    motions = [5 if not slides else 2 for slides in problem.robot.prismatic]
    zeros = np.stack([field[j, axis] for j, axis in enumerate(motions)])
    links = at.axes[:n, :3].reshape(3 * n, 3, -1)
    in_base = np.concatenate([at.axes[n, :3], zeros, links])  # (3 + 4 n, 3, m)
    turn = -cross_matrices(y - np.median(y, axis=0))
    shift = np.tile(np.eye(3), (len(y), 1, 1))
    of_arm = np.einsum("ij,kjm->mik", arm.R, in_base)
    return np.concatenate([turn, shift, of_arm], axis=2)


def _take_step(problem: Problem, arm: Arm, step: Array) -> Arm:
    """Take a step (9 + 4 n,) of the unknowns."""
    from scipy.spatial.transform import Rotation

    n = problem.robot.n
    W = Rotation.from_rotvec(step[:3]).as_matrix()
    y = arm.compute_residuals(problem)[0].target.T @ arm.R.T
    middle = np.median(y, axis=0)
    return Arm(
        R=nearest_rotation(W @ arm.R),
        t=arm.t + step[3:SET_UP] + middle - W @ middle,
        tool=arm.tool + step[SET_UP:TARGET],
        zeros=arm.zeros + step[TARGET : TARGET + n],
        links=arm.links + step[TARGET + n :].reshape(n, 3),
    )


class _Objective:
    """The loss of an arm and its set-up, with the prior of all unknowns, for the minimisation.

    `free`: indices of the unknowns that are fitted; `median` [mm]: what is left, which scales the
    loss and the prior."""

    def __init__(self, problem: Problem, free: Index, median: float):
        self.problem, self.free = problem, free
        self.scale = LOSS * median
        n = problem.robot.n
        self.usual = problem.tools[problem.data.target[0]]
        tool_sigma = np.full(3, STATED_MM if self.usual.any() else USUAL_MM)
        zero_sigma = np.where(problem.robot.prismatic, LENGTH_SIGMA_MM, ZERO_SIGMA)
        sigma = np.concatenate([tool_sigma, zero_sigma, np.full(3 * n, LENGTH_SIGMA_MM)])
        self.prior = np.concatenate([np.zeros(SET_UP), (median / MEDIAN_3 / sigma) ** 2])

    def _offset(self, arm: Arm) -> Array:
        """Compute (9 + 4 n,) offsets of the unknowns from where they are expected."""
        return np.concatenate([np.zeros(SET_UP), arm.tool - self.usual, arm.offsets()])

    def cost(self, arm: Arm) -> float:
        """Compute the redescending loss and the prior's squares."""
        square = np.square(arm.compute_residuals(self.problem)[1]).sum(1)
        loss = compute_redescending_loss(square, self.scale)[0]
        return float(loss.sum() + self.prior @ self._offset(arm) ** 2)

    def equations(self, arm: Arm) -> tuple[Array, Array]:
        """Compute the normal equations of a step of the free unknowns."""
        free = self.free
        at, residual = arm.compute_residuals(self.problem)
        J = _compute_jacobian(self.problem, arm, at)[:, :, free]
        weight = compute_redescending_loss(np.square(residual).sum(1), self.scale)[1]
        H = np.einsum("m,mik,mil->kl", weight, J, J, optimize=True) + np.diag(self.prior[free])
        g = np.einsum("m,mik,mi->k", weight, J, residual)
        return H, g - self.prior[free] * self._offset(arm)[free]

    def move(self, arm: Arm, step: Array) -> Arm:
        """Take a step of the free unknowns."""
        whole = np.zeros(TARGET + 4 * self.problem.robot.n)
        whole[self.free] = step
        return _take_step(self.problem, arm, whole)


def fit_offsets(problem: Problem, arm: Arm, free: Sequence[int], set_up: bool) -> Arm:
    """Fit the numbers `free` of the arm (0 … n-1 zeros, n … 4n-1 lengths of links) and, where
    `set_up`, the placement and target, from where they are."""
    of_set_up = range(TARGET) if set_up else ()
    unknowns = np.array([*of_set_up, *(TARGET + k for k in free)], dtype=np.intp)
    before = np.inf
    for _ in range(SCALE_ROUNDS):
        median = max(arm.compute_misfit(problem), MIN_MEDIAN_MM)
        if median > STALLED * before:
            break
        before = median
        objective = _Objective(problem, unknowns, median)
        arm = minimise(arm, objective.cost, objective.equations, objective.move, COARSE)
    return arm


def _place(problem: Problem, arm: Arm) -> Arm:
    """Place an arm by a reweighted rigid fit."""
    x, y = problem.data.position, arm.compute_residuals(problem)[0].target.T
    weight = np.ones(len(y))
    for _ in range(MAX_ROUNDS):
        R, t = fit_rigid_transform(x, y, weight)
        size = np.linalg.norm(x - y @ R.T - t, axis=1)
        scale = max(LOSS * float(np.median(size)), MIN_MEDIAN_MM)
        weight = compute_redescending_weights(size, scale)
    return replace(arm, R=R, t=t)


def _link_numbers(n: int, j: int) -> list[int]:
    """List the indices of the lengths of joint j's link among the numbers of an arm."""
    return [n + 3 * j + axis for axis in range(3)]


def fit_each_zero(problem: Problem, set_up: bool) -> Iterator[tuple[Mistake, Arm]]:
    """Fit every joint's zero, off by any angle, one at a time."""
    for j, slides in enumerate(problem.robot.prismatic):
        arm = fit_offsets(problem, build_nominal_arm(problem), [j], set_up)
        if not slides:
            far = [
                _fit_from(problem, start, j, set_up) for start in _find_peaks(problem, j, set_up)
            ]
            arm = min([arm, *far], key=lambda a: a.compute_misfit(problem))
        yield from _describe(problem, arm)


def _fit_from(problem: Problem, start: Arm, j: int, set_up: bool) -> Arm:
    placed = _place(problem, start) if set_up else start
    return fit_offsets(problem, placed, [j], set_up)


def _find_peaks(problem: Problem, j: int, set_up: bool) -> list[Arm]:
    """Find the arms with a zero of joint j, among angles all around, that promise most."""
    n, nominal = problem.robot.n, build_nominal_arm(problem)
    angles = np.arange(1, 36) * ANGLE_STEP
    arms = [replace(nominal, zeros=angle * np.eye(n)[j]) for angle in angles]
    if set_up:
        mistakes = [Mistake("", "", np.eye(n), arm.zeros, np.eye(3)) for arm in arms]
        misfit = score_linearly(problem, mistakes)[0]
    else:
        misfit = np.array([arm.compute_misfit(problem) for arm in arms])
    return [arms[k] for k in np.argsort(misfit, kind="stable")[:PEAKS]]


def fit_each_link(problem: Problem, set_up: bool) -> Iterator[tuple[Mistake, Arm]]:
    """Fit every link's a b c, off by any length, one link at a time."""
    n, nominal = problem.robot.n, build_nominal_arm(problem)
    for j in range(1 if set_up else 0, n):
        arm = fit_offsets(problem, nominal, _link_numbers(n, j), set_up)
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
    from_zeros = [arm for arm in first if not arm.links.any()]
    best = _fit_best(problem, good, from_zeros, zeros, _fit_resting(problem))
    if best.compute_misfit(problem) > good and links:
        frames = [_link_numbers(n, j) for j in range(1, n)]
        best = _fit_best(problem, good, first, [*zeros, *frames], [])
    if best.compute_misfit(problem) <= good:
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
    starts = sorted(first or [build_nominal_arm(problem)], key=lambda a: a.compute_misfit(problem))
    extended = [_add_offsets(problem, good, arm, groups) for arm in starts[:PEAKS]]
    return min([*extended, *others], key=lambda a: a.compute_misfit(problem))


def _add_offsets(problem: Problem, good: float, arm: Arm, groups: Sequence[list[int]]) -> Arm:
    """Add the group of numbers that leaves least, one after the other, until what is left is good or
    falls no more."""
    offsets = arm.offsets()
    taken = [group for group in groups if offsets[group].any()]
    before, misfit = np.inf, arm.compute_misfit(problem)
    while len(taken) < MAX_PARTS and good < misfit < MIN_FALL * before:
        allows_link = sum(len(group) > 1 for group in taken) < MAX_LINKS
        offered = [g for g in groups if g not in taken and (len(g) == 1 or allows_link)]
        if not offered:
            break
        present = [k for group in taken for k in group]
        fitted = [fit_offsets(problem, arm, [*present, *group], True) for group in offered]
        best = int(np.argmin([a.compute_misfit(problem) for a in fitted]))
        arm = fitted[best]
        taken.append(offered[best])
        before, misfit = misfit, arm.compute_misfit(problem)
    return arm


def _fit_resting(problem: Problem) -> list[Arm]:
    """Fit joints that rest between others that move, from all combinations of angles: readings that
    were not recorded."""
    resting = _find_resting(problem)
    if not 2 <= len(resting) <= MAX_RESTING:
        return []
    n, nominal = problem.robot.n, build_nominal_arm(problem)
    fitted = []
    for angles in product(THIRDS, repeat=len(resting)):
        arm = replace(nominal, zeros=np.eye(n)[resting].T @ np.array(angles))
        fitted.append(fit_offsets(problem, _place(problem, arm), resting, True))
    return fitted


def _find_resting(problem: Problem) -> list[int]:
    """Find the turning joints that rest between the first and the last that moves."""
    moving = np.flatnonzero(np.ptp(problem.data.q, axis=0) >= REST_RANGE).tolist()
    between = range(moving[0], moving[-1]) if moving else range(0)
    return [j for j in between if j not in moving and not problem.robot.prismatic[j]]


def _describe(problem: Problem, arm: Arm) -> Iterator[tuple[Mistake, Arm]]:
    """Pair an arm with its offsets as a mistake; nothing where these are too small to be one."""
    mistake = describe_offsets(problem, arm.zeros, arm.links)
    if mistake is not None:
        yield mistake, arm
