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
        of_placements = 6 * self.groups
        of_targets = int(self.usual.size)
        return of_placements + of_targets

    @property
    def prior_sigma(self) -> Array:
        """(T, 1) prior standard deviation of every target's coordinates [mm]."""
        is_stated = self.usual.any(
            axis=1,
            keepdims=True,
        )
        sigma = np.where(
            is_stated,
            STATED_MM,
            USUAL_MM,
        )
        return np.asarray(sigma)

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
        key = self.group * targets
        key = key + self.target
        for k in np.unique(key):
            number = int(k)
            is_pair = key == k
            group = number // targets
            target = number % targets
            rows = np.flatnonzero(is_pair)
            yield group, target, rows

    def points(self, tools: Array) -> Array:
        """Compute (m, 3) nominal positions of the targets in frame 0 for offsets (T, 3) [mm]."""
        offset = tools[self.target]
        rotated = np.einsum(
            "mij,mj->mi",
            self.F,
            offset,
        )
        points = self.o + rotated
        return np.asarray(points)

    def middle(self, group: int) -> Array:
        """Compute (3,) the median of a group's measured points [mm]."""
        in_group = self.group == group
        points = self.x[in_group]
        median = np.median(
            points,
            axis=0,
        )
        return np.asarray(median)


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
    group = sight.group
    R = at.R[group]
    t = at.t[group]
    predicted = np.einsum(
        "mij,mj->mi",
        R,
        sight.points(at.tools),
    )
    position: Array = sight.x - predicted - t
    if sight.seen is None or at.turned is None:
        return position
    of_target = at.turned[sight.target]
    turned = R @ sight.F @ of_target
    deviation = np.einsum(
        "mij,mkj->mik",
        sight.seen,
        turned,
    )
    rotation = rotation_vector(deviation)
    return np.concatenate(
        [position, LEVER_MM * rotation],
        axis=1,
    )


def compute_misfits(sight: Sight, at: Placed) -> Array:
    """Compute (m,) lengths of the residuals."""
    residuals = compute_residuals(sight, at)
    lengths = np.linalg.norm(
        residuals,
        axis=1,
    )
    return np.asarray(lengths)


def compute_trimmed_median(size: Array, unknowns: int) -> Array:
    """Compute (...) the length of (..., m) that more than half are below, beyond the rows that
    `unknowns` can fit exactly (Rousseeuw 1984); at least MIN_MEDIAN_MM."""
    m = size.shape[-1]
    beyond_exact = (3 * m + unknowns + 1) // 6
    k = min(beyond_exact, m - 1)
    sorted_up_to_k = np.partition(
        size,
        k,
        axis=-1,
    )
    median = np.maximum(
        sorted_up_to_k[..., k],
        MIN_MEDIAN_MM,
    )
    return np.asarray(median)


def fit_rigid_transform(x: Array, y: Array, weight: Array) -> tuple[Array, Array]:
    """Fit rigid transforms x ≈ R y + t to points (..., k, 3) with weights (..., k): R (..., 3, 3),
    t (..., 3).

    Kabsch 1976, for many point sets at once (scipy's `Rotation.align_vectors` takes one, and no
    translation)."""
    total = weight.sum(-1, keepdims=True)
    w = weight / np.maximum(total, TINY)
    x_mean = np.einsum("...k,...ki->...i", w, x)
    y_mean = np.einsum("...k,...ki->...i", w, y)
    x_centred = x - x_mean[..., None, :]
    y_centred = y - y_mean[..., None, :]
    covariance = np.einsum(
        "...k,...ki,...kj->...ij",
        w,
        x_centred,
        y_centred,
    )
    U, _, Vt = np.linalg.svd(covariance)
    handedness = np.linalg.det(U @ Vt)
    reflection = np.ones(U.shape[:-1])
    reflection[..., 2] = np.sign(handedness)
    reflected = U * reflection[..., None, :]
    R = reflected @ Vt
    rotated_mean = np.einsum(
        "...ij,...j->...i",
        R,
        y_mean,
    )
    return R, x_mean - rotated_mean


def fit_placements(sight: Sight, tools: Array) -> Placed:
    """Fit the placements for known targets (T, 3): the best of rigid fits to all rows and to fours
    of them by the median, then reweighted."""
    y = sight.points(tools)
    groups = sight.groups
    identity = np.eye(3)
    R = np.tile(identity, (groups, 1, 1))
    t = np.zeros((groups, 3))
    for g in np.unique(sight.group):
        in_group = sight.group == g
        rows = np.flatnonzero(in_group)
        R[g], t[g] = _fit_robustly(
            sight.x[rows],
            y[rows],
        )
    return Placed(R, t, tools)


