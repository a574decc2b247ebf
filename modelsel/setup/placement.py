"""Robust rigid adjustment of tracker placements and targets: rigid fits, exact minimisation, and the
uncertainty of what it finds.

Model of a row: x = R_g (o + F c_k) + t_g, with o, F the flange's nominal position and rotation, and
c_k the target's offset on it. For known targets a placement is a rigid fit (Kabsch 1976); both
together are minimised by Levenberg-Marquardt with a redescending loss (Geman & McClure 1985). A
target is expected within STATED_MM of where the study has it, else within USUAL_MM of the flange: a
weak prior, which matters only where the rows do not determine the target."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from .._linalg import TINY
from .._typing import Array, Index, Mask
from ..robot.rigid import nearest_rotation, rotation_vector
from .minimisation import COARSE, CONVERGED, minimise
from .robust_weights import compute_redescending_loss, compute_redescending_weights

# prior standard deviation of a target's coordinates: about the flange where the study states none,
# and about those that it states
USUAL_MM = 500.0
STATED_MM = 50.0
# medians beyond which a row counts less and less, and beyond which it is left out of the last fit
LOSS = 3.0
GROSS = 6.0
# displacement that a radian of orientation counts for
LEVER_MM = 1.0
# smallest median that is believed
MIN_MEDIAN_MM = 1e-6
# median length of a vector of three standard normal coordinates
MEDIAN_3 = 1.538
# rounds of reweighting; a round ends the search where it reduces the median by less than this
MAX_ROUNDS = 6
STALLED = 0.99
GROSS_ROUNDS = 3
# subsets of four rows from which rigid fits start
SUBSETS = 48
# error of an arm as a share of how far it moves, and of how many rows it is shared
USUAL_ERROR = 2e-3
INDEPENDENT_ROWS = 6
# share of how far the arm moves above which the misfit says nothing of the uncertainty
MAX_MISFIT = 0.01
# least eigenvalue of scaled normal equations: directions that nothing determines stay finite
NULL_EIGENVALUE = 1e-14


@dataclass(frozen=True, eq=False)
class Sight:
    """Rows to place: measured positions x (m, 3) [mm] and, where measured, orientations `seen`
    (m, 3, 3); the flange's nominal position o (m, 3) and rotation F (m, 3, 3) in frame 0; group and
    target (m,); `usual` (T, 3) where targets are expected."""

    x: Array
    o: Array
    F: Array
    group: Index
    target: Index
    groups: int
    usual: Array
    seen: Array | None = None

    @property
    def unknowns(self) -> int:
        """Number of unknowns of the placements and targets."""
        return 6 * self.groups + int(self.usual.size)

    @property
    def prior_sigma(self) -> Array:
        """(T, 1) prior standard deviation of every target's coordinates [mm]."""
        is_stated = self.usual.any(axis=1, keepdims=True)
        return np.asarray(np.where(is_stated, STATED_MM, USUAL_MM))

    def take(self, rows: Index) -> Sight:
        """Select some of the rows."""
        return replace(
            self,
            x=self.x[rows],
            o=self.o[rows],
            F=self.F[rows],
            group=self.group[rows],
            target=self.target[rows],
            seen=None if self.seen is None else self.seen[rows],
        )

    def pairs(self) -> Iterator[tuple[int, int, Index]]:
        """Generate (group, target, rows) of every pair that occurs."""
        targets = len(self.usual)
        key = self.group * targets + self.target
        for k in np.unique(key):
            yield int(k) // targets, int(k) % targets, np.flatnonzero(key == k)

    def points(self, tools: Array) -> Array:
        """Compute (m, 3) nominal positions of the targets in frame 0 for offsets (T, 3) [mm]."""
        offset = tools[self.target]
        rotated = np.einsum("mij,mj->mi", self.F, offset)
        return np.asarray(self.o + rotated)

    def middle(self, group: int) -> Array:
        """Compute (3,) the median of a group's measured points [mm]."""
        points = self.x[self.group == group]
        return np.asarray(np.median(points, axis=0))


@dataclass(frozen=True, eq=False)
class Placed:
    """Placements R (G, 3, 3) and t (G, 3) [mm] of frame 0 in the tracker's frame, and targets
    `tools` (T, 3) [mm]; with orientations, the target frames' rotations on the flange `turned`
    (T, 3, 3)."""

    R: Array
    t: Array
    tools: Array
    turned: Array | None = None


