"""Where a calibrated robot has its target, and how surely."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .._typing import Array
from ..fitting.design import compute_columns, field_of, twist_of
from ..fitting.problem import Problem
from ..mechanisms.terms import Term
from ..robot.kinematics import Pose

if TYPE_CHECKING:
    from .calibration import Calibration

BLOCK_ROWS = 512


def compute_pose(problem: Problem, terms: tuple[Term, ...], theta: Array) -> Pose:
    """Compute the exact chain of all rows at parameters theta, in frame 0."""
    rows = slice(0, len(problem))
    return problem.pose(rows, twist_of(problem, terms, theta, rows))


def to_tracker_frame(problem: Problem, points: Array) -> Array:
    """Transform points (m, 3) of frame 0 into the tracker's frame."""
    rotations, translations = problem.placement
    R, t = rotations[problem.data.group], translations[problem.data.group]
    return np.asarray(np.einsum("mij,mj->mi", R, points) + t)


def predict(calibration: Calibration, problem: Problem) -> Array:
    """Predict target positions (m, 3) [mm] of the calibrated robot in the tracker's frame."""
    pose = compute_pose(problem, calibration.terms, calibration.theta)
    return to_tracker_frame(problem, pose.target.T)


def propagate_uncertainty(calibration: Calibration, problem: Problem) -> Array:
    """Propagate the parameters' covariance to the predicted positions.

    Returns factors (m, 3, r) [mm]: a row's covariance is factor factorᵀ, measuring noise left out.
    """
    terms, theta = calibration.terms, calibration.theta
    factors = np.empty((len(problem), 3, calibration.factor.shape[1]))
    for rows in problem.blocks(BLOCK_ROWS):
        pose = problem.pose(rows, twist_of(problem, terms, theta, rows))
        field = field_of(problem, pose, rows)
        columns = compute_columns(problem, field, terms, rows)[:, :3]
        factors[rows] = np.einsum("pcm,pr->mcr", columns, calibration.factor)
    return factors
