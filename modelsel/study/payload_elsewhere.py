"""Whether a payload hangs elsewhere than at the target: where one joint that yields under it would have it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .._typing import Array
from ..exceptions import NotEstimable, write_rounded
from ..fitting.design import Model
from ..fitting.least_squares import Fit
from ..fitting.problem import Problem
from ..fitting.shrinkage import fit_shrunk
from ..mechanisms.causes import Cause, Named, Number
from ..mechanisms.compliance import COMPLIANCE, DECLARED, PAYLOAD, joint_compliance
from ..mechanisms.motors import (
    find_gravity_motors,
    find_payload_motors,
    is_coupled,
    knows_held_masses,
    motor_torque,
)
from ..mechanisms.terms import Mechanism, Screw, Term
from ..notices import Note

# names of the torque [N m/kg] about a joint of 1 kg at the flange, and of what it gains by each mm along an axis
AT_FLANGE, FURTHER = "held_at_flange", "held_further_{}"
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
    is_open = robot.gravity is not None and robot.payload_at_mm is None
    if payload is None or not is_open or np.ptp(payload) == 0:
        return ()
    best = max(_generate_places(problem, fitted), key=lambda one: one.gain, default=None)
    if best is None or best.gain < CLEAR:
        return ()
    before = write_rounded(_measure_left(problem, fitted))
    levers = _add_levers(problem, best.joint)
    after = write_rounded(_measure_left(levers, best.fitted))
    where = "elsewhere on the flange than at the target"
    if best.error_mm < VAGUE_MM:
        listed = ", ".join(f"{value:.0f}" for value in best.mm)
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
    kept = [
        one
        for one in fitted.model.mechanisms
        if PAYLOAD not in one.names() and one.name != own.name
    ]
    held: Cause = Number(0.0)
    if knows_held_masses(robot, joint):
        held = motor_torque(robot, joint)
    elif joint in find_gravity_motors(robot):
        kept.append(own)
    payload = Named(PAYLOAD, "kg")
    at_target = held + payload * motor_torque(robot, joint, robot.n + 1)
    further = [payload * Named(FURTHER.format(axis)) for axis in "xyz"]
    there = _build_spring(joint, [at_target])
    anywhere = _build_spring(joint, [held + payload * Named(AT_FLANGE), *further])
    levers = _add_levers(problem, joint)
    try:
        hung, found = (
            fit_shrunk(levers, Model((*kept, spring)), fitted, held="nothing")
            for spring in (there, anywhere)
        )
    except NotEstimable:
        return None
    least = min(_compute_criterion(one) for one in (fitted, hung))
    gain = least - _compute_criterion(found)
    return Place(joint, *_locate(found, anywhere), found, gain)


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
    sizes = [COMPLIANCE, *[(low, high * FAR_MM)] * 3]
    terms = tuple(
        Term(f"p{number}", (Screw(joint, "rz", cause),), size)
        for number, (cause, size) in enumerate(zip(causes, sizes, strict=False))
    )
    return Mechanism("payload-elsewhere", terms, "", "", "")


def _add_levers(problem: Problem, joint: int) -> Problem:
    """Add to the measurements what a payload's torque about a joint is made of."""

    def hang(place: Array) -> Array:
        x, y, z = place.tolist()
        at = replace(problem, robot=replace(problem.robot, payload_at_mm=(x, y, z)))
        return at.value(f"torque{joint}_{problem.robot.n + 1}")

    at_flange = hang(np.zeros(3))
    columns = {AT_FLANGE: at_flange}
    for axis, step in zip("xyz", STEP_MM * np.eye(3), strict=True):
        columns[FURTHER.format(axis)] = (hang(step) - at_flange) / STEP_MM
    data = problem.data
    return replace(problem, data=replace(data, covariates={**data.covariates, **columns}))


def _compute_criterion(fitted: Fit) -> float:
    """Compute the Bayesian information criterion of a fit."""
    rows = fitted.rows
    return float(rows * np.log(fitted.rss / rows) + fitted.rank * np.log(rows))


def _measure_left(problem: Problem, fitted: Fit) -> float:
    """Measure the rms length [mm] of what a fit leaves of the positions."""
    left = fitted.residuals(problem)[:, :3]
    return float(np.sqrt(np.square(left).sum(1).mean()))
