"""Mistakes in data that are held against a calibration: what no drift explains is said, and data that
cannot be of the arm are refused."""

from __future__ import annotations

import numpy as np

from ..._typing import Array, Mask
from ...diagnosis.faults.mistaken_rows import describe_slip_before_fit, describe_slips
from ...exceptions import DataError, NotEstimable
from ...fitting.problem import Problem
from ...setup.mistakes import FAR_SHARE, describe_setup_mistake
from ...setup.other_robots import describe_shifted_rows
from ...setup.plausibility import describe_implausible_distance
from ...setup.registration import register
from ..calibration import Calibration
from ..prediction import predict
from .reregistration import register_again

# share of the reach that a drifted arm leaves at most where rows of mistaken data are told from it
MAX_DRIFT_SHARE = 1e-3
REGISTER_AGAIN = (
    "If the instrument or the target was moved, --register finds them again and keeps the arm."
)
UNKNOWN_REASON = (
    "This looks like another arm, metres called millimetres, joints whose order, zero or sense is "
    "another than the study's, or positions that belong to other readings."
)


def check_near_arm(c: Calibration, at: Problem, residual: Array, free_setup: bool) -> None:
    """Check that new data are near the calibrated arm, after registration where asked
    (`free_setup`), or would be with it: then the set-up moved, which is a verdict and no mistake.
    `at`: the data at the calibrated set-up; `residual` (m, 3) [mm]. Raises DataError with the
    likeliest reason."""
    what = describe_implausible_distance(residual, at.reach_mm, "predicted")
    if what is None:
        return
    reasons: tuple[str, ...] = ()
    if not free_setup:
        every_row = np.ones(len(at), bool)
        reasons = describe_wrong_rows(c, at, residual, every_row)
    reasons = reasons or describe_wrong_setup(at, residual)
    if not reasons and not free_setup and _is_near_registered(c, at):
        return
    if reasons:
        what = (
            describe_implausible_distance(residual, at.reach_mm, "predicted", explained=True)
            or what
        )
    told_reasons = reasons or (UNKNOWN_REASON,)
    remedy = " ".join(told_reasons)
    raise DataError(what, remedy=remedy)


def describe_wrong_setup(at: Problem, residual: Array) -> tuple[str, ...]:
    """Describe the mistake in the readings or the positions of all rows that explains residuals
    (m, 3) [mm] far from the calibrated arm, wherever the tracker and the target are; empty where
    there is none. `at`: the data at the calibrated set-up."""
    lengths = np.linalg.norm(residual, axis=1)
    median = float(np.median(lengths))
    least = FAR_SHARE * at.reach_mm
    if median < least:
        return ()
    every_row = np.ones(len(at), bool)
    mistake = describe_setup_mistake(at, every_row, registered=True, links=False)
    if mistake is None:
        mistake = describe_shifted_rows(at, every_row)
    if mistake is None:
        return ()
    first, rest = mistake[0], mistake[1:]
    # its figures are of another set-up than the calibrated one
    return (f"Wherever the instrument and the target are, {first.lower()}{rest}",)


def describe_wrong_rows(
    c: Calibration, at: Problem, residual: Array, rows: Mask, expected_mm: float = 0.0
) -> tuple[str, ...]:
    """Describe the slips that explain some of the `rows` (mask) at the calibrated set-up.

    A corrected row fits where it is as near as the others: at the noise (`expected_mm`), or as far
    as an arm that changed."""

    def compute_residual(problem: Problem) -> Array:
        measured = problem.data.position
        predicted = predict(c, problem)
        return measured - predicted

    lengths = np.linalg.norm(residual, axis=1)
    median = float(np.median(lengths))
    largest = MAX_DRIFT_SHARE * at.reach_mm
    of_others = min(median, largest)
    usual = max(expected_mm, of_others)
    return describe_slips(at, compute_residual, rows, usual)


def describe_wrong_registered_rows(at: Problem) -> tuple[str, ...]:
    """Describe the slip of some rows where the tracker and the target are found from them.

    `at`: the data at the calibrated set-up."""
    every_row = np.ones(len(at), bool)
    try:
        registered = register(at, every_row, per_group=False)
    except (DataError, NotEstimable):
        return ()
    slip = describe_slip_before_fit(registered, registered=True)
    return () if slip is None else (slip,)


def _is_near_registered(c: Calibration, at: Problem) -> bool:
    """Return whether the data are near the arm with the tracker and the target found again."""
    try:
        registration = register_again(c, at)
    except (DataError, NotEstimable):
        return False
    problem = registration.problem
    residual = problem.data.position - predict(c, problem)
    lengths = np.linalg.norm(residual, axis=1)
    median = float(np.median(lengths))
    return median < FAR_SHARE * at.reach_mm