def _fit_robustly(x: Array, y: Array) -> tuple[Array, Array]:
    """Fit one rigid transform to points (k, 3) of which up to half may be gross."""
    m = len(x)
    irrationals = np.sqrt([5.0, 2.0, 3.0, 7.0])
    subsets = np.arange(SUBSETS) + 0.5
    shares = np.outer(subsets, irrationals) % 1.0
    fours = (shares * m).astype(int)
    R_all, t_all = fit_rigid_transform(
        x[None],
        y[None],
        np.ones((1, m)),
    )
    R_fours, t_fours = fit_rigid_transform(
        x[fours],
        y[fours],
        np.ones(fours.shape),
    )
    Rs = np.concatenate([R_all, R_fours])
    ts = np.concatenate([t_all, t_fours])
    rotated = y @ Rs.transpose(0, 2, 1)
    distances = np.linalg.norm(
        x - rotated - ts[:, None],
        axis=2,
    )
    medians = compute_trimmed_median(distances, 6)
    best = int(medians.argmin())
    R = Rs[best]
    t = ts[best]
    near = distances[best]
    for _ in range(MAX_ROUNDS):
        median = compute_trimmed_median(near, 6)
        weight = compute_redescending_weights(
            near,
            LOSS * median,
        )
        R, t = fit_rigid_transform(x, y, weight)
        near = np.linalg.norm(
            x - y @ R.T - t,
            axis=1,
        )
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
    middle = sight.middle(group)
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
    for group, target, rows in sight.pairs():
        J = _compute_jacobian(
            sight,
            at,
            group,
            target,
            rows,
            with_turns,
        )
        of_rows = np.sqrt(weight[rows])
        root = of_rows[:, None]
        A = J * root[:, :, None]
        A = A.reshape(-1, J.shape[2])
        b = residuals[rows] * root
        own = _columns_of(
            sight,
            with_turns,
            group,
            target,
        )
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
    turning_point = compute_turning_point(
        sight,
        at,
        group,
    )
    residuals = 6 if with_turns else 3
    unknowns = 12 if with_turns else 9
    J = np.zeros((len(rows), residuals, unknowns))
    J[:, :3, :3] = -cross_matrices(arm - turning_point)
    J[:, :3, 3:6] = np.eye(3)
    J[:, :3, 6:9] = RF
    if with_turns:
        J[:, 3:, :3] = LEVER_MM * np.eye(3)
        J[:, 3:, 9:] = LEVER_MM * RF
    return J


def _take_step(sight: Sight, at: Placed, step: Array) -> Placed:
    """Take a step (p,) of the unknowns of `normal_equations`."""
    from scipy.spatial.transform import Rotation

    G = sight.groups
    T = len(at.tools)
    first_turn = 6 * G + 3 * T
    of_groups = step[: 6 * G].reshape(G, 6)
    of_tools = step[6 * G : first_turn]
    of_turns = step[first_turn:].reshape(-1, 3)
    turn = of_groups[:, :3]
    shift = of_groups[:, 3:]
    W = Rotation.from_rotvec(turn).as_matrix()
    turning_points = []
    for g in range(G):
        turning_point = compute_turning_point(
            sight,
            at,
            g,
        )
        turning_points.append(turning_point)
    middle = np.array(turning_points)
    turned_middle = np.einsum(
        "gij,gj->gi",
        W,
        middle,
    )
    R = [nearest_rotation(product) for product in W @ at.R]
    turned = at.turned
    if turned is not None and len(of_turns):
        target_turn = Rotation.from_rotvec(of_turns)
        turned = target_turn.as_matrix() @ turned
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
            loss, _ = compute_redescending_loss(
                square,
                self.scale,
            )
        offset = self._offset(at)
        penalty = self.prior @ offset**2
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
            _, weight = compute_redescending_loss(
                square,
                self.scale,
            )
        H, g = normal_equations(
            sight,
            at,
            weight,
        )
        count = len(self.prior)
        tools = 6 * sight.groups + np.arange(count)
        H[tools, tools] += self.prior
        offset = self._offset(at)
        g[tools] -= self.prior * offset
        return H, g

    def minimise(self, at: Placed, tolerance: float) -> Placed:
        """Minimise from a start."""

        def move(placed: Placed, step: Array) -> Placed:
            return _take_step(
                self.sight,
                placed,
                step,
            )

        return minimise(
            at,
            self.cost,
            self.equations,
            move,
            tolerance,
        )


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
        objective = _Objective(
            sight,
            scale=LOSS * median,
            weight=ones,
            sigma=median / MEDIAN_3,
        )
        at = objective.minimise(at, COARSE)
    return at


