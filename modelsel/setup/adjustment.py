"""Robust adjustment of tracker placements and targets together: exact minimisation from a start.

A Levenberg-Marquardt minimisation with a redescending loss (Geman & McClure 1985) and the prior of
the targets; the last fit is of the rows that are not gross, by least squares. Many starts of the
same groups and targets are minimised together, along a leading axis (`stack_sights`)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .._typing import Array, Index, Mask
from ..robot.rigid import from_rotation_vector, tidy_rotations
from .minimisation import COARSE, CONVERGED, minimise
from .placement import (
    LEVER_MM,
    LOSS,
    MAX_ROUNDS,
    MEDIAN_3,
    Placed,
    Sight,
    compute_misfits,
    compute_residuals,
    compute_trimmed_median,
    put_in_places,
)
from .robust_weights import compute_redescending_loss

# medians beyond which a row is left out of the last fit, and rounds of that fit
GROSS = 6.0
GROSS_ROUNDS = 3
# a round of reweighting ends the search where it reduces the median by less than this
STALLED = 0.99


def cross_matrices(v: Array) -> Array:
    """Build (..., 3, 3) matrices with cross_matrices(v) w = v x w, for v (..., 3)."""
    matrix = np.zeros((*v.shape, 3))
    matrix[..., 0, 1] = -v[..., 2]
    matrix[..., 0, 2] = v[..., 1]
    matrix[..., 1, 2] = -v[..., 0]
    return matrix - np.swapaxes(matrix, -1, -2)


def _columns_of(sight: Sight, with_turns: bool, group: int, target: int) -> Index:
    """Index the unknowns that rows of a group and a target depend on."""
    first_target = 6 * sight.groups
    first_turn = first_target + 3 * sight.targets
    axes = np.arange(3)
    coordinates = 3 * target + axes
    of_group = 6 * group + np.arange(6)
    of_target = first_target + coordinates
    columns = [of_group, of_target]
    if with_turns:
        of_turn = first_turn + coordinates
        columns.append(of_turn)
    return np.concatenate(columns)


def normal_equations(
    sight: Sight, at: Placed, residuals: Array, weight: Array
) -> tuple[Array, Array]:
    """Compute (H (..., p, p), g (..., p)) of the weighted squares of the residuals, for weights
    (..., m).

    The unknowns are small turns and shifts of every group (6 G, about the median of its points),
    shifts of every target (3 T) and, with orientations, turns of it (3 T)."""
    with_turns = at.turned is not None and sight.seen is not None
    per_target = 6 if with_turns else 3
    unknowns = 6 * sight.groups + per_target * sight.targets
    stack = residuals.shape[:-2]
    H = np.zeros((*stack, unknowns, unknowns))
    g = np.zeros((*stack, unknowns))
    for group, target, rows in sight.pairs:
        J = _compute_jacobian(sight, at, residuals, group, rows)
        of_rows = np.sqrt(weight[..., rows])
        root = of_rows[..., None]
        A = J * root[..., None]
        A = A.reshape(*stack, -1, J.shape[-1])
        b = residuals[..., rows, :] * root
        own = _columns_of(sight, with_turns, group, target)
        block = own[:, None]
        across = np.swapaxes(A, -1, -2)
        H[..., block, own] += across @ A
        projected = across @ b.reshape(*stack, -1, 1)
        g[..., own] += projected[..., 0]
    return H, g


def _compute_jacobian(sight: Sight, at: Placed, residuals: Array, group: int, rows: Index) -> Array:
    """Compute (..., k, 3 or 6, 9 or 12) changes of the predictions of rows of one group and
    target."""
    R = at.R[..., group, None, :, :]
    RF = R @ sight.F[..., rows, :, :]
    measured = sight.x[..., rows, :]
    predicted = measured - residuals[..., rows, :3]
    lever = predicted - sight.middles[..., group, None, :]
    of_row = residuals.shape[-1]
    unknowns = 12 if of_row > 3 else 9
    J = np.zeros((*lever.shape[:-1], of_row, unknowns))
    J[..., :3, :3] = -cross_matrices(lever)
    J[..., :3, 3:6] = np.eye(3)
    J[..., :3, 6:9] = RF
    if of_row > 3:
        identity = np.eye(3)
        J[..., 3:, :3] = LEVER_MM * identity
        J[..., 3:, 9:] = LEVER_MM * RF
    return J


def _take_step(sight: Sight, at: Placed, step: Array) -> Placed:
    """Take a step (..., p) of the unknowns of `normal_equations`."""
    G = sight.groups
    first_tool = 6 * G
    first_turn = first_tool + 3 * sight.targets
    stack = step.shape[:-1]
    of_groups = step[..., :first_tool].reshape(*stack, G, 6)
    of_tools = step[..., first_tool:first_turn].reshape(at.tools.shape)
    turn = of_groups[..., :3]
    shift = of_groups[..., 3:]
    W = from_rotation_vector(turn)
    # a group is turned about the middle of its points, here from the placement's shift
    middle = sight.middles - at.t
    turned_middle = np.einsum("...ij,...j->...i", W, middle)
    turned = at.turned
    if turned is not None and step.shape[-1] > first_turn:
        of_turns = step[..., first_turn:].reshape(at.tools.shape)
        turned = from_rotation_vector(of_turns) @ turned
    return Placed(
        R=tidy_rotations(W @ at.R),
        t=at.t + shift + middle - turned_middle,
        tools=at.tools + of_tools,
        turned=turned,
    )


@dataclass(frozen=True, eq=False)
class _Trial:
    """Placements and the residuals (k, m, 3 or 6) that they leave."""

    at: Placed
    residuals: Array

    def take(self, which: Index) -> _Trial:
        """Select some of them."""
        return _Trial(self.at.take(which), self.residuals[which])

    def put(self, which: Index, others: _Trial) -> _Trial:
        """Return these with others in some places."""
        residuals = put_in_places(self.residuals, which, others.residuals)
        return _Trial(self.at.put(which, others.at), residuals)


@dataclass(frozen=True, eq=False)
class _Loss:
    """The loss of placements and targets, for the minimisation.

    `scale` (k,) [mm]: of the redescending loss, or None for plain squares with the row weights
    `weight` (k, m); `sigma` (k,) [mm]: standard deviation of one coordinate, against which the prior
    of the targets is weighed."""

    sight: Sight
    scale: Array | None
    weight: Array
    sigma: Array

    def take(self, which: Index) -> _Loss:
        """Select the loss of some of the placements."""
        sight = self.sight.pick(which)
        scale = None if self.scale is None else self.scale[which]
        weight = self.weight[which]
        sigma = self.sigma[which]
        return _Loss(sight, scale, weight, sigma)

    @cached_property
    def prior(self) -> Array:
        """(k, 3 T) weights of the squared offsets of the targets."""
        ratio = self.sigma[:, None, None] / self.sight.prior_sigma
        of_targets = ratio[:, :, 0] ** 2
        return np.repeat(of_targets, 3, axis=1)

    def cost(self, trial: _Trial) -> Array:
        """Compute the loss and the prior's squares."""
        loss, _ = self._weigh(trial)
        offset = self._offset(trial)
        squared_offset = offset**2
        penalty = self.prior * squared_offset
        of_rows = loss.sum(1)
        of_targets = penalty.sum(1)
        total = of_rows + of_targets
        return np.asarray(total)

    def _weigh(self, trial: _Trial) -> tuple[Array, Array]:
        """Compute the losses and the weights (k, m) of the rows."""
        square = np.square(trial.residuals).sum(2)
        scale = self.scale
        if scale is None:
            weight = self.weight
            return weight * square, weight
        of_rows = scale[:, None]
        return compute_redescending_loss(square, of_rows)

    def _offset(self, trial: _Trial) -> Array:
        """Compute (k, 3 T) offsets of the targets from where they are expected [mm]."""
        offset = trial.at.tools - self.sight.usual
        return offset.reshape(len(offset), -1)

    def equations(self, trial: _Trial) -> tuple[Array, Array]:
        """Compute the normal equations of a step."""
        _, weight = self._weigh(trial)
        H, g = normal_equations(self.sight, trial.at, trial.residuals, weight)
        prior = self.prior
        tools = 6 * self.sight.groups + np.arange(prior.shape[1])
        H[:, tools, tools] += prior
        g[:, tools] -= prior * self._offset(trial)
        return H, g

    def move(self, trial: _Trial, steps: Array) -> _Trial:
        """Take a step of every placement."""
        moved = _take_step(self.sight, trial.at, steps)
        return self.try_out(moved)

    def try_out(self, at: Placed) -> _Trial:
        """Compute what placements leave."""
        residuals = compute_residuals(self.sight, at)
        return _Trial(at, residuals)

    def minimise(self, at: Placed, tolerance: float) -> Placed:
        """Minimise from every start."""
        start = self.try_out(at)
        found = minimise(start, self, tolerance)
        return found.at


