"""Robust adjustment of tracker placements and targets together: exact minimisation from a start.

A Levenberg-Marquardt minimisation with a redescending loss (Geman & McClure 1985) and the prior of
the targets; the last fit is of the rows that are not gross, by least squares."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .._typing import Array, Index, Mask
from ..robot.rigid import from_rotation_vector, nearest_rotation
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
)
from .robust_weights import compute_redescending_loss

# medians beyond which a row is left out of the last fit, and rounds of that fit
GROSS = 6.0
GROSS_ROUNDS = 3
# a round of reweighting ends the search where it reduces the median by less than this
STALLED = 0.99


def cross_matrices(v: Array) -> Array:
    """Build (m, 3, 3) matrices with cross_matrices(v) w = v x w, for v (m, 3)."""
    matrix = np.zeros((len(v), 3, 3))
    matrix[:, 0, 1] = -v[:, 2]
    matrix[:, 0, 2] = v[:, 1]
    matrix[:, 1, 2] = -v[:, 0]
    return matrix - matrix.transpose(0, 2, 1)


def compute_turning_point(sight: Sight, at: Placed, group: int) -> Array:
    """Compute (3,) the middle of a group's points, about which it is turned, from its placement's
    shift, in the tracker's axes [mm]."""
    middle = sight.middles[group]
    shift = at.t[group]
    from_shift = middle - shift
    return np.asarray(from_shift)


def _columns_of(sight: Sight, with_turns: bool, group: int, target: int) -> Index:
    """Index the unknowns that rows of a group and a target depend on."""
    G = sight.groups
    T = len(sight.usual)
    first_target = 6 * G
    first_turn = first_target + 3 * T
    coordinates = 3 * target + np.arange(3)
    of_group = 6 * group + np.arange(6)
    of_target = first_target + coordinates
    columns = [of_group, of_target]
    if with_turns:
        of_turn = first_turn + coordinates
        columns.append(of_turn)
    return np.concatenate(columns)


def normal_equations(sight: Sight, at: Placed, weight: Array) -> tuple[Array, Array]:
    """Compute (H (p, p), g (p,)) of the weighted squares of the residuals.

    The unknowns are small turns and shifts of every group (6 G, about the median of its points),
    shifts of every target (3 T) and, with orientations, turns of it (3 T)."""
    residuals = compute_residuals(sight, at)
    with_turns = at.turned is not None and sight.seen is not None
    per_target = 6 if with_turns else 3
    unknowns = 6 * sight.groups + per_target * len(at.tools)
    H = np.zeros((unknowns, unknowns))
    g = np.zeros(unknowns)
    for group, target, rows in sight.pairs:
        J = _compute_jacobian(sight, at, group, target, rows, with_turns)
        of_rows = np.sqrt(weight[rows])
        root = of_rows[:, None]
        A = J * root[:, :, None]
        A = A.reshape(-1, J.shape[2])
        b = residuals[rows] * root
        own = _columns_of(sight, with_turns, group, target)
        block = np.ix_(own, own)
        H[block] += A.T @ A
        g[own] += A.T @ b.ravel()
    return H, g


def _compute_jacobian(
    sight: Sight, at: Placed, group: int, target: int, rows: Index, with_turns: bool
) -> Array:
    """Compute (k, 3 or 6, 9 or 12) changes of the predictions of rows of one group and target."""
    R = at.R[group]
    RF = R @ sight.F[rows]
    on_flange = RF @ at.tools[target]
    from_origin = sight.o[rows] @ R.T
    arm = on_flange + from_origin
    turning_point = compute_turning_point(sight, at, group)
    lever = arm - turning_point
    residuals = 6 if with_turns else 3
    unknowns = 12 if with_turns else 9
    count = len(rows)
    J = np.zeros((count, residuals, unknowns))
    J[:, :3, :3] = -cross_matrices(lever)
    J[:, :3, 3:6] = np.eye(3)
    J[:, :3, 6:9] = RF
    if with_turns:
        identity = np.eye(3)
        J[:, 3:, :3] = LEVER_MM * identity
        J[:, 3:, 9:] = LEVER_MM * RF
    return J


