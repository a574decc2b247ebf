"""A set-up found again from new data: one placement and the targets' offsets, beside a calibrated
arm that stays as it is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..._linalg import RANK_TOLERANCE, orthonormal_basis
from ..._typing import Array, Index
from ...exceptions import DataError, count_words
from ...fitting.problem import Problem
from ...measurements.campaign.state_names import FROM_INSTRUMENT
from ...robot.rigid import rotation_vector
from ...setup.placement import fit_rigid_transform
from ...setup.robust_weights import MIN_SCALE_MM, compute_cauchy_weights, compute_scale
from ..calibration import Calibration
from ..prediction import compute_pose

MAX_ROUNDS = 12  # of a registration
MIN_CONFIGURATIONS = 4  # that a placement needs


@dataclass(frozen=True, eq=False)
class Registration:
    """A set-up found again from new data: the problem with it; how far the tracker [mm, rad] and
    the targets [mm] moved; columns (m, 3, k) of what was left free."""

    problem: Problem
    moved: tuple[float, float, float]
    free: Array


def register_again(c: Calibration, at: Problem) -> Registration:
    """Find one placement and the targets' offsets from new data; the calibrated arm stays as it is.
    Robust. Raises DataError."""
    count = at.data.configurations
    if count < MIN_CONFIGURATIONS:
        raise DataError(
            f"the file has {count_words(count, 'configuration')}, and --register needs {MIN_CONFIGURATIONS}.",
            remedy="Measure more.",
        )
    registration = _register_at(c, at, at)
    _check_judgeable(at, registration.free)
    if FROM_INSTRUMENT & c.needs():  # the beam goes to where the tracker now stands
        return _register_at(c, at, registration.problem)
    return registration


def _check_judgeable(at: Problem, free: Array) -> None:
    """Raise DataError where the set-up, the columns `free` (m, 3, k), follows whatever is measured."""
    coordinates = at.data.position.size
    columns = free.reshape(coordinates, -1)
    rank = orthonormal_basis(columns).shape[1]
    if rank < coordinates:
        return
    rows = count_words(len(at.data), "row")
    count = len(np.unique(at.data.target))
    targets = count_words(count, "target")
    raise DataError(
        f"the file has {rows} of {targets}, which --register uses up: the places of the instrument and "
        "of the targets fit them exactly, and nothing is left to judge.",
        remedy="Measure more configurations, or every target in each of them.",
    )


def _register_at(c: Calibration, start: Problem, at: Problem) -> Registration:
    """Register the problem `start`, with the model's causes taken where `at` has the tracker.

    Alternates Kabsch's placement with Cauchy-weighted offsets of the targets.
    """
    pose = compute_pose(at, c.terms, c.theta)
    origins = pose.target.T
    measured = start.data.position
    # of the target's frame, as columns
    axes = pose.axes[-1, :3].transpose(2, 1, 0)
    seen, target = np.unique(start.data.target, return_inverse=True)
    offset = np.zeros((len(seen), 3))
    weight = np.ones(len(measured))
    for k in range(MAX_ROUNDS):
        points = origins + np.einsum("mij,mj->mi", axes, offset[target])
        R, t = fit_rigid_transform(measured, points, weight)
        free = _setup_columns(R, points, axes, target)
        residual = measured - points @ R.T - t
        step = _weighted_step(free, residual, weight)
        # the placement follows by the next Kabsch
        if k < MAX_ROUNDS - 1:
            offset += step[6:].reshape(-1, 3)
        weight = _cauchy_weights(residual - free @ step)
    offsets = np.einsum("ij,mjk,mk->mi", R, axes, offset[target])
    placed = _place(start, R, t, offsets)
    shift, turn = _placement_shift(start, R, t, origins.mean(0))
    calibrated = seen < len(c.targets)
    largest = _largest(offset[calibrated])
    return Registration(placed, (shift, turn, largest), free)


def _weighted_step(free: Array, residual: Array, weight: Array) -> Array:
    """Solve the weighted least-squares step (k,) of what is free."""
    root = np.sqrt(weight)
    scale = root[:, None, None]
    weighted_columns = free * scale
    columns = weighted_columns.reshape(-1, free.shape[2])
    weighted_residual = residual * scale[:, 0]
    response = weighted_residual.ravel()
    step, *_ = np.linalg.lstsq(columns, response, rcond=RANK_TOLERANCE)
    return np.asarray(step)


def _cauchy_weights(residual: Array) -> Array:
    """Return weights (m,) that fall beyond three median lengths of the residual (m, 3)."""
    size = np.linalg.norm(residual, axis=1)
    scale = compute_scale(size, MIN_SCALE_MM)
    return compute_cauchy_weights(size, scale)


def _place(start: Problem, R: Array, t: Array, offsets: Array) -> Problem:
    """Return the problem with one placement for all groups, the targets' offsets (m, 3) taken from
    the measured positions."""
    rotations, _ = start.placement
    groups = len(rotations)
    R_of_groups = np.tile(R, (groups, 1, 1))
    t_of_groups = np.tile(t, (groups, 1))
    position = start.data.position - offsets
    data = replace(start.data, position=position)
    return replace(start, placement=(R_of_groups, t_of_groups), data=data)


def _placement_shift(start: Problem, R: Array, t: Array, middle: Array) -> tuple[float, float]:
    """Return how far a new placement is from that of the first group: mm at the middle of the
    workspace, rad."""
    rotations, translations = start.placement
    group = start.data.group[0]
    R_before = rotations[group]
    t_before = translations[group]
    shift = R @ middle + t - R_before @ middle - t_before
    relative = R @ R_before.T
    turn = rotation_vector(relative[None])[0]
    distance = np.linalg.norm(shift)
    angle = np.linalg.norm(turn)
    return float(distance), float(angle)


def _largest(offset: Array) -> float:
    """Return the largest length of offsets (k, 3); zero where there are none."""
    lengths = np.linalg.norm(offset, axis=1)
    largest = lengths.max(initial=0.0)
    return float(largest)


def _setup_columns(R: Array, points: Array, axes: Array, target: Index) -> Array:
    """Return columns (m, 3, 6 + 3 T) [mm per mm, rad]: shift and turn of the placement, offset of
    every target."""
    count = int(target.max()) + 1
    width = 6 + 3 * count
    columns = np.zeros((len(points), 3, width))
    identity = np.eye(3)
    columns[:, :, :3] = identity
    centred = (points - points.mean(0)) @ R.T
    for axis in range(3):
        turn = np.cross(identity[axis], centred)
        columns[:, :, 3 + axis] = turn
    rotated = R @ axes
    for k in range(count):
        rows = target == k
        first = 6 + 3 * k
        columns[rows, :, first : first + 3] = rotated[rows]
    return columns