def refine_robustly(sight: Sight, at: Placed) -> Placed:
    """Minimise the redescending loss from every start, each with its own of the sights; its scale is
    taken anew from the median."""
    count = len(sight.x)
    which = np.arange(count)
    before = np.full(count, np.inf)
    for _ in range(MAX_ROUNDS):
        of_these = sight.pick(which)
        starts = at.take(which)
        misfits = compute_misfits(of_these, starts)
        median = compute_trimmed_median(misfits, sight.unknowns)
        most = STALLED * before[which]
        goes_on = median <= most
        if not goes_on.any():
            break
        going = np.flatnonzero(goes_on)
        which = which[going]
        median = median[going]
        before[which] = median
        picked = of_these.pick(going)
        ones = np.ones(picked.x.shape[:2])
        scale = LOSS * median
        sigma = median / MEDIAN_3
        loss = _Loss(picked, scale, ones, sigma)
        start = starts.take(going)
        refined = loss.minimise(start, COARSE)
        at = at.put(which, refined)
    return at


def refine_without_gross_rows(sight: Sight, at: Placed) -> tuple[Placed, Mask]:
    """Fit the rows that are not gross by least squares, for every placement of many sights:
    (placements, mask (k, m) of these rows)."""
    good = np.ones(sight.x.shape[:2], bool)
    for _ in range(GROSS_ROUNDS):
        misfits = compute_misfits(sight, at)
        median = compute_trimmed_median(misfits, sight.unknowns)
        limit = GROSS * median
        good = misfits <= limit[:, None]
        weight = good.astype(float)
        sigma = median / MEDIAN_3
        loss = _Loss(sight, scale=None, weight=weight, sigma=sigma)
        at = loss.minimise(at, CONVERGED)
    return at, good
