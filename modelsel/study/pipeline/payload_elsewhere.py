"""Whether a payload hangs elsewhere than at the target: where one joint that yields under it would have it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..._linalg import TINY
from ..._typing import Array
from ...exceptions import NotEstimable, write_rounded
from ...fitting.design import Model
from ...fitting.least_squares import Fit
from ...fitting.problem import Problem
from ...fitting.shrinkage import fit_shrunk
from ...mechanisms.causes import Cause, Named, Number
from ...mechanisms.compliance import COMPLIANCE, DECLARED, PAYLOAD, joint_compliance
from ...mechanisms.motors import (
    find_gravity_motors,
    find_payload_motors,
    is_coupled,
    knows_held_masses,
    motor_torque,
)
from ...mechanisms.terms import Mechanism, Screw, Term
from ...notices import Note
from .trial_columns import measure_left, widen_rows

# names of the torque [N m/kg] about a joint of 1 kg at the flange, and of what it gains by each mm along an axis
AT_FLANGE = "held_at_flange"
FURTHER = "held_further_x", "held_further_y", "held_further_z"
# mm along an axis, by which the latter is taken
STEP_MM = 100.0
# by how much the Bayesian information criterion must be lower, over all joints that are tried
CLEAR = 20.0
# mm: less well known places are not told
VAGUE_MM = 100.0
# mm: usual places are no farther from the flange
FAR_MM = 1000.0


class Place(NamedTuple):
    """Where a payload would hang (3,) [mm, flange frame] under a joint that yields, with its largest standard
    error; the fit that has it so, and by how much its criterion is lower than those of the chosen model and of
    the payload at the target."""

    joint: int
    mm: Array
    error_mm: float
    fitted: Fit
    gain: float


def payload_elsewhere_notes(problem: Problem, fitted: Fit) -> tuple[Note, ...]:
    """Return the warning that payloads seem to hang elsewhere than at the target; `fitted`: the chosen model,
    to the rows of `problem`."""
    robot = problem.robot
    payload = problem.data.covariates.get(PAYLOAD)
    if payload is None or np.ptp(payload) == 0:
        return ()
    if problem.data.gauges is not None:  # lengths between rows have no place of their own
        return ()
    if robot.gravity is None or robot.payload_at_mm is not None:
        return ()
    places = _generate_places(problem, fitted)
    best = max(places, key=lambda one: one.gain, default=None)
    if best is None or best.gain < CLEAR:
        return ()
    left = measure_left(problem, fitted)
    before = write_rounded(left)
    levers = _add_levers(problem, best.joint)
    left = measure_left(levers, best.fitted)
    after = write_rounded(left)
    where = "elsewhere on the flange than at the target"
    if best.error_mm < VAGUE_MM:
        rounded = best.mm.round().astype(int).tolist()
        listed = ", ".join(map(str, rounded))
        where = (
            f"at [{listed}] mm in the flange frame (± {best.error_mm:.0f} mm), not at the target,"
        )
    sentence = (
        f"Joint {best.joint} that yields under a payload {where} would leave {after} mm rms on the estimation rows, where "
        f"{before} mm are left. If payloads hang elsewhere, say where (payload_at_mm in [robot]) and run the study again."
    )
    return (Note("payload-elsewhere", sentence),)


def _generate_places(problem: Problem, fitted: Fit) -> Iterator[Place]:
    """Generate where each joint would have the payload hang."""
    robot = problem.robot
    for joint in find_payload_motors(robot):
        if robot.prismatic[joint - 1] or is_coupled(robot, joint):
            continue
        place = _find_place(problem, fitted, joint)
        if place is not None:
            yield place


def _find_place(problem: Problem, fitted: Fit, joint: int) -> Place | None:
    """Find where a joint would have the payload hang, beside what does not depend on the payload; None where
    the data do not determine a model."""
    robot = problem.robot
    own = joint_compliance(robot, joint, DECLARED)
    kept = []
    for one in fitted.model.mechanisms:
        names = one.names()
        if PAYLOAD not in names and one.name != own.name:
            kept.append(one)
    held: Cause = Number(0.0)
    if knows_held_masses(robot, joint):
        held = motor_torque(robot, joint)
    elif joint in find_gravity_motors(robot):
        kept.append(own)
    payload = Named(PAYLOAD, "kg")
    body = robot.n + 1
    at_target = payload * motor_torque(robot, joint, body)
    at_flange = payload * Named(AT_FLANGE)
    further = [payload * Named(name) for name in FURTHER]
    there = _build_spring(joint, [held + at_target])
    anywhere = _build_spring(joint, [held + at_flange, *further])
    levers = _add_levers(problem, joint)
    fits = []
    for spring in (there, anywhere):
        model = Model((*kept, spring))
        try:
            refitted = fit_shrunk(levers, model, fitted, held="nothing")
        except NotEstimable:
            return None
        fits.append(refitted)
    hung, found = fits
    before = _compute_criterion(fitted)
    at_best = _compute_criterion(hung)
    after = _compute_criterion(found)
    gain = min(before, at_best) - after
    mm, error_mm = _locate(found, anywhere)
    stiffness, *_ = found.theta[found.locate(anywhere)]
    if stiffness < 0 and np.isfinite(error_mm):  # no spring gives way against its load
        return None
    return Place(joint, mm, error_mm, found, gain)


def _locate(fitted: Fit, spring: Mechanism) -> tuple[Array, float]:
    """Return where a payload hangs (3,) [mm, flange frame] under a spring that has it anywhere, with the largest
    standard error: infinite where the data leave its place open."""
    terms = fitted.locate(spring)
    theta, covariance = fitted.theta[terms], fitted.covariance[np.ix_(terms, terms)]
    stiff, along = theta[0], theta[1:]
    if not set(terms) <= set(fitted.representatives):
        return along, np.inf
    mm = along / stiff
    slope = np.column_stack([-mm, np.eye(3)]) / stiff
    spread = slope @ covariance @ slope.T
    return mm, float(np.sqrt(np.diagonal(spread).max()))


def _build_spring(joint: int, causes: Sequence[Cause]) -> Mechanism:
    """Build a joint that yields to a torque, and to what it gains with the payload's place."""
    low, high = COMPLIANCE
    usual = COMPLIANCE
    terms = []
    for number, cause in enumerate(causes):
        screw = Screw(joint, "rz", cause)
        term = Term(f"p{number}", (screw,), usual)
        terms.append(term)
        # times the place [mm]
        usual = low, high * FAR_MM
    return Mechanism("payload-elsewhere", tuple(terms), "", "", "")


def _add_levers(problem: Problem, joint: int) -> Problem:
    """Add to the measurements what a payload's torque about a joint is made of."""
    origin = np.zeros(3)
    at_flange = _measure_torque(problem, joint, origin)
    columns = {AT_FLANGE: at_flange}
    steps = STEP_MM * np.eye(3)
    for name, step in zip(FURTHER, steps, strict=True):
        torque = _measure_torque(problem, joint, step)
        gained = torque - at_flange
        columns[name] = gained / STEP_MM
    return widen_rows(problem, columns)


def _measure_torque(problem: Problem, joint: int, place: Array) -> Array:
    """Measure the torque (m,) [N m/kg] about a joint of 1 kg at a place (3,) [mm] on the flange."""
    robot = problem.robot
    x, y, z = place.tolist()
    hung = replace(robot, payload_at_mm=(x, y, z))
    at = replace(problem, robot=hung)
    body = robot.n + 1
    return at.value(f"torque{joint}_{body}")


def _compute_criterion(fitted: Fit) -> float:
    """Compute the Bayesian information criterion of a fit."""
    rows = fitted.rows
    variance = max(fitted.rss / rows, TINY)
    price = fitted.rank * np.log(rows)
    return float(rows * np.log(variance) + price)
