"""Whether the direction of gravity is known, and whether it can be right where the robot was found to
stand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...exceptions import sentence_list, write_percent
from ...fitting.least_squares import Fit
from ...fitting.problem import Problem
from ...fitting.shrinkage import fit_shrunk
from ...measurements.campaign.state_names import needs_gravity
from ...mechanisms.terms import Mechanism
from ...notices import Note
from ...results.runs.finding_records import Finding
from ...robot.kinematics import Robot
from ...setup.other_gravity import OtherGravity, find_other_gravity, fits_better

UPWARDS, ELSEWHERE = "gravity-upwards", "gravity-elsewhere"
# from the z axis of the measurements' frame, within which gravity is said to point along it
NEAR_ANGLE = np.radians(10.0)
# of a direction's components: closer to 0 or 1 they are written as these
ROUND = 0.02


def note_gravity(robot: Robot, problem: Problem, is_stated: bool) -> list[Note]:
    """Return the warning about gravity that is not known, or that points upwards in the frame of the
    measurements; of gravity that the study states (`is_stated`) nothing."""
    if robot.gravity is None:
        return [
            Note(
                "gravity-unknown",
                f"The robot file of {robot.name} gives no direction of gravity: mechanisms that need "
                "it are left out. For an upright robot write gravity = [0, 0, -1] under [robot] in "
                "the study file.",
            )
        ]
    upwards = None if is_stated else describe_upward_gravity(robot, problem)
    return [] if upwards is None else [Note(UPWARDS, upwards)]


def describe_upward_gravity(robot: Robot, problem: Problem) -> str | None:
    """Say that the robot's gravity points along +z of the measurements' frame, in which z usually
    points up; None where it does not. The problem has its placement."""
    if robot.gravity is None:
        return None
    R = problem.placement[0][0]
    direction = R @ np.array(robot.gravity)
    angle = float(np.arccos(np.clip(direction[2], -1.0, 1.0)))
    if angle > NEAR_ANGLE:
        return None
    down = write_direction(-R[2])
    given = write_direction(robot.gravity)
    return (
        f"Gravity is {given} in the robot's base frame, and so points along +z of the measurements' "
        f"frame ({np.degrees(angle):.2g}° from it). If that z axis points up, as it does for a "
        f"levelled instrument, the robot's gravity is {down}: write gravity = {down} under [robot] in "
        f"the study file (modelsel init: --gravity {down.strip('[]').replace(',', '')}). If it points "
        f"down, write gravity = {given} there to confirm it. Mechanisms of weight are wrong otherwise."
    )


def note_other_gravity(
    problem: Problem,
    fitted: Fit,
    found: Sequence[Mechanism],
    explained: Fit,
    notes: Sequence[Note],
    is_stated: bool,
) -> list[Note]:
    """Return the warning that joints wind up as if gravity had another direction, beside a fitted base
    and beside what of the mechanisms that were `found` does not depend on it; nothing where all that was
    found, fitted (`explained`), is as good an explanation, where the study states the direction
    (`is_stated`), or where the `notes` question it already."""
    is_questioned = any(note.code == UPWARDS for note in notes)
    if is_stated or is_questioned:
        return []
    other = _find_unexplained(problem, fitted, found, explained)
    if other is None:
        return []
    direction = write_direction(other.direction)
    given = write_direction(problem.robot.gravity or ())
    share = write_percent(other.left)
    numbers = sentence_list([str(joint) for joint in other.joints])
    joints = f"Joint {numbers} winds up" if len(other.joints) == 1 else f"Joints {numbers} wind up"
    sentence = (
        f"{joints} as if gravity were {direction} in the robot's base frame, not {given}: with the former, compliance "
        f"leaves {share} of the error that it leaves with the latter. If the robot stands like that, "
        f"write gravity = {direction} under [robot] in the study file; if it does not, write gravity = {given} "
        "there to confirm it. Findings that depend on gravity are wrong otherwise."
    )
    return [Note(ELSEWHERE, sentence)]


def _find_unexplained(
    problem: Problem, fitted: Fit, found: Sequence[Mechanism], explained: Fit
) -> OtherGravity | None:
    """Find the other direction of gravity that joints ask for beside a fitted base, and beside what of
    the registered mechanisms that were `found`, or of all that explains the data, does not depend on
    it; None where what is `explained` fits better than this does."""
    if find_other_gravity(problem, fitted) is None:
        return None
    # a joint that turns too far or too little resembles one that winds up
    registered = _list_without_gravity(found)
    beyond = [one for one in explained.model.mechanisms if one not in fitted.model.mechanisms]
    every = _list_without_gravity(beyond)
    for beside in dict.fromkeys((registered, every)):
        extended = fitted
        if beside:
            extended = fit_shrunk(problem, fitted.model + beside, fitted)
        other = find_other_gravity(problem, extended)
        if other is None:
            return None
        if not fits_better(problem, explained, other):
            return other
    return None


def _list_without_gravity(found: Sequence[Mechanism]) -> tuple[Mechanism, ...]:
    """List the mechanisms that do not depend on gravity."""
    return tuple(one for one in found if not any(map(needs_gravity, one.names())))


def doubt_gravity(
    findings: Sequence[Finding], notes: Sequence[Note], robot: Robot
) -> tuple[Finding, ...]:
    """Add to findings that depend on gravity that they hold for its stated direction only, where
    `notes` question that."""
    is_questioned = any(note.code in (UPWARDS, ELSEWHERE) for note in notes)
    if not is_questioned:
        return tuple(findings)
    given = write_direction(robot.gravity or ())
    condition = f"This holds only if gravity is {given} in the robot's base frame, which the warnings question."
    doubted = []
    for finding in findings:
        names = finding.effect.candidate.mechanism.names()
        depends = any(map(needs_gravity, names))
        doubted.append(replace(finding, condition=condition) if depends else finding)
    return tuple(doubted)


def write_direction(direction: Sequence[float] | np.ndarray) -> str:
    """Write a direction as a study file has it: whole numbers where it is along an axis."""
    values = np.asarray(direction, float)
    near = np.abs(values - values.round()) < ROUND
    rounded = np.where(near, values.round(), values.round(3)) if near.all() else values.round(3)
    return f"[{', '.join(f'{value + 0.0:g}' for value in rounded)}]"
