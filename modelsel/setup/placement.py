"""Robust rigid adjustment of tracker placements and targets: starts, exact descent, and what the
rows leave open.

Model of a row: x = R_g (o + F c_k) + t_g, with o, F the flange's nominal position and rotation, c_k
the target's offset on it. For known targets the placement is a rigid fit (Kabsch 1976); both
together are descended by Levenberg-Marquardt on a redescending loss (Geman & McClure 1985). A
target is expected within STATED_MM of where the study has it, else within USUAL_MM of the flange: a
weak prior, felt only where the rows do not tell."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from .._typing import Array, Index
from ..robot.rigid import nearest_rotation, rotation_vector

# prior standard deviation of a target's coordinates on the flange where the study says none,
USUAL_MM = 500.0
STATED_MM = 50.0  # about those it says
LOSS = 3.0  # medians beyond which a row counts less and less
GROSS = 6.0  # medians beyond which a row is left out of the last fit
LEVER_MM = 1.0  # that a radian of orientation counts for
LEAST_MM = 1e-6  # smallest median that is believed
MEDIAN_3 = 1.538  # median length of three standard normal coordinates
ROUNDS, STEPS = 6, 40
SUBSETS = 48  # of four rows each, of which rigid fits start
USUAL = 2e-3  # error of an arm as a share of how far it moves,
MISFIT = (
    0.01  # share of how far it moves above which what is left says nothing of how well it is known
)
INDEPENDENT = 6  # and of how many rows it is alike
USUAL_ERROR = 1e-14  # least eigenvalue of scaled normal equations: what nothing tells stays finite
STILL, COARSE = (
    1e-12,
    1e-5,
)  # relative fall of the cost at which a descent ends; where only minima are compared

State = TypeVar("State")


@dataclass(frozen=True, eq=False)
class Sight:
    """Rows to place: measured x (m, 3) [mm] and, where measured, orientations `seen` (m, 3, 3); the
    flange's nominal position o (m, 3) and rotation F (m, 3, 3) in frame 0; group and target (m,);
    `usual` (T, 3) where targets are expected."""

    x: Array
    o: Array
    F: Array
    group: Index
    target: Index
    groups: int
    usual: Array
    seen: Array | None = None

    @property
    def open(self) -> int:
        """Unknowns of the placements and targets."""
        return 6 * self.groups + int(self.usual.size)

    @property
    def trust(self) -> Array:
        """(T, 1) prior standard deviation of every target's coordinates [mm]."""
        return np.asarray(np.where(self.usual.any(axis=1, keepdims=True), STATED_MM, USUAL_MM))

    def take(self, rows: Index) -> Sight:
        """Some of the rows."""
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
        """(group, target, rows) of every pair that occurs."""
        key = self.group * len(self.usual) + self.target
        for k in np.unique(key):
            yield int(k) // len(self.usual), int(k) % len(self.usual), np.flatnonzero(key == k)


@dataclass(frozen=True, eq=False)
class Placed:
    """R (G, 3, 3) and t (G, 3) [mm] of frame 0 in the tracker's frame, tools (T, 3) [mm]; with
    orientations, the target frames' rotations on the flange `turned` (T, 3, 3)."""

    R: Array
    t: Array
    tools: Array
    turned: Array | None = None


def left(sight: Sight, at: Placed) -> Array:
    """(m, 3) measured minus predicted positions [mm]; (m, 6) with orientations, rotation vectors
    times the lever."""
    base = sight.o + np.einsum("mij,mj->mi", sight.F, at.tools[sight.target])
    position: Array = sight.x - np.einsum("mij,mj->mi", at.R[sight.group], base) - at.t[sight.group]
    if sight.seen is None or at.turned is None:
        return position
    turned = at.R[sight.group] @ sight.F @ at.turned[sight.target]
    rotation = rotation_vector(np.einsum("mij,mkj->mik", sight.seen, turned))
    return np.concatenate([position, LEVER_MM * rotation], axis=1)


def compute_misfits(sight: Sight, at: Placed) -> Array:
    """(m,) norms of `left`."""
    return np.asarray(np.linalg.norm(left(sight, at), axis=1))


