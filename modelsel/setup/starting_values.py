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
from ..robot.rigid import from_rotation_vector, nearest_rotation, rotation_vector
from .placement import Placed, Sight, fit_placements
from .robust_weights import (
    MIN_ROTATION_SCALE,
    MIN_SCALE_MM,
    compute_cauchy_weights,
    compute_redescending_weights,
    compute_scale,
    fit_rotation_robustly,
)

REWEIGHTINGS = 12
# angle [rad] between two orientations beyond which the axis of their rotation is not trusted
MAX_ANGLE = 2.8
# distance around the expected targets at which starts are taken
SIDE_MM = 250.0
# second over first extent of points below which they are taken for a line
THIN = 0.1
# singular value per root of the pairs below which rotation axes are all alike
ONE_AXIS = 1e-3


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
    directions = []
    for g in range(sight.groups):
        in_group = sight.group == g
        points = sight.x[in_group]
        directions.append(_find_line(points))
    middle = sight.middles
    axes = np.array(directions)
    if not axes.any():
        return
    from_middle = at.t - middle
    for angle in (np.pi / 2, np.pi, -np.pi / 2):
        W = from_rotation_vector(angle * axes)
        offset = np.einsum("gij,gj->gi", W, from_middle)
        turned = replace(at, R=W @ at.R, t=middle + offset)
        yield _add_target_rotations(sight, turned)


def _find_line(points: Array) -> Array:
    """Find the unit direction (3,) of points (k, 3) that are nearly a line; zero where they are
    not."""
    centred = points - np.median(points, axis=0)
    _, extent, directions = np.linalg.svd(centred, full_matrices=False)
    is_thin = extent[1] < THIN * extent[0]
    line = directions[0] * is_thin
    return np.asarray(line)


def _add_target_rotations(sight: Sight, at: Placed) -> Placed:
    """Add the mean rotation of every target frame on the flange, where orientations are measured."""
    if sight.seen is None:
        return at
    R = at.R[sight.group]
    each = np.einsum("mji,mkj,mkl->mil", sight.F, R, sight.seen)
    rotations = []
    count = len(at.tools)
    for k in range(count):
        of_target = each[sight.target == k]
        mean = _average_rotations(of_target)
        rotations.append(mean)
    turned = np.stack(rotations)
    return replace(at, turned=turned)


def _average_rotations(each: Array) -> Array:
    """Compute the rotation nearest to most of the rotations (k, 3, 3)."""
    weight = np.ones(len(each))
    for _ in range(REWEIGHTINGS):
        total = np.einsum("k,kij->ij", weight, each)
        R = nearest_rotation(total)
        deviation = np.linalg.norm(each - R, axis=(1, 2))
        scale = compute_scale(deviation, MIN_ROTATION_SCALE)
        weight = compute_redescending_weights(deviation, scale)
    return R


def _fill_targets(M: Array, sight: Sight, start: int, columns: Array) -> None:
    """Fill the columns of the targets' offsets (from `start` on) of a design M (m, 3, p) with
    `columns` (m, 3, 3)."""
    m = len(M)
    rows = np.arange(m)
    coordinates = np.arange(3)
    first = start + 3 * sight.target
    offsets = first[:, None, None] + coordinates
    M[rows[:, None, None], coordinates[:, None], offsets] = columns


def _fill_places(M: Array, sight: Sight) -> None:
    """Fill the columns of one place per group (3 G, the first ones) of a design M (m, 3, p)."""
    rows = np.arange(len(M))
    first = 3 * sight.group
    for a in range(3):
        M[rows, a, first + a] = 1.0


def _fill_maps(M: Array, sight: Sight, scaled: Array) -> None:
    """Fill the columns of one affine map per group (12 G, the first ones) of a design M (m, 3, p),
    for scaled positions (m, 3)."""
    m = len(scaled)
    ones = np.ones((m, 1))
    row = np.concatenate([scaled, ones], axis=1)
    rows = np.arange(m)[:, None]
    first = 12 * sight.group[:, None]
    for a in range(3):
        columns = first + 4 * a + np.arange(4)
        M[rows, a, columns] = row


