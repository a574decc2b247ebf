"""Read what a study names: its file, the nominal robot, the measurements, the mechanisms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..config.study_file import Study, find_source, read_study
from ..exceptions import StudyError
from ..measurements.measurements import Measurements
from ..measurements.observation_columns import KnownFeature, apply_known_features
from ..measurements.reader import read_labels, read_measurements
from ..mechanisms.registry import (
    Registry,
    build_faults,
    build_mechanisms,
    every,
    mechanism,
    set_reference,
)
from ..mechanisms.terms import Mechanism, unstorable
from ..robot.files import load, read_robot
from ..robot.kinematics import Robot


def open_study(study: Study | Path | str, folder: Path | str | None) -> tuple[Study, Path]:
    """Return a study and the folder of its files.

    The folder is the given one, else that of the study's own file, else the current one. Raises
    StudyError.
    """
    if isinstance(study, Study):
        return study, Path(folder or ".")
    path = Path(study)
    if folder is not None:
        return read_study(path), Path(folder)
    return read_study(path), path if path.is_dir() else path.parent


def read_nominal_robot(study: Study, folder: Path) -> Robot:
    """Return the study's nominal robot: given, built in, or read from a file. Raises StudyError."""
    table = study.robot
    if table.nominal is not None:
        return table.nominal
    if table.name is not None:
        return load(table.name)
    return read_robot(folder / str(table.file), table.base, table.tip)


def read_known_features(study: Study) -> dict[str, KnownFeature]:
    """Return what the study states about each feature (anchor, sphere, plane …), by name."""
    known = {}
    for name, table in study.measurements.features.items():
        known[name] = KnownFeature(
            position=_as_vector(table.position_mm),
            normal=_as_vector(table.normal),
            length=table.length_mm,
            estimate=table.estimate,
            zero=table.zero == "unknown",
        )
    return known


def _as_vector(values: list[float] | None) -> tuple[float, float, float] | None:
    if values is None:
        return None
    x, y, z = values
    return x, y, z


def check_names(study: Study, robot: Robot, registry: Registry) -> None:
    """Check that every mechanism a study names exists, applies to the robot and can be stored.

    With `candidates = "all"` every mechanism of the registry must be storable. Raises StudyError
    with all problems at once.
    """
    names_at = [("model.base", study.model.base)]
    names_at += [("model.ladder", rung) for rung in study.model.ladder]
    if study.model.candidates != "all":
        names_at.append(("model.candidates", list(study.model.candidates)))
    problems: list[str] = []
    for place, names in names_at:
        for name in names:
            problems += _find_name_problems(place, name, robot, registry)
    if study.model.candidates == "all":
        for candidate in every(robot, registry):
            problems += _find_storage_problems(candidate.name, candidate)
    if problems:
        raise StudyError(*dict.fromkeys(problems))


def _find_name_problems(place: str, name: str, robot: Robot, registry: Registry) -> list[str]:
    try:
        named = mechanism(name, robot, registry)
    except StudyError as error:
        return [f"{place}: {error}"]
    return _find_storage_problems(name, named)


def _find_storage_problems(name: str, named: Mechanism) -> list[str]:
    reason = unstorable(named)
    return [] if reason is None else [f"{name}: {reason}"]


def list_candidates(study: Study, robot: Robot, registry: Registry) -> tuple[Mechanism, ...]:
    """Return the mechanisms that may extend the base, one per joint.

    Data faults come first: of exact twins the first is named.
    """
    if study.model.candidates in ("all", []):
        return (*build_faults(robot), *every(robot, registry))
    listed: list[Mechanism] = []
    for name in study.model.candidates:
        listed += build_mechanisms(name, robot, registry)
    return tuple(dict.fromkeys(listed))


def read_inputs(
    study: Study, folder: Path, registry: Registry
) -> tuple[Robot, Registry, Measurements, NDArray[np.object_] | None]:
    """Read the robot, the measurements and the split's labels, and check the names of a study.

    The registry comes back with its temperatures counted from the measurements' reference. The
    labels (m,) are None where no column says which rows estimate. Raises StudyError or DataError.
    """
    robot = read_nominal_robot(study, folder)
    check_names(study, robot, registry)
    source = find_source(study, folder)
    measured = read_measurements(source, robot.prismatic, study.measurements.columns)
    measured = apply_known_features(measured, read_known_features(study))
    registry = set_reference(registry, measured.reference_celsius)
    labels = None
    if study.split.column is not None:
        labels = read_labels(source, study.split.column)[measured.row]
    return robot, registry, measured, labels
