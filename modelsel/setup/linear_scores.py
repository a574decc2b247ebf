"""Linear scores of mistakes of the readings: what the best affine map from the tracker and the best
target leave of the positions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .._typing import Array
from ..fitting.problem import Problem
from ..robot.kinematics import pose
from .robust_weights import MEDIANS, MIN_SCALE_MM, compute_redescending_weights
from .simple_mistakes import Mistake

REWEIGHTINGS = 8
# mistakes that are scored in one block of the linear solution
BLOCK = 64
MIN_SPAN_MM = 1e-6


def score_linearly(problem: Problem, joints: Sequence[Mistake]) -> tuple[Array, Array]:
    """Score mistakes of the readings by what an affine map and a target can explain: (misfits (H,),
    scales (H,)).

    For the readings as each of H mistakes has them, the best affine map from the tracker to frame 0
    and the best target are found with redescending weights. The misfit is the median distance left,
    over the mapped positions' own (a map may shrink the world); the scale is the map's, negative
    where it mirrors."""
    position = problem.data.position
    middle = np.median(position, axis=0)
    x = position - middle
    size = np.abs(x)
    largest = float(size.max())
    span = max(largest, MIN_SPAN_MM)
    ones = np.ones((len(x), 1))
    row = np.concatenate([x / span, ones], axis=1)
    misfits = []
    scales = []
    for start in range(0, len(joints), BLOCK):
        block = joints[start : start + BLOCK]
        o, F = _compute_flanges(problem, block)
        misfit, scale = _fit_affine_maps(row, o, F)
        misfits.append(misfit)
        scales.append(scale / span)
    return np.concatenate(misfits), np.concatenate(scales)


def _compute_flanges(problem: Problem, joints: Sequence[Mistake]) -> tuple[Array, Array]:
    """Compute the flange's positions o (H, m, 3) and rotations F (H, m, 3, 3) for the readings as
    each of H mistakes has them."""
    count = len(joints)
    m = len(problem)
    readings = []
    for joint in joints:
        turned = problem.data.q @ joint.A.T
        readings.append(turned + joint.c)
    flange = pose(problem.robot, np.concatenate(readings), np.zeros(3))
    axes = flange.axes[-1, :3]
    rotation = axes.transpose(2, 1, 0)
    position = flange.target.T
    o = position.reshape(count, m, 3)
    F = rotation.reshape(count, m, 3, 3)
    return o, F


def _solve_weighted(weighted: Array, design: Array, response: Array, rcond: float) -> Array:
    """Solve the normal equations of stacked weighted least squares, `weighted` the transposed design
    times the weights."""
    normal = weighted @ design
    inverse = np.linalg.pinv(normal, rcond=rcond, hermitian=True)
    return np.asarray(inverse @ (weighted @ response))


def _measure_maps(row: Array, maps: Array, t: Array) -> tuple[Array, Array]:
    """Measure affine maps (H, 4, 12) with targets t (H, 3, 1): (median distances (H,) of the mapped
    positions, cube roots of the determinants (H,))."""
    count = len(maps)
    ones = np.ones((count, 1, 1))
    with_target = np.concatenate([ones, t], axis=1)
    of_axes = maps.reshape(count, 4, 3, 4)
    linear = of_axes[:, :3] @ with_target[:, None]
    linear = linear[..., 0]
    distance = np.linalg.norm(row[:, :3] @ linear, axis=2)
    determinant = np.linalg.det(linear)
    root = np.cbrt(determinant)
    return np.median(distance, axis=1), root


def _fit_affine_maps(row: Array, o: Array, F: Array) -> tuple[Array, Array]:
    """Fit affine maps (H, 4, 3) and targets t (H, 3) with row · map = o + F t, for rows (m, 4):
    (misfits (H,), cube roots of the maps' determinants (H,))."""
    count, m = o.shape[:2]
    y = np.concatenate([o[..., None], F], axis=3)
    y = y.reshape(count, m, 12)
    weight = np.ones((count, m))
    for _ in range(REWEIGHTINGS):
        # the map for the flange's position, and for every axis of the flange
        weighted = weight[:, None] * row.T
        maps = _solve_weighted(weighted, row, y, rcond=1e-12)
        rest = y - row @ maps
        rest = rest.reshape(count, m, 3, 4)
        o_rest = rest[..., :1].reshape(count, 3 * m, 1)
        F_rest = rest[..., 1:].reshape(count, 3 * m, 3)
        # the target that leaves least beyond the maps
        of_coordinates = np.repeat(weight, 3, axis=1)
        weighted = of_coordinates[:, None] * F_rest.transpose(0, 2, 1)
        t = -_solve_weighted(weighted, F_rest, o_rest, rcond=1e-9)
        left = o_rest + F_rest @ t
        distance = np.linalg.norm(left.reshape(count, m, 3), axis=2)
        median = np.median(distance, axis=1)
        scale = np.maximum(MEDIANS * median, MIN_SCALE_MM)
        weight = compute_redescending_weights(distance, scale[:, None])
    spread, root = _measure_maps(row, maps, t)
    return median / np.maximum(spread, 1e-9), root
