"""The arm as each finding errs most: where its joints stand there, what moves, and how far the
target goes."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..._typing import Array
from ...mechanisms.terms import Term
from ...robot.kinematics import Pose, Robot
from ...robot.rigid import AXES, align_z
from ..conclusions.finding_figures import bind_findings, find_worst
from ..numbers.quantities import MILLI
from ..numbers.workspace import Fitted
from ..runs.study_run import StudyRun

Values = dict[str, Any]


def describe_postures(run: StudyRun) -> list[Values | None]:
    """Return one posture per finding of result.json; None of a fault of single rows."""
    faults: list[Values | None] = [None] * len(run.diagnosis.faults)
    if not run.diagnosis.findings:
        return faults
    return faults + [_describe_posture(fitted) for fitted in bind_findings(run)]


def _describe_posture(fitted: Fitted) -> Values:
    """Describe the nominal arm where an effect moves the target most: origins (n+2, 3) [mm] of frame
    0, the joints and the target, the target's displacement (3,) [mm], and the axes (3,) that the
    effect moves along or about, all in frame 0 turned upright. Of an effect that only turns the
    target, where it turns it most."""
    only_turns = fitted.workspace.oriented and find_worst(fitted).moved.value == 0
    row = fitted.find_worst_turn() if only_turns else fitted.find_worst()
    problem = fitted.workspace.problem.take(np.array([row]))
    pose = problem.pose(slice(None))
    rotation = problem.placement[0][problem.data.group[0]]
    upright = stand_upright(problem.robot)
    origins = np.concatenate([np.zeros((1, 3)), pose.origins[:, :, 0]])
    moved = upright @ rotation.T @ fitted.moved()[:, row]
    posture = {
        "origins_mm": (np.round(origins @ upright.T, 1) + 0.0).tolist(),
        "moved_mm": (np.round(moved, 5) + 0.0).tolist(),
        "places": [
            {"frame": frame, "axis": axis, "direction": _axis_direction(pose, upright, frame, axis)}
            for frame, axis in _list_places(fitted.terms)
        ],
    }
    if only_turns:
        posture["turned_mrad"] = MILLI * fitted.turned_at(row).value
    return posture


def _list_places(terms: tuple[Term, ...]) -> list[tuple[int, str]]:
    """Return the frames and axes of all screws, each once."""
    places = {(screw.frame, screw.axis) for term in terms for screw in term.screws}
    return sorted(places)


def _axis_direction(pose: Pose, upright: Array, frame: int, axis: str) -> list[float]:
    direction = upright @ pose.axes[frame - 1, AXES.index(axis), :, 0]
    rounded: list[float] = (np.round(direction, 5) + 0.0).tolist()
    return rounded


def stand_upright(robot: Robot) -> Array:
    """Return the rotation (3, 3) that takes gravity to -z; identity where it is not known."""
    if robot.gravity is None:
        return np.eye(3)
    return align_z(-np.array(robot.gravity)).T
