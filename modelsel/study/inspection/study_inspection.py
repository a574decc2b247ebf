"""Describe a study's measurements with its own tool and registration: what `modelsel check` says of
a study is what `modelsel study` does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...config.study_file import Study
from ...exceptions import DataError, NotEstimable, StudyError
from ...fitting.component_noise import POSITION
from ...fitting.design import residuals
from ...fitting.problem import Problem
from ...mechanisms.registry import BUILTIN, Registry
from ...notices import SETUP_MISTAKE, Note, list_alarms
from ...results.conclusions.placements import locate_placements
from ...robot.kinematics import Robot
from ..inputs.found_problems import FoundProblems, name_study_file
from ..inputs.inputs import read_checked, read_nominal_robot
from ..models.model_ladder import build_model
from ..models.rehearsed_folds import rehearse_folds
from ..preparation.preparation import prepare
from .inspection import describe_determined, inspect_measurements

GEOMETRY = ("geometric",)


def inspect_study(study: Study, folder: Path, registry: Registry = BUILTIN) -> dict[str, Any]:
    """Describe the measurements of a study, as `inspect_measurements` does, and its robot as the
    study has it stand before them, or why it is refused and with which exit status. Raises StudyError
    or DataError where the robot or the measurements cannot be read."""
    found = FoundProblems(study.file_name)
    robot: Robot | None = None
    with found.of_robot():
        robot = read_nominal_robot(study, folder)
    measured, labels, registry = read_checked(study, folder, robot, registry, found)
    if measured is None:
        found.refuse()
    assert robot is not None
    assert measured is not None
    inspected = inspect_measurements(robot, measured)
    try:
        found.refuse()
        with name_study_file(study.file_name):
            split, _, notes = prepare(study, robot, measured, labels)
            _, folds = rehearse_folds(study, split, notes, registry)
    except (StudyError, DataError, NotEstimable) as error:
        refused = str(error).splitlines()
        return inspected | {"study": {"refused": refused, "exit": error.exit_code}}
    problem = split.problem
    model = build_model(study, problem, BUILTIN, GEOMETRY)
    estimating = problem.take(split.estimation)
    determined = describe_determined(estimating, model)
    determined["geometry"]["tool_mm"] = None
    placed = _describe_nominal(study, problem, notes)
    is_registered = bool(study.robot.register_)
    stands = {"refused": None, "exit": 0, "registered": is_registered, "nested_folds": folds}
    described: dict[str, Any] = {"study": {**stands, **placed}}
    if is_registered:
        described["registered"] = placed
    return inspected | determined | described


def _describe_nominal(study: Study, problem: Problem, notes: tuple[Note, ...]) -> dict[str, Any]:
    """Describe where a study has the tracker and the targets, and how far its points are from the
    nominal robot there."""
    points = problem.take(problem.data.points)
    residual = residuals(points)
    distances = np.linalg.norm(residual[:, POSITION], axis=1)
    median = float(np.median(distances)) if len(distances) else None
    mistakes = [note.sentence for note in notes if note.code == SETUP_MISTAKE]
    return {
        "median_mm": median,
        **locate_placements(problem, study.robot.per_group),
        "mistake": mistakes[0] if mistakes else None,
        "alarms": list_alarms(notes),
    }