def refine_without_gross_rows(sight: Sight, at: Placed) -> tuple[Placed, Mask]:
    """Fit the rows that are not gross by least squares: (placement, mask of these rows)."""
    good = np.ones(len(sight.x), bool)
    for _ in range(GROSS_ROUNDS):
        misfits = compute_misfits(sight, at)
        median = float(compute_trimmed_median(misfits, sight.unknowns))
        good = misfits <= GROSS * median
        objective = _Objective(
            sight,
            scale=None,
            weight=good.astype(float),
            sigma=median / MEDIAN_3,
        )
        at = objective.minimise(at, CONVERGED)
    return at, good


def compute_uncertainty(sight: Sight, at: Placed, good: Mask) -> tuple[Array, Array]:
    """Compute the standard deviations that the good rows (mask) leave, with targets expected as
    usual: ((G,) of the least certain turn of each placement [rad], (T,) of the least certain
    direction of each target [mm])."""
    sigma = _estimate_sigma(
        sight,
        at,
        good,
    )
    weight = good.astype(float)
    H, _ = normal_equations(
        sight,
        at,
        weight,
    )
    H = H / sigma**2
    G = sight.groups
    T = len(at.tools)
    first_target = 6 * G
    tools = first_target + np.arange(3 * T)
    prior = 1 / sight.prior_sigma**2
    H[tools, tools] += np.repeat(prior, 3)
    covariance = _invert(H)
    turns = []
    for g in range(G):
        turn = _compute_largest_sigma(covariance, 6 * g)
        turns.append(turn)
    places = []
    for k in range(T):
        start = first_target + 3 * k
        place = _compute_largest_sigma(covariance, start)
        places.append(place)
    return np.array(turns), np.array(places)


def _estimate_sigma(sight: Sight, at: Placed, good: Mask) -> float:
    """Estimate the standard deviation of a coordinate [mm] for the uncertainty.

    The arm's own errors, USUAL_ERROR of how far it moves, are shared by rows: they count as if only
    INDEPENDENT_ROWS were measured. A misfit beyond MAX_MISFIT means that the robot is wrong."""
    measured = _compute_rms_distance(sight.x[good])
    nominal = _compute_rms_distance(sight.o[good])
    moves = max(measured, nominal)
    residuals = compute_residuals(sight, at)
    squares = np.square(residuals[good])
    square = float(squares.mean())
    largest = MAX_MISFIT * moves
    square = min(
        square,
        largest**2,
    )
    usual = USUAL_ERROR * moves
    rows = good.sum()
    rows_per_error = max(
        rows / INDEPENDENT_ROWS,
        1.0,
    )
    shared = usual**2 * rows_per_error
    sigma = float(np.sqrt(square + shared))
    return max(sigma, MIN_MEDIAN_MM)


def _compute_rms_distance(points: Array) -> float:
    """Compute the root mean square distance of points (k, 3) from their median."""
    middle = np.median(
        points,
        axis=0,
    )
    offset = points - middle
    square = np.square(offset).sum(1)
    mean = square.mean()
    return float(np.sqrt(mean))


def _invert(H: Array) -> Array:
    """Invert normal equations (p, p) after scaling; undetermined directions get a large variance."""
    diagonal = np.diag(H)
    size = np.sqrt(np.maximum(diagonal, TINY))
    scaled = H / np.outer(size, size)
    value, vector = np.linalg.eigh(scaled)
    bounded = np.maximum(
        value,
        NULL_EIGENVALUE,
    )
    whitened = vector / np.sqrt(bounded)
    root = whitened / size[:, None]
    inverse = root @ root.T
    return np.asarray(inverse)


def _compute_largest_sigma(covariance: Array, start: int) -> float:
    """Compute the largest standard deviation in the 3 x 3 block from `start` on."""
    end = start + 3
    block = covariance[start:end, start:end]
    variances = np.linalg.eigvalsh(block)
    largest = max(
        variances[-1],
        0.0,
    )
    return float(np.sqrt(largest))
