"""The fit of arms that are not nominal, and of their set-ups, on the exact chain.

Unknown are the placement, the target and a few numbers of the arm (`offset_arms`). They are fitted by
Levenberg-Marquardt with a redescending loss, many arms together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .._typing import Array, Index
from ..fitting.problem import Problem
from ..robot.kinematics import pose
from ..robot.rigid import from_rotation_vector, tidy_rotations
from .adjustment import cross_matrices
from .minimisation import COARSE, minimise
from .offset_arms import Arm
from .placement import (
    LOSS,
    MAX_ROUNDS,
    MEDIAN_3,
    STATED_MM,
    USUAL_MM,
    fit_rigid_transform,
    put_in_places,
)
from .robust_weights import compute_redescending_loss, compute_redescending_weights

# prior standard deviations of zeros [rad; mm of a slide] and of lengths [mm]
ZERO_SIGMA = 1.0
LENGTH_SIGMA_MM = 200.0
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
class _Arms:
    """Arms along a leading axis, as in `Arm`, and their chains at the rows: unit axes (k, n+1, 3, 3,
    m) and origins (k, n+1, 3, m) of the frames, and the target (k, m, 3), all in frame 0."""

    R: Array
    t: Array
    tool: Array
    zeros: Array
    links: Array
    axes: Array
    origins: Array
    target: Array

    def take(self, which: Index) -> _Arms:
        """Select some of the arms."""
        return _Arms(**{name: values[which] for name, values in vars(self).items()})

    def put(self, which: Index, others: _Arms) -> _Arms:
        """Return the arms with others in some places."""
        changed = {}
        new = vars(others)
        for name, values in vars(self).items():
            of_others = new[name]
            changed[name] = put_in_places(values, which, of_others)
        return _Arms(**changed)

    def list_arms(self) -> list[Arm]:
        """List the arms one by one."""
        values = zip(self.R, self.t, self.tool, self.zeros, self.links, strict=True)
        return [Arm(*of_arm) for of_arm in values]

    @property
    def predicted(self) -> Array:
        """(k, m, 3) the target in the tracker's axes, about its origin's place [mm]."""
        rotated = self.target @ np.swapaxes(self.R, 1, 2)
        return np.asarray(rotated)

    def compute_residuals(self, position: Array) -> Array:
        """Compute (k, m, 3) measured (m, 3) minus predicted positions [mm]."""
        residuals = position - self.predicted
        residuals -= self.t[:, None]
        return residuals


def _stack_arms(problem: Problem, arms: Sequence[Arm]) -> _Arms:
    """Stack arms, and walk their chains at the rows of a problem."""
    R = np.stack([arm.R for arm in arms])
    t = np.stack([arm.t for arm in arms])
    tool = np.stack([arm.tool for arm in arms])
    zeros = np.stack([arm.zeros for arm in arms])
    links = np.stack([arm.links for arm in arms])
    return _walk(problem, R, t, tool, zeros, links)


def _walk(problem: Problem, R: Array, t: Array, tool: Array, zeros: Array, links: Array) -> _Arms:
    """Walk the chains of stacked arms: one chain at the rows of all of them, whose links are shifted
    as by an error of every frame."""
    count = len(R)
    m = len(problem)
    n = problem.robot.n
    readings = problem.data.q + zeros[:, None]
    twist = None
    if links.any():
        rows = count * m
        twist = np.zeros((n + 1, 6, rows))
        shifts = np.repeat(links, m, axis=0)
        twist[:n, :3] = shifts.transpose(1, 2, 0)
    q = readings.reshape(-1, n)
    tool_of_row = np.repeat(tool, m, axis=0)
    at = pose(problem.robot, q, tool_of_row, twist)
    frames = n + 1
    nominal_axes = at.axes[:, :3]
    axes = nominal_axes.reshape(frames, 3, 3, count, m)
    origins = at.origins.reshape(frames, 3, count, m)
    return _Arms(
        R,
        t,
        tool,
        zeros,
        links,
        axes=np.moveaxis(axes, 3, 0),
        origins=np.moveaxis(origins, 2, 0),
        target=at.target.T.reshape(count, m, 3),
    )


def _compute_medians(problem: Problem, arms: _Arms) -> Array:
    """Compute the median distance (k,) that every arm leaves [mm]."""
    residuals = arms.compute_residuals(problem.data.position)
    distance = np.linalg.norm(residuals, axis=2)
    median = np.median(distance, axis=1)
    return np.asarray(median)


def measure_arms(problem: Problem, arms: Sequence[Arm]) -> Array:
    """Compute the median distance (k,) that every arm leaves [mm]."""
    stacked = _stack_arms(problem, arms)
    return _compute_medians(problem, stacked)


def _differentiate(problem: Problem, arms: _Arms) -> Array:
    """Compute (k, 3 + 4 n, 3, m) changes of the target in frame 0 per unit of tool, zeros and
    links."""
    n = problem.robot.n
    target = np.swapaxes(arms.target, 1, 2)
    zeros = []
    for j, slides in enumerate(problem.robot.prismatic):
        axis = arms.axes[:, j, 2]
        if not slides:
            lever = target - arms.origins[:, j]
            axis = np.cross(axis, lever, axis=1)
        zeros.append(axis)
    links = arms.axes[:, :n].reshape(len(target), 3 * n, 3, -1)
    return np.concatenate([arms.axes[:, n], np.stack(zeros, 1), links], axis=1)


@dataclass(frozen=True, eq=False)
class _Objective:
    """The losses of arms and their set-ups, with the prior of all unknowns, for the minimisation.

    `free`: indices (k, p) of the unknowns of every arm that are fitted, with `set_up` those of the
    set-up first; `median` (k,) [mm]: what it leaves, which scales the loss and the prior."""

    problem: Problem
    free: Index
    median: Array
    set_up: bool

    def take(self, which: Index) -> _Objective:
        """Select the objective of some of the arms."""
        free = self.free[which]
        median = self.median[which]
        return replace(self, free=free, median=median)

    @cached_property
    def usual(self) -> Array:
        """(3,) where the target is expected [mm]."""
        target = self.problem.data.target[0]
        return np.asarray(self.problem.tools[target])

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

    def _offset(self, arms: _Arms) -> Array:
        """Compute (k, 9 + 4 n) offsets of the unknowns from where they are expected."""
        count = len(arms.R)
        of_set_up = np.zeros((count, SET_UP))
        of_tool = arms.tool - self.usual
        lengths = arms.links.reshape(count, -1)
        return np.concatenate([of_set_up, of_tool, arms.zeros, lengths], axis=1)

    def _weigh(self, residuals: Array) -> tuple[Array, Array]:
        """Compute the losses and the weights (k, m) of the rows."""
        squares = np.square(residuals)
        square = squares.sum(2)
        scale = LOSS * self.median
        of_arms = scale[:, None]
        return compute_redescending_loss(square, of_arms)

    def cost(self, arms: _Arms) -> Array:
        """Compute the redescending losses and the prior's squares."""
        position = self.problem.data.position
        residuals = arms.compute_residuals(position)
        loss, _ = self._weigh(residuals)
        offset = self._offset(arms)
        squared_offset = offset**2
        penalty = self.prior * squared_offset
        of_rows = loss.sum(1)
        of_unknowns = penalty.sum(1)
        total = of_rows + of_unknowns
        return np.asarray(total)

    def equations(self, arms: _Arms) -> tuple[Array, Array]:
        """Compute the normal equations of a step of the free unknowns."""
        position = self.problem.data.position
        residuals = arms.compute_residuals(position)
        _, weight = self._weigh(residuals)
        J = self._compute_jacobian(arms)
        count, _, _, unknowns = J.shape
        weighted = (J * weight[:, :, None, None]).reshape(count, -1, unknowns)
        across = np.swapaxes(weighted, 1, 2)
        H = across @ J.reshape(count, -1, unknowns)
        g = across @ residuals.reshape(count, -1, 1)
        own = np.arange(count)[:, None], self.free
        prior = self.prior[own]
        diagonal = np.arange(unknowns)
        H[:, diagonal, diagonal] += prior
        return H, g[:, :, 0] - prior * self._offset(arms)[own]

    def _compute_jacobian(self, arms: _Arms) -> Array:
        """Compute (k, m, 3, p) changes of the predicted positions per unit of the free unknowns; the
        turn of the placement is about the middle."""
        of_arm = self.free[:, SET_UP:] if self.set_up else self.free
        number = of_arm[:, :, None, None] - SET_UP
        in_base = np.take_along_axis(_differentiate(self.problem, arms), number, axis=1)
        turned = arms.R[:, None] @ in_base
        columns = turned.transpose(0, 3, 2, 1)
        if not self.set_up:
            return columns
        y = arms.predicted
        middle = np.median(y, axis=1, keepdims=True)
        turn = -cross_matrices(y - middle)
        shift = np.broadcast_to(np.eye(3), turn.shape)
        return np.concatenate([turn, shift, columns], axis=3)

    def move(self, arms: _Arms, steps: Array) -> _Arms:
        """Take a step of the free unknowns of every arm."""
        n = self.problem.robot.n
        whole = np.zeros_like(self.prior)
        np.put_along_axis(whole, self.free, steps, axis=1)
        W = from_rotation_vector(whole[:, :3])
        shift = whole[:, 3:SET_UP]
        zeros = whole[:, TARGET : TARGET + n]
        lengths = whole[:, TARGET + n :]
        middle = np.median(arms.predicted, axis=1)
        turned_middle = np.einsum("kij,kj->ki", W, middle)
        return _walk(
            self.problem,
            R=tidy_rotations(W @ arms.R),
            t=arms.t + shift + middle - turned_middle,
            tool=arms.tool + whole[:, SET_UP:TARGET],
            zeros=arms.zeros + zeros,
            links=arms.links + lengths.reshape(arms.links.shape),
        )