def _start_from_affine_map(sight: Sight) -> Placed:
    """Solve A_g x + b_g − F_i t_i = o_i for affine maps and targets.

    The targets are solved for as deviations from the expected ones, so that they stay near these
    where the rows leave them open."""
    groups = sight.groups
    targets = len(sight.usual)
    m = len(sight.x)
    middle = sight.middles
    centred = sight.x - middle[sight.group]
    largest = float(np.abs(centred).max())
    span = max(largest, 1.0)
    of_targets = 12 * groups
    unknowns = of_targets + 3 * targets
    M = np.zeros((m, 3, unknowns))
    _fill_maps(M, sight, centred / span)
    _fill_targets(M, sight, of_targets, -sight.F)
    solution = _solve_robustly(M, sight.points(sight.usual))
    maps = solution[:of_targets].reshape(groups, 3, 4)
    offsets = solution[of_targets:]
    R = np.empty((groups, 3, 3))
    t = np.empty((groups, 3))
    for g, affine in enumerate(maps):
        to_base = nearest_rotation(affine[:, :3] / span)
        R[g] = to_base.T
        t[g] = middle[g] - R[g] @ affine[:, 3]
    return Placed(R, t, tools=sight.usual + offsets.reshape(targets, 3))


def _find_pivots(sight: Sight) -> Array:
    """Find targets (T, 3) that stay at one place per group, o_i + F_i t = b: for flanges that turn
    about a point."""
    targets = len(sight.usual)
    of_targets = 3 * sight.groups
    unknowns = of_targets + 3 * targets
    M = np.zeros((len(sight.x), 3, unknowns))
    _fill_places(M, sight)
    _fill_targets(M, sight, of_targets, -sight.F)
    expected = sight.points(sight.usual)
    solution = _solve_robustly(M, expected)
    offsets = solution[of_targets:]
    return sight.usual + offsets.reshape(targets, 3)


def _start_from_orientations(sight: Sight) -> Placed | None:
    """Start from measured orientations M_i = R F_i X.

    The rotation from one row to another, seen by the tracker, is that of the flange turned by R
    (hand-eye calibration; Park & Martin 1994); then R F_i t + b = x_i − R o_i is linear. None where
    all rotations have one axis."""
    groups = sight.groups
    targets = len(sight.usual)
    R = np.empty((groups, 3, 3))
    for g in range(groups):
        rotation = _fit_hand_eye(sight, g)
        if rotation is None:
            return None
        R[g] = rotation
    of_row = R[sight.group]
    of_targets = 3 * groups
    unknowns = of_targets + 3 * targets
    M = np.zeros((len(sight.x), 3, unknowns))
    _fill_places(M, sight)
    _fill_targets(M, sight, of_targets, of_row @ sight.F)
    rotated = np.einsum("mij,mj->mi", of_row, sight.points(sight.usual))
    solution = _solve_robustly(M, sight.x - rotated)
    b = solution[:of_targets]
    offsets = solution[of_targets:]
    return Placed(R, t=b.reshape(groups, 3), tools=sight.usual + offsets.reshape(targets, 3))


def _fit_hand_eye(sight: Sight, g: int) -> Array | None:
    """Fit the tracker's rotation R (3, 3) of a group from pairs of its orientations; None where all
    rotations between them have one axis."""
    seen = np.asarray(sight.seen)
    first, second = _pair_rows(sight, g)
    seen_turns = np.einsum("mij,mkj->mik", seen[first], seen[second])
    flange_turns = np.einsum("mij,mkj->mik", sight.F[first], sight.F[second])
    a = rotation_vector(seen_turns)
    b = rotation_vector(flange_turns)
    angle = np.linalg.norm(b, axis=1)
    is_trusted = angle < MAX_ANGLE
    least = ONE_AXIS * np.sqrt(len(b))
    rank = np.linalg.matrix_rank(b[is_trusted], tol=least)
    if rank < 2:
        return None
    return fit_rotation_robustly(a, b, is_trusted)


def _pair_rows(sight: Sight, g: int) -> tuple[Index, Index]:
    """Pair the rows of a group with others of the same target: the next, and one half-way on."""
    first = []
    second = []
    in_group = sight.group == g
    targets = len(sight.usual)
    for k in range(targets):
        is_of_target = sight.target == k
        rows = np.flatnonzero(in_group & is_of_target)
        half = len(rows) // 2
        for shift in {1, half}:
            other = np.roll(rows, shift)
            first.append(rows)
            second.append(other)
    return np.concatenate(first), np.concatenate(second)


def _solve_robustly(M: Array, y: Array) -> Array:
    """Solve least squares of y (m, 3) on M (m, 3, p) with Cauchy weights per row: up to a third of
    the rows may be gross."""
    m, _, unknowns = M.shape
    weight = np.ones(m)
    for _ in range(REWEIGHTINGS):
        of_rows = weight[:, None]
        design = M * of_rows[:, None]
        response = y * of_rows
        solution, *_ = np.linalg.lstsq(design.reshape(-1, unknowns), response.ravel(), rcond=1e-9)
        rest = M @ solution - y
        distance = np.linalg.norm(rest, axis=1)
        scale = compute_scale(distance, MIN_SCALE_MM)
        weight = compute_cauchy_weights(distance, scale)
    return np.asarray(solution)
