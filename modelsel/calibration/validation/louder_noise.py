"""New data that are louder than the noise of a calibration: with a pattern the arm or the set-up
changed, without one the noise did."""

from __future__ import annotations

import numpy as np

from ..._linalg import orthonormal_basis, project_out
from ..._typing import Array
from ...fitting.noise import Floor
from ...fitting.noise_check import CLEARLY_TOO_LARGE, lack
from ...fitting.problem import Problem
from ...mechanisms.causes import Named
from ...mechanisms.terms import Screw, Term
from ...robot.kinematics import Robot
from ...robot.rigid import AXES
from ..calibration import Calibration
from ..expected_noise import MIN_FACTOR
from ..prediction import compute_sensitivities
from .drift_statistic import compute_ratio_p, compute_statistic

MIN_FREEDOM = 30  # coordinates beyond what changes could explain: with fewer it is not told
MIN_P = 0.05  # of what changes explain, above which they explain nothing


def is_louder_noise(
    c: Calibration, at: Problem, residual: Array, spread: Array, floor: Floor, free: Array
) -> bool:
    """Whether residuals (m, 3) [mm] are beyond the noise that is expected (`floor`) and have no
    pattern.

    What any change of the set-up, the geometry, the model's effects or a joint's play leaves is the
    noise that the data have of their own. It is louder, and with it they agree with the calibration,
    whose uncertainty has the factors `spread` (m, 3, r) [mm]; `free` (m, 3, k): what was fitted."""
    measured = measure_own_noise(c, at, residual, free)
    if measured is None:
        return False
    own, freedom = measured
    expected = floor.coordinate_mm
    louder = lack(floor, own / expected, freedom)
    if not louder.outside:
        return False
    if louder.factor < MIN_FACTOR:
        return False
    test = compute_statistic(residual / own, spread / own, free)
    count = test.count - freedom
    if not count:  # whatever may change was fitted
        return True
    explained = test.T - freedom
    p = compute_ratio_p(count, freedom, explained / count)
    return p > MIN_P


def find_quieter_noise(
    c: Calibration, at: Problem, residual: Array, floor: Floor, free: Array
) -> tuple[float, int] | None:
    """Return the noise [mm] that new data have of their own, and its degrees of freedom, where it is
    far below the one that the study measured (`floor`); None where it is not, or was stated."""
    if np.isinf(floor.freedom):
        return None
    measured = measure_own_noise(c, at, residual, free)
    if measured is None:
        return None
    own, freedom = measured
    quieter = lack(floor, own / floor.coordinate_mm, freedom)
    is_far = quieter.outside and quieter.factor < 1 / CLEARLY_TOO_LARGE
    return measured if is_far else None


def measure_own_noise(
    c: Calibration, at: Problem, residual: Array, free: Array
) -> tuple[float, int] | None:
    """Measure the noise [mm] of a coordinate that no change explains in residuals (m, 3) [mm]:
    (noise, degrees of freedom); None where too few are left."""
    basis = _span_changes(c, at, free)
    flat = residual.ravel()
    left = project_out(flat, basis)
    rank = basis.shape[1]
    freedom = len(left) - rank
    if freedom < MIN_FREEDOM:
        return None
    squares = np.square(left)
    variance = squares.sum() / freedom
    return float(np.sqrt(variance)), freedom


def _span_changes(c: Calibration, at: Problem, free: Array) -> Array:
    """Span (3 m, r) what any change moves, beside what was fitted, `free` (m, 3, k)."""
    changes = _list_changes(c.robot)
    anywhere = compute_sensitivities(c, at, changes)
    calibrated = compute_sensitivities(c, at, c.terms)
    columns = np.concatenate([free, anywhere[:, :3], calibrated[:, :3]], 2)
    _, _, width = columns.shape
    matrix = columns.reshape(-1, width)
    return orthonormal_basis(matrix)


def _list_changes(robot: Robot) -> list[Term]:
    """List what may change of any arm: every constant of its frames, with which the base and the
    target move too, and every joint's play."""
    screws = []
    frames = range(1, robot.n + 2)
    for frame in frames:
        for axis in AXES:
            screw = Screw(frame, axis)
            screws.append(screw)
    for joint, slides in enumerate(robot.prismatic, 1):
        axis = "tz" if slides else "rz"
        side = Named(f"approach{joint}")
        screw = Screw(joint, axis, side)
        screws.append(screw)
    return [Term("", (screw,)) for screw in screws]