def _take_step(sight: Sight, at: Placed, step: Array) -> Placed:
    """Take a step (p,) of the unknowns of `normal_equations`."""
    G = sight.groups
    T = len(at.tools)
    first_tool = 6 * G
    first_turn = first_tool + 3 * T
    of_groups = step[:first_tool].reshape(G, 6)
    of_tools = step[first_tool:first_turn]
    of_turns = step[first_turn:].reshape(-1, 3)
    turn = of_groups[:, :3]
    shift = of_groups[:, 3:]
    W = from_rotation_vector(turn)
    turning_points = []
    for g in range(G):
        turning_point = compute_turning_point(sight, at, g)
        turning_points.append(turning_point)
    middle = np.array(turning_points)
    turned_middle = np.einsum("gij,gj->gi", W, middle)
    products = W @ at.R
    R = [nearest_rotation(product) for product in products]
    turned = at.turned
    if turned is not None and len(of_turns):
        turned = from_rotation_vector(of_turns) @ turned
    return replace(
        at,
        R=np.stack(R),
        t=at.t + shift + middle - turned_middle,
        tools=at.tools + of_tools.reshape(T, 3),
        turned=turned,
    )


class _Objective:
    """The loss of placements and targets, for the minimisation.

    `scale` [mm]: of the redescending loss, or None for plain squares with the row weights `weight`
    (m,); `sigma` [mm]: standard deviation of one coordinate, against which the prior of the targets
    is weighed."""

    def __init__(self, sight: Sight, scale: float | None, weight: Array, sigma: float):
        self.sight = sight
        self.scale = scale
        self.weight = weight
        ratio = sigma / sight.prior_sigma
        of_targets = ratio**2
        self.prior = np.repeat(of_targets, 3)

    def cost(self, at: Placed) -> float:
        """Compute the loss and the prior's squares."""
        residuals = compute_residuals(self.sight, at)
        square = np.square(residuals).sum(1)
        if self.scale is None:
            loss = self.weight * square
        else:
            loss, _ = compute_redescending_loss(square, self.scale)
        offset = self._offset(at)
        squared_offset = offset**2
        penalty = self.prior @ squared_offset
        total = loss.sum() + penalty
        return float(total)

    def _offset(self, at: Placed) -> Array:
        """Compute (3 T,) offsets of the targets from where they are expected [mm]."""
        expected = self.sight.usual
        offset = at.tools - expected
        return offset.ravel()

    def equations(self, at: Placed) -> tuple[Array, Array]:
        """Compute the normal equations of a step."""
        sight = self.sight
        weight = self.weight
        if self.scale is not None:
            residuals = compute_residuals(sight, at)
            square = np.square(residuals).sum(1)
            _, weight = compute_redescending_loss(square, self.scale)
        H, g = normal_equations(sight, at, weight)
        count = len(self.prior)
        tools = 6 * sight.groups + np.arange(count)
        H[tools, tools] += self.prior
        offset = self._offset(at)
        g[tools] -= self.prior * offset
        return H, g

    def minimise(self, at: Placed, tolerance: float) -> Placed:
        """Minimise from a start."""

        def move(placed: Placed, step: Array) -> Placed:
            return _take_step(self.sight, placed, step)

        return minimise(at, self.cost, self.equations, move, tolerance)


def refine_robustly(sight: Sight, at: Placed) -> Placed:
    """Minimise the redescending loss from a start, its scale taken anew from the median."""
    before = np.inf
    ones = np.ones(len(sight.x))
    for _ in range(MAX_ROUNDS):
        misfits = compute_misfits(sight, at)
        median = float(compute_trimmed_median(misfits, sight.unknowns))
        if median > STALLED * before:
            break
        before = median
        sigma = median / MEDIAN_3
        objective = _Objective(sight, scale=LOSS * median, weight=ones, sigma=sigma)
        at = objective.minimise(at, COARSE)
    return at


def refine_without_gross_rows(sight: Sight, at: Placed) -> tuple[Placed, Mask]:
    """Fit the rows that are not gross by least squares: (placement, mask of these rows)."""
    good = np.ones(len(sight.x), bool)
    for _ in range(GROSS_ROUNDS):
        misfits = compute_misfits(sight, at)
        median = float(compute_trimmed_median(misfits, sight.unknowns))
        limit = GROSS * median
        good = misfits <= limit
        weight = good.astype(float)
        sigma = median / MEDIAN_3
        objective = _Objective(sight, scale=None, weight=weight, sigma=sigma)
        at = objective.minimise(at, CONVERGED)
    return at, good