def fit_offsets(
    problem: Problem, arms: Sequence[Arm], free: Sequence[Sequence[int]], set_up: bool
) -> list[Arm]:
    """Fit for every arm its numbers `free` (0 … n-1 zeros, n … 4n-1 lengths of links) and, where
    `set_up`, the placement and target, from where they are."""
    fitted = list(arms)
    for count in {len(numbers) for numbers in free}:
        which = [k for k, numbers in enumerate(free) if len(numbers) == count]
        unknowns = TARGET + np.array([free[k] for k in which])
        if set_up:
            own = np.tile(np.arange(TARGET), (len(which), 1))
            unknowns = np.concatenate([own, unknowns], axis=1)
        stacked = _stack_arms(problem, [arms[k] for k in which])
        found = _fit_stacked(problem, stacked, unknowns, set_up)
        for k, arm in zip(which, found.list_arms(), strict=True):
            fitted[k] = arm
    return fitted


def _fit_stacked(problem: Problem, arms: _Arms, free: Index, set_up: bool) -> _Arms:
    """Minimise the redescending loss of every arm, its scale taken anew from the median."""
    before = np.full(len(free), np.inf)
    for _ in range(SCALE_ROUNDS):
        median = np.maximum(_compute_medians(problem, arms), MIN_MEDIAN_MM)
        which = np.flatnonzero(median <= STALLED * before)
        if not len(which):
            break
        before = np.where(median <= STALLED * before, median, -np.inf)
        objective = _Objective(problem, free[which], median[which], set_up)
        arms = arms.put(which, minimise(arms.take(which), objective, COARSE))
    return arms


def place_arms(problem: Problem, arms: Sequence[Arm]) -> list[Arm]:
    """Place every arm by a reweighted rigid fit."""
    if not arms:
        return []
    x = problem.data.position
    y = _stack_arms(problem, arms).target
    measured = np.broadcast_to(x, y.shape)
    weight = np.ones(y.shape[:2])
    for _ in range(MAX_ROUNDS):
        R, t = fit_rigid_transform(measured, y, weight)
        rest = x - y @ np.swapaxes(R, 1, 2) - t[:, None]
        distance = np.linalg.norm(rest, axis=2)
        median = np.median(distance, axis=1)
        scale = np.maximum(LOSS * median, MIN_MEDIAN_MM)
        weight = compute_redescending_weights(distance, scale[:, None])
    return [replace(arm, R=R[k], t=t[k]) for k, arm in enumerate(arms)]
