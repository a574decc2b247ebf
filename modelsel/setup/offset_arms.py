"""Arms that are not nominal, each with its set-up, and the fit of their offsets on the exact chain.

Unknown are the placement, the target and a few numbers of the arm: a reading's zero, or where a
joint sits on the link before it (the a b c of its frame). They are fitted by Levenberg-Marquardt
with a redescending loss."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from .._typing import Array, Index
from ..fitting.problem import Problem
from ..robot.kinematics import Pose, Robot, pose
from ..robot.rigid import from_rotation_vector, nearest_rotation, transform
from .adjustment import cross_matrices
from .minimisation import COARSE, minimise
from .placement import LOSS, MAX_ROUNDS, MEDIAN_3, STATED_MM, USUAL_MM, fit_rigid_transform
from .robust_weights import compute_redescending_loss, compute_redescending_weights

# prior standard deviations of zeros [rad; mm of a slide] and of lengths [mm]
ZERO_SIGMA = 1.0
LENGTH_SIGMA_MM = 200.0
# nearness to a right angle, which has a sentence of its own
NEAR_RIGHT = np.radians(5)
# times that the scale of the loss is taken anew, and share of the median before from which it has
# stalled
SCALE_ROUNDS = 4
STALLED = 0.95
# median below which the scale of the loss does not fall
MIN_MEDIAN_MM = 1e-6
# The unknowns: turn and shift of the placement, target, zeros, lengths of the links.
SET_UP = 6
TARGET = 9


@dataclass(frozen=True, eq=False)
class Arm:
    """A set-up and an arm that is not nominal: R (3, 3), t (3,) mm, tool (3,) mm, zeros (n,) rad or
    mm added to the readings, links (n, 3) mm before every joint."""

    R: Array
    t: Array
    tool: Array
    zeros: Array
    links: Array
    _seen: dict[Problem, tuple[Pose, Array]] = field(init=False, repr=False, default_factory=dict)

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
        """Return (the chain at the rows' readings, (m, 3) measured minus predicted positions): of the same
        problem computed once."""
        if problem not in self._seen:
            self._seen[problem] = self._walk(problem)
        return self._seen[problem]

    def _walk(self, problem: Problem) -> tuple[Pose, Array]:
        arm = self.robot(problem.robot)
        at = pose(arm, problem.data.q + self.zeros, self.tool)
        x = problem.data.position
        base = at.target.T
        predicted = base @ self.R.T
        residual = x - predicted
        residual -= self.t
        return at, residual

    def compute_misfit(self, problem: Problem) -> float:
        """Compute the median distance that is left [mm]."""
        _, residual = self.compute_residuals(problem)
        distance = np.linalg.norm(residual, axis=1)
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
        """Concatenate the zeros and the lengths of the links, (4 n,)."""
        lengths = self.links.ravel()
        return np.concatenate([self.zeros, lengths])


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
    in_base = np.concatenate([at.axes[n, :3], np.stack(zeros), links.reshape(3 * n, 3, -1)])
    middle = np.median(y, axis=0)
    turn = -cross_matrices(y - middle)
    shift = np.tile(np.eye(3), (len(y), 1, 1))
    of_arm = np.einsum("ij,kjm->mik", arm.R, in_base)
    return np.concatenate([turn, shift, of_arm], axis=2)


def _take_step(problem: Problem, arm: Arm, step: Array) -> Arm:
    """Take a step (9 + 4 n,) of the unknowns."""
    n = problem.robot.n
    W = from_rotation_vector(step[:3])
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


@dataclass(frozen=True, eq=False)
class _Arms:
    """Arms that are fitted together."""

    arms: tuple[Arm, ...]

    def take(self, which: Index) -> _Arms:
        """Select some of the arms."""
        return _Arms(tuple(self.arms[k] for k in which))

    def put(self, which: Index, others: _Arms) -> _Arms:
        """Return the arms with others in some places."""
        changed = list(self.arms)
        for k, other in zip(which, others.arms, strict=True):
            changed[k] = other
        return _Arms(tuple(changed))


@dataclass(frozen=True, eq=False)
class _Objective:
    """The losses of arms and their set-ups, with the prior of all unknowns, for the minimisation.

    `free`: indices (k, p) of the unknowns of every arm that are fitted; `median` (k,) [mm]: what it
    leaves, which scales the loss and the prior."""

    problem: Problem
    free: Index
    median: Array

    def take(self, which: Index) -> _Objective:
        """Select the objective of some of the arms."""
        return replace(self, free=self.free[which], median=self.median[which])

    @cached_property
    def usual(self) -> Array:
        """(3,) where the target is expected [mm]."""
        target = self.problem.data.target[0]
        return self.problem.tools[target]

    @cached_property
    def prior(self) -> Array:
        """(k, 9 + 4 n) weights of the squared offsets of the unknowns."""
        n = self.problem.robot.n
        tool_mm = STATED_MM if self.usual.any() else USUAL_MM
        zero_sigma = np.where(self.problem.robot.prismatic, LENGTH_SIGMA_MM, ZERO_SIGMA)
        sigma = np.concatenate([np.full(3, tool_mm), zero_sigma, np.full(3 * n, LENGTH_SIGMA_MM)])
        coordinate = self.median[:, None] / MEDIAN_3
        of_offsets = (coordinate / sigma) ** 2
        of_set_up = np.zeros((len(self.median), SET_UP))
        return np.concatenate([of_set_up, of_offsets], axis=1)

    def _offset(self, arm: Arm) -> Array:
        """Compute (9 + 4 n,) offsets of the unknowns from where they are expected."""
        of_set_up = np.zeros(SET_UP)
        of_tool = arm.tool - self.usual
        return np.concatenate([of_set_up, of_tool, arm.offsets()])

    def _weigh(self, residual: Array, k: int) -> tuple[Array, Array]:
        """Compute the losses and the weights (m,) of the rows of one arm."""
        square = np.square(residual).sum(1)
        return compute_redescending_loss(square, LOSS * self.median[k])

    def cost(self, arms: _Arms) -> Array:
        """Compute the redescending losses and the prior's squares."""
        costs = []
        for k, arm in enumerate(arms.arms):
            _, residual = arm.compute_residuals(self.problem)
            loss, _ = self._weigh(residual, k)
            offset = self._offset(arm)
            penalty = self.prior[k] @ offset**2
            costs.append(loss.sum() + penalty)
        return np.array(costs)

    def equations(self, arms: _Arms) -> tuple[Array, Array]:
        """Compute the normal equations of a step of the free unknowns."""
        each = [self._derive(arm, k) for k, arm in enumerate(arms.arms)]
        H, g = zip(*each, strict=True)
        return np.stack(H), np.stack(g)

    def _derive(self, arm: Arm, k: int) -> tuple[Array, Array]:
        """Compute the normal equations of one arm."""
        free = self.free[k]
        at, residual = arm.compute_residuals(self.problem)
        J = _compute_jacobian(self.problem, arm, at)
        J = J[:, :, free]
        _, weight = self._weigh(residual, k)
        prior = self.prior[k, free]
        offset = self._offset(arm)
        rows = J.reshape(-1, len(free))
        weighted = (J * weight[:, None, None]).reshape(rows.shape)
        H = weighted.T @ rows
        g = weighted.T @ residual.reshape(-1)
        return H + np.diag(prior), g - prior * offset[free]

    def move(self, arms: _Arms, steps: Array) -> _Arms:
        """Take a step of the free unknowns of every arm."""
        moved = []
        for arm, free, step in zip(arms.arms, self.free, steps, strict=True):
            whole = np.zeros(self.prior.shape[1])
            whole[free] = step
            moved.append(_take_step(self.problem, arm, whole))
        return _Arms(tuple(moved))


def fit_offsets(problem: Problem, arm: Arm, free: Sequence[int], set_up: bool) -> Arm:
    """Fit the numbers `free` of the arm (0 … n-1 zeros, n … 4n-1 lengths of links) and, where
    `set_up`, the placement and target, from where they are."""
    unknowns = [TARGET + k for k in free]
    if set_up:
        unknowns = [*range(TARGET), *unknowns]
    indices = np.array([unknowns], dtype=np.intp)
    before = np.inf
    for _ in range(SCALE_ROUNDS):
        misfit = arm.compute_misfit(problem)
        median = max(misfit, MIN_MEDIAN_MM)
        if median > STALLED * before:
            break
        before = median
        objective = _Objective(problem, indices, np.array([median]))
        (arm,) = minimise(_Arms((arm,)), objective, COARSE).arms
    return arm


def place_arm(problem: Problem, arm: Arm) -> Arm:
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
        scale = max(LOSS * median, MIN_MEDIAN_MM)
        weight = compute_redescending_weights(distance, scale)
    return replace(arm, R=R, t=t)
