"""Starting values for tracker placements and targets.

An affine map from the tracker to frame 0 together with the targets' offsets is a linear problem, but
is undetermined where the points lie on a line or a plane; a rigid fit needs the targets; measured
orientations give the tracker's rotation alone, which is what determines it where the target may sit
at a point that no joint moves, as on a two-axis positioner."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from .._typing import Array, Index
from ..robot.rigid import nearest_rotation, rotation_vector
from .placement import Placed, Sight, fit_placements
from .robust_weights import compute_cauchy_weights, compute_redescending_weights, compute_scale

REWEIGHTINGS = 12
# angle [rad] between two orientations beyond which the axis of their rotation is not trusted
MAX_ANGLE = 2.8
# distance around the expected targets at which starts are taken
SIDE_MM = 250.0
# second over first extent of points below which they are taken for a line
THIN = 0.1
# singular value per root of the pairs below which rotation axes are all alike
ONE_AXIS = 1e-3
# smallest scales of the weights [mm], and of rotations [rad]
MIN_SCALE_MM = 1e-6
MIN_SCALE = 1e-9


def generate_starts(sight: Sight) -> Iterator[Placed]:
    """Generate starting values, the likeliest first."""
    if sight.seen is not None:
        oriented = _start_from_orientations(sight)
        if oriented is not None:
            yield _add_target_rotations(sight, oriented)
    affine = _start_from_affine_map(sight)
    yield _add_target_rotations(sight, affine)
    for tools in _generate_targets(sight, affine):
        yield _add_target_rotations(sight, fit_placements(sight, tools))


def _generate_targets(sight: Sight, affine: Placed) -> Iterator[Array]:
    """Generate targets (T, 3) for rigid fits: as expected, by the affine map, where the flange
    pivots, and around the expected ones."""
    yield sight.usual
    yield affine.tools
    yield _find_pivots(sight)
    for direction in np.eye(3):
        yield sight.usual + SIDE_MM * direction
        yield sight.usual - SIDE_MM * direction


def turn_about_lines(sight: Sight, at: Placed) -> Iterator[Placed]:
    """Turn the placement about the points of every group where they are nearly a line: what a rigid
    fit leaves open."""
    from scipy.spatial.transform import Rotation

    middle = np.array([sight.middle(g) for g in range(sight.groups)])
    axes = np.array([_find_line(sight.x[sight.group == g]) for g in range(sight.groups)])
    if not axes.any():
        return
    for angle in (np.pi / 2, np.pi, -np.pi / 2):
        W = Rotation.from_rotvec(angle * axes).as_matrix()
        t = middle + np.einsum("gij,gj->gi", W, at.t - middle)
        yield _add_target_rotations(sight, replace(at, R=W @ at.R, t=t))


def _find_line(points: Array) -> Array:
    """Find the unit direction (3,) of points (k, 3) that are nearly a line; zero where they are
    not."""
    centred = points - np.median(points, axis=0)
    _, extent, directions = np.linalg.svd(centred, full_matrices=False)
    return np.asarray(directions[0] * (extent[1] < THIN * extent[0]))


def _add_target_rotations(sight: Sight, at: Placed) -> Placed:
    """Add the mean rotation of every target frame on the flange, where orientations are measured."""
    if sight.seen is None:
        return at
    each = np.einsum("mji,mkj,mkl->mil", sight.F, at.R[sight.group], sight.seen)
    targets = range(len(at.tools))
    turned = np.stack([_average_rotations(each[sight.target == k]) for k in targets])
    return replace(at, turned=turned)


def _average_rotations(each: Array) -> Array:
    """Compute the rotation nearest to most of the rotations (k, 3, 3)."""
    weight = np.ones(len(each))
    for _ in range(REWEIGHTINGS):
        R = nearest_rotation(np.einsum("k,kij->ij", weight, each))
        size = np.linalg.norm(each - R, axis=(1, 2))
        weight = compute_redescending_weights(size, compute_scale(size, MIN_SCALE))
    return R


def _fill_targets(M: Array, sight: Sight, start: int, columns: Array) -> None:
    """Fill the columns of the targets' offsets (from `start` on) of a design M (m, 3, p) with
    `columns` (m, 3, 3)."""
    rows, coordinates = np.arange(len(M))[:, None, None], np.arange(3)[:, None]
    offsets = (start + 3 * sight.target)[:, None, None] + np.arange(3)
    M[rows, coordinates, offsets] = columns


def _fill_places(M: Array, sight: Sight) -> None:
    """Fill the columns of one place per group (3 G, the first ones) of a design M (m, 3, p)."""
    for a in range(3):
        M[np.arange(len(M)), a, 3 * sight.group + a] = 1.0


def _start_from_affine_map(sight: Sight) -> Placed:
    """Solve A_g x + b_g − F_i t_i = o_i for affine maps and targets.

    The targets are solved for as deviations from the expected ones, so that they stay near these
    where the rows leave them open."""
    groups, targets, m = sight.groups, len(sight.usual), len(sight.x)
    middle = np.array([sight.middle(g) for g in range(groups)])
    centred = sight.x - middle[sight.group]
    span = max(float(np.abs(centred).max()), 1.0)
    row = np.concatenate([centred / span, np.ones((m, 1))], 1)
    M = np.zeros((m, 3, 12 * groups + 3 * targets))
    for a in range(3):
        columns = 12 * sight.group[:, None] + 4 * a + np.arange(4)
        M[np.arange(m)[:, None], a, columns] = row
    _fill_targets(M, sight, 12 * groups, -sight.F)
    solution = _solve_robustly(M, sight.points(sight.usual))
    maps = solution[: 12 * groups].reshape(groups, 3, 4)
    to_base = np.array([nearest_rotation(part[:, :3] / span) for part in maps])
    R = np.ascontiguousarray(to_base.transpose(0, 2, 1))
    t = np.array(
        [m - rotation @ part[:, 3] for m, rotation, part in zip(middle, R, maps, strict=True)]
    )
    return Placed(R, t, sight.usual + solution[12 * groups :].reshape(targets, 3))


def _find_pivots(sight: Sight) -> Array:
    """Find targets (T, 3) that stay at one place per group, o_i + F_i t = b: for flanges that turn
    about a point."""
    groups, targets = sight.groups, len(sight.usual)
    M = np.zeros((len(sight.x), 3, 3 * groups + 3 * targets))
    _fill_places(M, sight)
    _fill_targets(M, sight, 3 * groups, -sight.F)
    solution = _solve_robustly(M, sight.points(sight.usual))
    return sight.usual + solution[3 * groups :].reshape(targets, 3)


def _start_from_orientations(sight: Sight) -> Placed | None:
    """Start from measured orientations M_i = R F_i X.

    The rotation from one row to another, seen by the tracker, is that of the flange turned by R
    (hand-eye calibration; Park & Martin 1994); then R F_i t + b = x_i − R o_i is linear. None where
    all rotations have one axis."""
    groups, targets = sight.groups, len(sight.usual)
    R = np.empty((groups, 3, 3))
    for g in range(groups):
        rotation = _fit_hand_eye(sight, g)
        if rotation is None:
            return None
        R[g] = rotation
    of_row = R[sight.group]
    M = np.zeros((len(sight.x), 3, 3 * groups + 3 * targets))
    _fill_places(M, sight)
    _fill_targets(M, sight, 3 * groups, of_row @ sight.F)
    y = sight.x - np.einsum("mij,mj->mi", of_row, sight.points(sight.usual))
    solution = _solve_robustly(M, y)
    b, offset = solution[: 3 * groups], solution[3 * groups :]
    return Placed(R, b.reshape(groups, 3), sight.usual + offset.reshape(targets, 3))


def _fit_hand_eye(sight: Sight, g: int) -> Array | None:
    """Fit the tracker's rotation R (3, 3) of a group from pairs of its orientations; None where all
    rotations between them have one axis."""
    seen = np.asarray(sight.seen)
    first, second = _pair_rows(sight, g)
    a = rotation_vector(np.einsum("mij,mkj->mik", seen[first], seen[second]))
    b = rotation_vector(np.einsum("mij,mkj->mik", sight.F[first], sight.F[second]))
    is_trusted = np.linalg.norm(b, axis=1) < MAX_ANGLE
    if np.linalg.matrix_rank(b[is_trusted], tol=ONE_AXIS * np.sqrt(len(b))) < 2:
        return None
    weight = is_trusted.astype(float)
    for _ in range(REWEIGHTINGS):
        R = nearest_rotation(np.einsum("m,mi,mj->ij", weight, a, b))
        size = np.linalg.norm(a - b @ R.T, axis=1)
        weight = is_trusted * compute_cauchy_weights(size, compute_scale(size, MIN_SCALE))
    return R


def _pair_rows(sight: Sight, g: int) -> tuple[Index, Index]:
    """Pair the rows of a group with others of the same target: the next, and one half-way on."""
    first, second = [], []
    for k in range(len(sight.usual)):
        rows = np.flatnonzero((sight.group == g) & (sight.target == k))
        for shift in {1, len(rows) // 2}:
            first.append(rows)
            second.append(np.roll(rows, shift))
    return np.concatenate(first), np.concatenate(second)


def _solve_robustly(M: Array, y: Array) -> Array:
    """Solve least squares of y (m, 3) on M (m, 3, p) with Cauchy weights per row: up to a third of
    the rows may be gross."""
    weight = np.ones(len(y))
    for _ in range(REWEIGHTINGS):
        W = weight[:, None, None]
        design, response = (M * W).reshape(-1, M.shape[2]), (y * W[:, 0]).ravel()
        solution = np.linalg.lstsq(design, response, rcond=1e-9)[0]
        size = np.linalg.norm(M @ solution - y, axis=1)
        weight = compute_cauchy_weights(size, compute_scale(size, MIN_SCALE_MM))
    return np.asarray(solution)
