"""Read what a study names: its file, the nominal robot, the measurements, the mechanisms."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .._arguments import check_path
from .._files import STUDY_FILE
from ..config.study_file import Study, find_data, find_source, read_study
from ..exceptions import StudyError, count_words
from ..measurements.measurements import Measurements
from ..measurements.observation_columns import KnownFeature, apply_known_features
from ..measurements.reader import read_labels, read_measurements
from ..mechanisms.campaign_registry import (
    set_gear_ratios,
    set_reference,
    set_targets,
    waits_for_targets,
)
from ..mechanisms.registry import (
    BUILTIN,
    Registry,
    build_faults,
    build_mechanisms,
    every,
    mechanism,
)
from ..mechanisms.terms import Mechanism, unstorable
from ..results.reading import read_records
from ..robot.files import load_robot
from ..robot.kinematics import Robot
from .named_things import read_whole_study
from .noise_parts import check_parts
from .own_causes import check_own_causes, find_own_name_problems, list_own_names, list_own_words
from .planted_effects import list_formula_problems, list_frame_problems
from .robot_tables import read_any_robot
from .stated_setup import point_gravity

# turns of a motor per turn of its joint, at most
MAX_GEAR_RATIO = 1000.0


def open_study(study: Study | Path | str, folder: Path | str | None) -> tuple[Study, Path]:
    """Return a study and the folder of its files.

    The folder is the given one, else that of the study's own file, else the current one. Raises
    StudyError.
    """
    if folder is not None:
        folder = check_path(folder, "the folder of the study's files")
    if isinstance(study, Study):
        return study, folder or Path()
    path = check_path(study, "a Study, or the path of a study file or of its folder")
    read = read_whole_study(path)
    if folder is not None:
        return read, folder
    if path.is_dir():
        return read, path
    return read, path.parent


def find_study_file(path: Path) -> Path:
    """Find a study's file: the one given, that of a folder or, of a report's folder, that of the
    study of the same name beside it. Raises StudyError for a report whose study is not found."""
    if not path.is_dir():
        return path
    file = path / STUDY_FILE
    if file.exists() or not (path / "result.json").exists():
        return file
    written, _ = read_records(path)
    above = path.resolve().parent.parent
    name = path.resolve().name
    for folder in (Path(), Path("studies"), above, above / "studies"):
        candidate = folder / name / STUDY_FILE
        if candidate.exists() and read_study(candidate).name == written.study:
            return candidate
    raise StudyError(
        f"{path}: the folder of a report; the folder of its study, with study.toml, was expected, and "
        f'no study "{written.study}" was found in {name} or studies/{name}.'
    )


def list_input_files(study: Study, path: Path) -> list[Path]:
    """List the files that a study is read from: its own at `path`, the measurements, and the robot
    file where it has one."""
    folder = path.parent
    data = find_data(study.measurements.file, folder)
    files = [path, data]
    if study.robot.file is not None:
        files.append(folder / study.robot.file)
    return files


def read_nominal_robot(study: Study, folder: Path) -> Robot:
    """Return the study's nominal robot: given, built in, or read from a file. Raises StudyError."""
    table = study.robot
    robot = table.nominal
    if robot is None and table.name is not None:
        robot = load_robot(table.name)
    if robot is None:
        robot = read_any_robot(folder / str(table.file), table.base, table.tip)
    return robot if table.gravity is None else point_gravity(robot, table.gravity)


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


def check_mechanism_names(study: Study, robot: Robot, registry: Registry) -> None:
    """Check that every mechanism a study names exists, applies to the robot and can be stored. Steps
    of one target of several wait for the measurements, which name the targets.

    With `candidates = "all"` every mechanism of the registry must be storable; modelsel's own are.
    Raises StudyError with all problems at once.
    """
    model = study.model
    names_at = [("model.base", model.base)]
    names_at += [("model.ladder", rung) for rung in model.ladder]
    outcomes = list(study.search.outcomes)
    names_at.append(("search.outcomes", outcomes))
    takes_all = model.candidates == "all"
    if not takes_all:
        candidates = list(model.candidates)
        listed = "model.candidates", candidates
        names_at.append(listed)
    own_names = list_own_names(study)
    problems = find_own_name_problems(study, registry)
    for place, names in names_at:
        for name in names:
            if name in own_names or waits_for_targets(name, registry):
                continue
            problems += _find_name_problems(place, name, robot, registry)
    if takes_all:
        added = {name: entry for name, entry in registry.items() if BUILTIN.get(name) is not entry}
        for candidate in every(robot, added):
            problems += _find_storage_problems(candidate.name, candidate)
    if problems:
        distinct = dict.fromkeys(problems)
        raise StudyError(*distinct)


