"""Where a calibrated robot has its target, and how surely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .._typing import Array
from ..fitting.design import compute_columns, field_of, residuals, twist_of
from ..fitting.problem import Problem
from ..measurements.measurements import Measurements
from ..mechanisms.terms import Term
from ..robot.kinematics import Pose
from .arm_alone import leave_out_instrument

if TYPE_CHECKING:
    from .calibration import Calibration

BLOCK_ROWS = 512


def compute_pose(problem: Problem, terms: tuple[Term, ...], theta: Array) -> Pose:
    """Compute the exact chain of all rows at parameters theta, in frame 0."""
    rows = slice(0, len(problem))
    twist = twist_of(problem, terms, theta, rows)
    return problem.pose(rows, twist)


def to_tracker_frame(problem: Problem, points: Array) -> Array:
    """Transform points (m, 3) of frame 0 into the tracker's frame."""
    rotations, translations = problem.placement
    group = problem.data.group
    t = translations[group]
    rotated = np.einsum("mij,mj->mi", rotations[group], points)
    return np.asarray(rotated + t)


def predict(calibration: Calibration, problem: Problem) -> Array:
    """Predict target positions (m, 3) [mm] of the calibrated robot in the tracker's frame."""
    terms = calibration.terms
    theta = calibration.theta
    pose = compute_pose(problem, terms, theta)
    points = pose.target.T
    return to_tracker_frame(problem, points)


def predict_poses(calibration: Calibration, data: Measurements) -> Measurements:
    """Return planned rows where the real arm has the target, whatever an instrument would measure
    wrongly: its positions, and its orientations where the rows have any, or the study measured some."""
    calibration = leave_out_instrument(calibration)
    if data.rotation is None and calibration.tool_rotations is not None:
        identities = np.tile(np.eye(3), (len(data), 1, 1))
        data = replace(data, rotation=identities)
    problem = calibration.problem(data)
    pose = compute_pose(problem, calibration.terms, calibration.theta)
    position = to_tracker_frame(problem, pose.target.T)
    if data.rotation is None:
        return replace(data, position=position)
    rotations = problem.placement[0][problem.data.group]
    turned = np.einsum("mij,jkm->mik", rotations, pose.rotation)
    return replace(data, position=position, rotation=turned)


def measure_turn(calibration: Calibration, problem: Problem) -> float | None:
    """Measure the rms angle [rad] between measured orientations and those of the calibrated robot; None
    where none are measured."""
    if problem.data.rotation is None:
        return None
    left = residuals(problem, calibration.terms, calibration.theta)
    squares = np.square(left[:, 3:])
    mean_square = squares.sum(1).mean()
    return float(np.sqrt(mean_square))


def propagate_uncertainty(calibration: Calibration, problem: Problem) -> Array:
    """Propagate the parameters' covariance to the predicted positions.

    Returns factors (m, 3, r) [mm]: a row's covariance is factor factorᵀ, measuring noise left out.
    """
    terms = calibration.terms
    factor = calibration.factor
    moved = compute_sensitivities(calibration, problem, terms, factor)
    return moved[:, :3]


def compute_sensitivities(
    calibration: Calibration, problem: Problem, terms: Sequence[Term], factor: Array | None = None
) -> Array:
    """Compute how far the calibrated robot's target moves by one of each term (m, c, p) [mm], and
    where rows have orientations turns [rad]; with a `factor` (p, r), by one of each of its columns
    (m, c, r)."""
    if factor is None:
        count = len(terms)
        factor = np.eye(count)
    own = calibration.terms
    theta = calibration.theta
    width = factor.shape[1]
    row_count = len(problem)
    components = problem.components
    shape = (row_count, components, width)
    moved = np.empty(shape)
    for rows in problem.blocks(BLOCK_ROWS):
        twist = twist_of(problem, own, theta, rows)
        pose = problem.pose(rows, twist)
        field = field_of(problem, pose, rows)
        columns = compute_columns(problem, field, terms, rows)
        moved[rows] = np.einsum("pcm,pr->mcr", columns, factor)
    return moved