def compute_trimmed_median(size: Array, unknowns: int) -> Array:
    """(...) the length of (..., m) that more than half are below, beyond the rows that `unknowns`
    can fit exactly (Rousseeuw
    1984); LEAST_MM at the least."""
    m = size.shape[-1]
    k = min((3 * m + unknowns + 1) // 6, m - 1)
    return np.asarray(np.maximum(np.partition(size, k, axis=-1)[..., k], LEAST_MM))


def fit_rigid_transform(x: Array, y: Array, weight: Array) -> tuple[Array, Array]:
    """Rigid fits x ≈ R y + t of (..., k, 3) points with weights (..., k): R (..., 3, 3), t (...,
    3)."""
    w = weight / np.maximum(weight.sum(-1, keepdims=True), 1e-300)
    mx, my = np.einsum("...k,...ki->...i", w, x), np.einsum("...k,...ki->...i", w, y)
    U, _, Vt = np.linalg.svd(
        np.einsum("...k,...ki,...kj->...ij", w, x - mx[..., None, :], y - my[..., None, :])
    )
    turn = np.ones(U.shape[:-1])
    turn[..., 2] = np.sign(np.linalg.det(U @ Vt))
    R = (U * turn[..., None, :]) @ Vt
    return R, mx - np.einsum("...ij,...j->...i", R, my)


def fit_placements(sight: Sight, tools: Array) -> Placed:
    """Placements for known targets: the best of rigid fits to all rows and to fours of them by the
    median, then reweighted."""
    y = sight.o + np.einsum("mij,mj->mi", sight.F, tools[sight.target])
    R, t = np.tile(np.eye(3), (sight.groups, 1, 1)), np.zeros((sight.groups, 3))
    for g in np.unique(sight.group):
        rows = np.flatnonzero(sight.group == g)
        xs, ys, m = sight.x[rows], y[rows], len(rows)
        some = (np.outer(np.arange(SUBSETS) + 0.5, np.sqrt([5.0, 2.0, 3.0, 7.0])) % 1.0 * m).astype(
            int
        )
        many = [
            fit_rigid_transform(xs[None], ys[None], np.ones((1, m))),
            fit_rigid_transform(xs[some], ys[some], np.ones(some.shape)),
        ]
        Rs, ts = (np.concatenate([pair[k] for pair in many]) for k in (0, 1))
        size = np.linalg.norm(xs - ys @ Rs.transpose(0, 2, 1) - ts[:, None], axis=2)
        best = int(compute_trimmed_median(size, 6).argmin())
        R[g], t[g], near = Rs[best], ts[best], size[best]
        for _ in range(ROUNDS):
            weight = 1 / (1 + (near / (LOSS * compute_trimmed_median(near, 6))) ** 2) ** 2
            R[g], t[g] = fit_rigid_transform(xs, ys, weight)
            near = np.linalg.norm(xs - ys @ R[g].T - t[g], axis=1)
    return Placed(R, t, tools)


def normal_equations(sight: Sight, at: Placed, weight: Array) -> tuple[Array, Array]:
    """(H (p, p), g (p,)) of the weighted squares of `left` for small turns and shifts of every
    group (6 G, about the median of its points), shifts of every target (3 T) and, with
    orientations, turns of it (3 T)."""
    G, T, rest = sight.groups, len(at.tools), left(sight, at)
    turns = at.turned is not None and sight.seen is not None
    H, g = (
        np.zeros((6 * G + (6 if turns else 3) * T,) * 2),
        np.zeros(6 * G + (6 if turns else 3) * T),
    )
    for group, target, rows in sight.pairs():
        RF = at.R[group] @ sight.F[rows]
        arm = RF @ at.tools[target] + sight.o[rows] @ at.R[group].T
        J = np.zeros((len(rows), rest.shape[1], 12 if turns else 9))
        J[:, :3, :3] = -cross_matrices(
            arm - compute_turning_point(sight, at, group)
        )  # change of what is predicted
        J[:, :3, 3:6], J[:, :3, 6:9] = np.eye(3), RF
        if turns:
            J[:, 3:, :3], J[:, 3:, 9:] = LEVER_MM * np.eye(3), LEVER_MM * RF
        root = np.sqrt(weight[rows])[:, None]
        A, b = (J * root[:, :, None]).reshape(-1, J.shape[2]), (rest[rows] * root).ravel()
        at_ = np.concatenate(
            [
                6 * group + np.arange(6),
                6 * G + 3 * target + np.arange(3),
                *([6 * G + 3 * T + 3 * target + np.arange(3)] if turns else []),
            ]
        )
        H[np.ix_(at_, at_)] += A.T @ A
        g[at_] += A.T @ b
    return H, g


def compute_turning_point(sight: Sight, at: Placed, group: int) -> Array:
    """(3,) the middle of a group's points about which it is turned, from its placement's shift, in
    the tracker's axes [mm]."""
    return np.asarray(np.median(sight.x[sight.group == group], axis=0) - at.t[group])


def cross_matrices(v: Array) -> Array:
    """(m, 3, 3) with cross(v) w = v x w."""
    out = np.zeros((len(v), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return out - out.transpose(0, 2, 1)


def _moved(sight: Sight, at: Placed, step: Array) -> Placed:
    from scipy.spatial.transform import Rotation

    G, T = sight.groups, len(at.tools)
    by = step[: 6 * G].reshape(G, 6)
    W = Rotation.from_rotvec(by[:, :3]).as_matrix()
    middle = np.array([compute_turning_point(sight, at, g) for g in range(G)])
    t = at.t + by[:, 3:] + middle - np.einsum("gij,gj->gi", W, middle)
    tools = at.tools + step[6 * G : 6 * G + 3 * T].reshape(T, 3)
    turned = at.turned
    if turned is not None and len(step) > 6 * G + 3 * T:
        turned = Rotation.from_rotvec(step[6 * G + 3 * T :].reshape(T, 3)).as_matrix() @ turned
    return replace(
        at, R=np.stack([nearest_rotation(R) for R in W @ at.R]), t=t, tools=tools, turned=turned
    )


def _prior(sight: Sight, at: Placed, sigma: float) -> tuple[Array, Array]:
    """((3 T,) weights, (3 T,) distances) of the targets from where they are expected, in units of a
    row's squares."""
    return np.repeat((sigma / sight.trust) ** 2, 3), (at.tools - sight.usual).ravel()


def _descended(
    sight: Sight, at: Placed, scale: float | None, weight: Array, sigma: float, still: float = STILL
) -> Placed:
    """Levenberg-Marquardt from `at` on the loss of the given scale [mm], on plain squares with the
    given weights without."""

    def cost(p: Placed) -> float:
        square = np.square(left(sight, p)).sum(1)
        strength, away = _prior(sight, p, sigma)
        return float(
            (weight * square if scale is None else square / (1 + square / scale**2)).sum()
            + strength @ away**2
        )

    def equations(p: Placed) -> tuple[Array, Array]:
        w = weight if scale is None else 1 / (1 + np.square(left(sight, p)).sum(1) / scale**2) ** 2
        H, g = normal_equations(sight, p, w)
        strength, away = _prior(sight, p, sigma)
        tool = 6 * sight.groups + np.arange(len(away))
        H[tool, tool] += strength
        g[tool] -= strength * away
        return H, g

    return descend(at, cost, equations, lambda p, step: _moved(sight, p, step), still)


def descend(
    at: State,
    cost: Callable[[State], float],
    equations: Callable[[State], tuple[Array, Array]],
    moved: Callable[[State, Array], State],
    still: float = STILL,
) -> State:
    """Levenberg-Marquardt from a state to where its cost falls no more; `equations` are the normal
    equations (H (p, p), g (p,)) of a step (p,) that `moved` takes."""
    now, damping = cost(at), 1e-6
    for _ in range(STEPS):
        H, g = equations(at)
        size = np.sqrt(np.maximum(np.diag(H), 1e-300))
        fallen = False
        while damping < 1e8 and not fallen:
            step = (
                np.linalg.lstsq(
                    H / np.outer(size, size) + damping * np.eye(len(H)), g / size, rcond=1e-15
                )[0]
                / size
            )
            there = moved(at, step)
            new = cost(there)
            fallen = new < now
            damping = max(damping / 10, 1e-12) if fallen else max(10 * damping, 1e-9)
        if not fallen:
            return at
        at, gain, now = there, now - new, new
        if gain <= still * now:
            return at
    return at


def refine_robustly(sight: Sight, at: Placed) -> Placed:
    """From a start to the nearest minimum of the redescending loss, its scale taken anew from the
    median."""
    before = np.inf
    for _ in range(ROUNDS):
        median = float(compute_trimmed_median(compute_misfits(sight, at), sight.open))
        if median > 0.99 * before:
            break
        before, at = (
            median,
            _descended(sight, at, LOSS * median, np.ones(len(sight.x)), median / MEDIAN_3, COARSE),
        )
    return at


def refine_without_gross_rows(sight: Sight, at: Placed) -> tuple[Placed, NDArray[np.bool_]]:
    """(least squares of the rows that are not gross, their mask)."""
    good = np.ones(len(sight.x), bool)
    for _ in range(3):
        size = compute_misfits(sight, at)
        median = float(compute_trimmed_median(size, sight.open))
        good = size <= GROSS * median
        at = _descended(sight, at, None, good.astype(float), median / MEDIAN_3)
    return at, good


def spread(sight: Sight, at: Placed, good: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Standard deviations that the good rows leave, targets expected as usual: ((G,) of the least
    certain turn of each placement [rad], (T,) of the least certain direction of each target [mm]).
    The arm's own errors, USUAL of how far it moves, are shared by rows: they count as if a few were
    measured."""
    moves = max(
        float(np.sqrt(np.square(v - np.median(v, axis=0)).sum(1).mean()))
        for v in (sight.x[good], sight.o[good])
    )
    square = min(
        float(np.square(left(sight, at)[good]).mean()), (MISFIT * moves) ** 2
    )  # beyond, the robot is wrong
    sigma = max(
        float(np.sqrt(square + (USUAL * moves) ** 2 * max(good.sum() / INDEPENDENT, 1.0))), LEAST_MM
    )
    H = normal_equations(sight, at, good.astype(float))[0] / sigma**2
    G, T = sight.groups, len(at.tools)
    tool = 6 * G + np.arange(3 * T)
    H[tool, tool] += np.repeat(1 / sight.trust**2, 3)
    size = np.sqrt(np.maximum(np.diag(H), 1e-300))
    value, vector = np.linalg.eigh(H / np.outer(size, size))
    inner = vector / np.sqrt(np.maximum(value, USUAL_ERROR)) / size[:, None]
    covariance = inner @ inner.T

    def least(at_: int) -> float:
        return float(
            np.sqrt(max(np.linalg.eigvalsh(covariance[at_ : at_ + 3, at_ : at_ + 3])[-1], 0.0))
        )

    return (
        np.array([least(6 * g) for g in range(G)]),
        np.array([least(6 * G + 3 * k) for k in range(T)]),
    )