def _find_name_problems(place: str, name: str, robot: Robot, registry: Registry) -> list[str]:
    try:
        named = mechanism(name, robot, registry)
    except StudyError as error:
        return [f"{place}: {error}"]
    return _find_storage_problems(name, named)


def _find_storage_problems(name: str, named: Mechanism) -> list[str]:
    reason = unstorable(named)
    if reason is None:
        return []
    return [f"{name}: {reason}"]


def list_candidates(study: Study, robot: Robot, registry: Registry) -> tuple[Mechanism, ...]:
    """Return the mechanisms that may extend the base, one per joint.

    Data faults come first: of exact twins the first is named. What the study adds by [[covariate]]
    is not among them.
    """
    named = study.model.candidates
    if named in ("all", []):
        faults = build_faults(robot)
        registered = every(robot, registry)
        return (*faults, *registered)
    own_names = list_own_names(study)
    listed: list[Mechanism] = []
    for name in named:
        if name in own_names:
            continue
        listed += build_mechanisms(name, robot, registry)
    distinct = dict.fromkeys(listed)
    return tuple(distinct)


def read_inputs(
    study: Study, folder: Path, registry: Registry
) -> tuple[Robot, Registry, Measurements, NDArray[np.object_] | None]:
    """Read the robot, the measurements and the split's labels, and check the names of a study.

    The registry comes back with its temperatures counted from the measurements' reference. The
    labels (m,) are None where no column says which rows estimate. Raises StudyError or DataError.
    """
    robot = read_nominal_robot(study, folder)
    registry = _check_against_robot(study, robot, registry)
    measured = _read_file(study, folder, robot)
    check_own_causes(study, robot, measured)
    registry = set_reference(registry, measured.reference_celsius)
    registry = set_targets(registry, measured.targets)
    check_mechanism_names(study, robot, registry)
    labels = None
    split_column = study.split.column
    if split_column is not None:
        source = find_source(study, folder)
        file_labels = read_labels(source, split_column)
        labels = file_labels[measured.row]
    return robot, registry, measured, labels


def _check_against_robot(study: Study, robot: Robot, registry: Registry) -> Registry:
    """Check what a study says that depends on its robot; return the registry with the gear ratios.
    Raises StudyError with all problems at once."""
    problems: list[str] = []
    with _collect_problems(problems):
        registry = _use_gear_ratios(study, robot, registry)
    with _collect_problems(problems):
        check_mechanism_names(study, robot, registry)
    with _collect_problems(problems):
        check_parts(study, robot)
    problems += list_frame_problems(study, robot)
    problems += list_formula_problems(study)
    if problems:
        raise StudyError(*problems)
    return registry


@contextmanager
def _collect_problems(problems: list[str]) -> Iterator[None]:
    """Append the problems of a StudyError that is raised inside."""
    try:
        yield
    except StudyError as error:
        problems += error.problems


def _use_gear_ratios(study: Study, robot: Robot, registry: Registry) -> Registry:
    """Return the registry with the gear ratios that the study gives. Raises StudyError for another
    number of them than the robot has joints, and for one that is none."""
    ratios = study.robot.gear_ratios
    if ratios is None:
        return registry
    if len(ratios) != robot.n:
        raise StudyError(
            f"robot.gear_ratios: {len(ratios)} numbers, but {robot.name} has "
            f"{count_words(robot.n, 'joint')}. Give one "
            "for each, 0 where it is not known."
        )
    if not all(0 <= ratio <= MAX_GEAR_RATIO for ratio in ratios):
        raise StudyError(
            f"robot.gear_ratios: a ratio is 0 (not known) to {MAX_GEAR_RATIO:g} turns of the motor per "
            "turn of the joint. Correct it."
        )
    return set_gear_ratios(registry, ratios)


def read_study_measurements(study: Study, folder: Path) -> tuple[Robot, Measurements]:
    """Read the robot and the measurements of a study. Raises StudyError or DataError."""
    robot = read_nominal_robot(study, folder)
    return robot, _read_file(study, folder, robot)


def _read_file(study: Study, folder: Path, robot: Robot) -> Measurements:
    """Read a study's measurements, with what it states of their features."""
    source = find_source(study, folder)
    columns = study.measurements.columns
    used = list_own_words(study)
    if study.split.column is not None:
        used.add(study.split.column)
    measured = read_measurements(source, robot, columns, used=used)
    return apply_known_features(measured, read_known_features(study))