def compute_residuals(sight: Sight, at: Placed) -> Array:
    """Compute (m, 3) measured minus predicted positions [mm]; with orientations (m, 6), rotation
    vectors times LEVER_MM."""
    R, t = at.R[sight.group], at.t[sight.group]
    predicted = np.einsum("mij,mj->mi", R, sight.points(at.tools))
    position: Array = sight.x - predicted - t
    if sight.seen is None or at.turned is None:
        return position
    turned = R @ sight.F @ at.turned[sight.target]
    rotation = rotation_vector(np.einsum("mij,mkj->mik", sight.seen, turned))
    return np.concatenate([position, LEVER_MM * rotation], axis=1)


def compute_misfits(sight: Sight, at: Placed) -> Array:
    """Compute (m,) lengths of the residuals."""
    return np.asarray(np.linalg.norm(compute_residuals(sight, at), axis=1))


def compute_trimmed_median(size: Array, unknowns: int) -> Array:
    """Compute (...) the length of (..., m) that more than half are below, beyond the rows that
    `unknowns` can fit exactly (Rousseeuw 1984); at least MIN_MEDIAN_MM."""
    m = size.shape[-1]
    k = min((3 * m + unknowns + 1) // 6, m - 1)
    return np.asarray(np.maximum(np.partition(size, k, axis=-1)[..., k], MIN_MEDIAN_MM))


def fit_rigid_transform(x: Array, y: Array, weight: Array) -> tuple[Array, Array]:
    """Fit rigid transforms x ≈ R y + t to points (..., k, 3) with weights (..., k): R (..., 3, 3),
    t (..., 3).

    Kabsch 1976, for many point sets at once (scipy's `Rotation.align_vectors` takes one, and no
    translation)."""
    w = weight / np.maximum(weight.sum(-1, keepdims=True), TINY)
    x_mean, y_mean = (np.einsum("...k,...ki->...i", w, points) for points in (x, y))
    x_centred, y_centred = x - x_mean[..., None, :], y - y_mean[..., None, :]
    covariance = np.einsum("...k,...ki,...kj->...ij", w, x_centred, y_centred)
    U, _, Vt = np.linalg.svd(covariance)
    reflection = np.ones(U.shape[:-1])
    reflection[..., 2] = np.sign(np.linalg.det(U @ Vt))
    R = (U * reflection[..., None, :]) @ Vt
    return R, x_mean - np.einsum("...ij,...j->...i", R, y_mean)


def fit_placements(sight: Sight, tools: Array) -> Placed:
    """Fit the placements for known targets (T, 3): the best of rigid fits to all rows and to fours
    of them by the median, then reweighted."""
    y = sight.points(tools)
    R, t = np.tile(np.eye(3), (sight.groups, 1, 1)), np.zeros((sight.groups, 3))
    for g in np.unique(sight.group):
        rows = np.flatnonzero(sight.group == g)
        R[g], t[g] = _fit_robustly(sight.x[rows], y[rows])
    return Placed(R, t, tools)


def _fit_robustly(x: Array, y: Array) -> tuple[Array, Array]:
    """Fit one rigid transform to points (k, 3) of which up to half may be gross."""
    m = len(x)
    irrationals = np.sqrt([5.0, 2.0, 3.0, 7.0])
    fours = (np.outer(np.arange(SUBSETS) + 0.5, irrationals) % 1.0 * m).astype(int)
    of_all = fit_rigid_transform(x[None], y[None], np.ones((1, m)))
    of_fours = fit_rigid_transform(x[fours], y[fours], np.ones(fours.shape))
    Rs, ts = (np.concatenate(parts) for parts in zip(of_all, of_fours, strict=True))
    size = np.linalg.norm(x - y @ Rs.transpose(0, 2, 1) - ts[:, None], axis=2)
    best = int(compute_trimmed_median(size, 6).argmin())
    R, t, near = Rs[best], ts[best], size[best]
    for _ in range(MAX_ROUNDS):
        scale = LOSS * compute_trimmed_median(near, 6)
        R, t = fit_rigid_transform(x, y, compute_redescending_weights(near, scale))
        near = np.linalg.norm(x - y @ R.T - t, axis=1)
    return R, t


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
    return np.asarray(sight.middle(group) - at.t[group])


def _columns_of(sight: Sight, with_turns: bool, group: int, target: int) -> Index:
    """Index the unknowns that rows of a group and a target depend on."""
    G, T = sight.groups, len(sight.usual)
    parts = [6 * group + np.arange(6), 6 * G + 3 * target + np.arange(3)]
    if with_turns:
        parts.append(6 * G + 3 * T + 3 * target + np.arange(3))
    return np.concatenate(parts)


def normal_equations(sight: Sight, at: Placed, weight: Array) -> tuple[Array, Array]:
    """Compute (H (p, p), g (p,)) of the weighted squares of the residuals.

    The unknowns are small turns and shifts of every group (6 G, about the median of its points),
    shifts of every target (3 T) and, with orientations, turns of it (3 T)."""
    rest = compute_residuals(sight, at)
    with_turns = at.turned is not None and sight.seen is not None
    unknowns = 6 * sight.groups + (6 if with_turns else 3) * len(at.tools)
    H, g = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
    for group, target, rows in sight.pairs():
        J = _compute_jacobian(sight, at, group, target, rows, with_turns)
        root = np.sqrt(weight[rows])[:, None]
        A = (J * root[:, :, None]).reshape(-1, J.shape[2])
        b = (rest[rows] * root).ravel()
        own = _columns_of(sight, with_turns, group, target)
        H[np.ix_(own, own)] += A.T @ A
        g[own] += A.T @ b
    return H, g


def _compute_jacobian(
    sight: Sight, at: Placed, group: int, target: int, rows: Index, with_turns: bool
) -> Array:
    """Compute (k, 3 or 6, 9 or 12) changes of the predictions of rows of one group and target."""
    RF = at.R[group] @ sight.F[rows]
    arm = RF @ at.tools[target] + sight.o[rows] @ at.R[group].T
    J = np.zeros((len(rows), 6 if with_turns else 3, 12 if with_turns else 9))
    J[:, :3, :3] = -cross_matrices(arm - compute_turning_point(sight, at, group))
    J[:, :3, 3:6] = np.eye(3)
    J[:, :3, 6:9] = RF
    if with_turns:
        J[:, 3:, :3] = LEVER_MM * np.eye(3)
        J[:, 3:, 9:] = LEVER_MM * RF
    return J


def _take_step(sight: Sight, at: Placed, step: Array) -> Placed:
    """Take a step (p,) of the unknowns of `normal_equations`."""
    from scipy.spatial.transform import Rotation

    G, T = sight.groups, len(at.tools)
    of_groups = step[: 6 * G].reshape(G, 6)
    of_tools = step[6 * G : 6 * G + 3 * T].reshape(T, 3)
    of_turns = step[6 * G + 3 * T :].reshape(-1, 3)
    W = Rotation.from_rotvec(of_groups[:, :3]).as_matrix()
    middle = np.array([compute_turning_point(sight, at, g) for g in range(G)])
    t = at.t + of_groups[:, 3:] + middle - np.einsum("gij,gj->gi", W, middle)
    R = np.stack([nearest_rotation(turned) for turned in W @ at.R])
    turned = at.turned
    if turned is not None and len(of_turns):
        turned = Rotation.from_rotvec(of_turns).as_matrix() @ turned
    return replace(at, R=R, t=t, tools=at.tools + of_tools, turned=turned)


class _Objective:
    """The loss of placements and targets, for the minimisation.

    `scale` [mm]: of the redescending loss, or None for plain squares with the row weights `weight`
    (m,); `sigma` [mm]: standard deviation of one coordinate, against which the prior of the targets
    is weighed."""

    def __init__(self, sight: Sight, scale: float | None, weight: Array, sigma: float):
        self.sight, self.scale, self.weight = sight, scale, weight
        self.prior = np.repeat((sigma / sight.prior_sigma) ** 2, 3)

    def cost(self, at: Placed) -> float:
        """Compute the loss and the prior's squares."""
        square = np.square(compute_residuals(self.sight, at)).sum(1)
        loss = self.weight * square
        if self.scale is not None:
            loss = compute_redescending_loss(square, self.scale)[0]
        return float(loss.sum() + self.prior @ self._offset(at) ** 2)

    def _offset(self, at: Placed) -> Array:
        """Compute (3 T,) offsets of the targets from where they are expected [mm]."""
        return (at.tools - self.sight.usual).ravel()

    def equations(self, at: Placed) -> tuple[Array, Array]:
        """Compute the normal equations of a step."""
        weight = self.weight
        if self.scale is not None:
            square = np.square(compute_residuals(self.sight, at)).sum(1)
            weight = compute_redescending_loss(square, self.scale)[1]
        H, g = normal_equations(self.sight, at, weight)
        tools = 6 * self.sight.groups + np.arange(len(self.prior))
        H[tools, tools] += self.prior
        g[tools] -= self.prior * self._offset(at)
        return H, g

    def minimise(self, at: Placed, tolerance: float) -> Placed:
        """Minimise from a start."""

        def move(placed: Placed, step: Array) -> Placed:
            return _take_step(self.sight, placed, step)

        return minimise(at, self.cost, self.equations, move, tolerance)


def refine_robustly(sight: Sight, at: Placed) -> Placed:
    """Minimise the redescending loss from a start, its scale taken anew from the median."""
    before, ones = np.inf, np.ones(len(sight.x))
    for _ in range(MAX_ROUNDS):
        median = float(compute_trimmed_median(compute_misfits(sight, at), sight.unknowns))
        if median > STALLED * before:
            break
        before = median
        objective = _Objective(sight, LOSS * median, ones, median / MEDIAN_3)
        at = objective.minimise(at, COARSE)
    return at


def refine_without_gross_rows(sight: Sight, at: Placed) -> tuple[Placed, Mask]:
    """Fit the rows that are not gross by least squares: (placement, mask of these rows)."""
    good = np.ones(len(sight.x), bool)
    for _ in range(GROSS_ROUNDS):
        size = compute_misfits(sight, at)
        median = float(compute_trimmed_median(size, sight.unknowns))
        good = size <= GROSS * median
        objective = _Objective(sight, None, good.astype(float), median / MEDIAN_3)
        at = objective.minimise(at, CONVERGED)
    return at, good


def compute_uncertainty(sight: Sight, at: Placed, good: Mask) -> tuple[Array, Array]:
    """Compute the standard deviations that the good rows (mask) leave, with targets expected as
    usual: ((G,) of the least certain turn of each placement [rad], (T,) of the least certain
    direction of each target [mm])."""
    sigma = _estimate_sigma(sight, at, good)
    H = normal_equations(sight, at, good.astype(float))[0] / sigma**2
    G, T = sight.groups, len(at.tools)
    tools = 6 * G + np.arange(3 * T)
    H[tools, tools] += np.repeat(1 / sight.prior_sigma**2, 3)
    covariance = _invert(H)
    turns = [_compute_largest_sigma(covariance, 6 * g) for g in range(G)]
    places = [_compute_largest_sigma(covariance, 6 * G + 3 * k) for k in range(T)]
    return np.array(turns), np.array(places)


def _estimate_sigma(sight: Sight, at: Placed, good: Mask) -> float:
    """Estimate the standard deviation of a coordinate [mm] for the uncertainty.

    The arm's own errors, USUAL_ERROR of how far it moves, are shared by rows: they count as if only
    INDEPENDENT_ROWS were measured. A misfit beyond MAX_MISFIT means that the robot is wrong."""
    moves = max(_compute_rms_distance(points[good]) for points in (sight.x, sight.o))
    square = float(np.square(compute_residuals(sight, at)[good]).mean())
    square = min(square, (MAX_MISFIT * moves) ** 2)
    shared = (USUAL_ERROR * moves) ** 2 * max(good.sum() / INDEPENDENT_ROWS, 1.0)
    return max(float(np.sqrt(square + shared)), MIN_MEDIAN_MM)


def _compute_rms_distance(points: Array) -> float:
    """Compute the root mean square distance of points (k, 3) from their median."""
    offset = points - np.median(points, axis=0)
    square = np.square(offset).sum(1)
    return float(np.sqrt(square.mean()))


def _invert(H: Array) -> Array:
    """Invert normal equations (p, p) after scaling; undetermined directions get a large variance."""
    size = np.sqrt(np.maximum(np.diag(H), TINY))
    value, vector = np.linalg.eigh(H / np.outer(size, size))
    root = vector / np.sqrt(np.maximum(value, NULL_EIGENVALUE)) / size[:, None]
    return np.asarray(root @ root.T)


def _compute_largest_sigma(covariance: Array, start: int) -> float:
    """Compute the largest standard deviation in the 3 x 3 block from `start` on."""
    block = covariance[start : start + 3, start : start + 3]
    return float(np.sqrt(max(np.linalg.eigvalsh(block)[-1], 0.0)))
