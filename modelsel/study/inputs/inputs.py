"""Read what a study names: its file, the nominal robot, the measurements, the mechanisms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..._files import STUDY_FILE
from ...config.readable_part import ReadablePart
from ...config.study_file import Study, find_data, find_source, read_study
from ...exceptions import StudyError, count_words
from ...fitting.problem import Problem
from ...measurements.campaign.clock_history import find_lags
from ...measurements.campaign.reference_temperature import TEMPERATURE
from ...measurements.formats.table import load_table, rename_columns
from ...measurements.formats.text_table import check_file
from ...measurements.known_features import KnownFeature, apply_known_features
from ...measurements.measurements import Measurements
from ...measurements.reader import read_labels, read_measurements
from ...mechanisms.campaign_registry import (
    set_gear_ratios,
    set_reference,
    set_targets,
    waits_for_targets,
)
from ...mechanisms.cause_formulas import list_members
from ...mechanisms.registry import (
    BUILTIN,
    Registry,
    build_faults,
    build_mechanisms,
    every,
    mechanism,
)
from ...mechanisms.terms import Mechanism, unstorable
from ...results.reading import read_records
from ...robot.files import load_robot
from ...robot.kinematics import Robot
from ..preparation.own_causes import (
    check_own_causes,
    describe_columns,
    find_own_name_problems,
    list_own_names,
    list_own_words,
)
from ..preparation.preparation import arrange_tools
from ..preparation.row_selection import check_split
from ..tables.robot_tables import read_any_robot
from .found_problems import FoundProblems
from .listed_names import list_named_mechanisms, list_unknown_mechanisms
from .noise_parts import check_parts
from .planted_effects import list_formula_problems, list_frame_problems, list_name_problems
from .stated_setup import point_gravity

# turns of a motor per turn of its joint, at most
MAX_GEAR_RATIO = 1000.0


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
    if table.gravity is not None:
        robot = point_gravity(robot, table.gravity)
    if table.payload_at_mm is None:
        return robot
    x, y, z = table.payload_at_mm
    return replace(robot, payload_at_mm=(x, y, z))


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
    takes_all = study.model.candidates == "all"
    own_names = list_own_names(study)
    problems = find_own_name_problems(study, registry)
    for place, names in list_named_mechanisms(study):
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


def list_candidates(
    study: Study, robot: Robot, registry: Registry, unseen: Sequence[str] = ()
) -> tuple[Mechanism, ...]:
    """Return the mechanisms that may extend the base, one per joint, without the names `unseen`.

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
        if name in own_names or name in unseen:
            continue
        listed += build_mechanisms(name, robot, registry)
    distinct = dict.fromkeys(listed)
    return tuple(distinct)


def read_inputs(
    study: Study, folder: Path, registry: Registry
) -> tuple[Robot, Registry, Measurements, NDArray[np.object_] | None]:
    """Read the robot, the measurements and the split's labels, and check the names of a study.

    The registry comes back with its temperatures counted from the measurements' reference. The
    labels (m,) are None where no column says which rows estimate. Raises StudyError or DataError,
    with all that is wrong with them.
    """
    found = FoundProblems(study.file_name)
    robot: Robot | None = None
    with found.of_robot():
        robot = read_nominal_robot(study, folder)
    measured, labels, registry = read_checked(study, folder, robot, registry, found)
    found.refuse()
    assert robot is not None
    assert measured is not None
    return robot, registry, measured, labels


def read_checked(
    study: Study, folder: Path, robot: Robot | None, registry: Registry, found: FoundProblems
) -> tuple[Measurements | None, NDArray[np.object_] | None, Registry]:
    """Read what a study measures and check all that it says, as far as its robot, None where there
    is none, lets it be read; what is wrong is added to `found`. Returns the measurements, the labels
    of the split and the registry with the study's gear ratios, and with the temperature and the
    targets of the measurements."""
    registry = _check_against_robot(study, robot, registry, found)
    measured: Measurements | None = None
    labels: NDArray[np.object_] | None = None
    with found.of_data():
        if robot is None:
            _check_table(study, folder)
        else:
            measured = _read_file(study, folder, robot)
    if measured is None and study.measurements.columns:
        with found.of_data():
            _check_table(study, folder)
    with found.of_data():
        labels = read_split_labels(study, folder, measured)
    if robot is not None and measured is not None:
        registry = set_targets(registry, measured.targets)
        lags = find_lags(measured.covariates.get(TEMPERATURE), measured.late_temperature)
        registry = set_reference(registry, measured.reference_celsius, lags)
        _check_against_data(study, robot, measured, labels, registry, found)
    return measured, labels, registry


def check_part(
    part: ReadablePart, folder: Path, registry: Registry, measured: bool, found: FoundProblems
) -> None:
    """Check what can be read of a study whose file has wrong values; whether its file must be
    `measured` already. What is wrong is added to `found`."""
    study = part.study
    robot: Robot | None = None
    if part.has_robot:
        with found.of_robot():
            robot = read_nominal_robot(study, folder)
    path = find_data(study.measurements.file, folder)
    is_there = part.has_file and path.is_file()
    if part.has_measurements and (measured or is_there):
        read_checked(study, folder, robot, registry, found)
        return
    _check_against_robot(study, robot, registry, found)
    if part.has_file and measured:
        with found.of_data():
            check_file(path)


def _check_table(study: Study, folder: Path) -> None:
    """Check that the measurements can be read as a table, and that it has the columns that the
    study maps. Raises DataError."""
    source = find_source(study, folder)
    table = load_table(source)
    rename_columns(table, study.measurements.columns)


def read_split_labels(
    study: Study, folder: Path, measured: Measurements | None
) -> NDArray[np.object_] | None:
    """Read the split's labels (m,) of the rows that are `measured`; None where no column has them.
    Raises DataError."""
    split_column = study.split.column
    if split_column is None:
        return None
    source = find_source(study, folder)
    file_labels = read_labels(source, split_column)
    return file_labels if measured is None else file_labels[measured.row]


def _check_against_robot(
    study: Study, robot: Robot | None, registry: Registry, found: FoundProblems
) -> Registry:
    """Check what a study says that depends on its robot, where there is one; return the registry
    with the gear ratios."""
    if robot is None:
        found.study += list_unknown_mechanisms(study, registry)
        found.study += list_formula_problems(study)
        return registry
    with found.of_study():
        registry = _use_gear_ratios(study, robot, registry)
    with found.of_study():
        check_mechanism_names(study, robot, registry)
    with found.of_study():
        check_parts(study, robot)
    found.study += list_frame_problems(study, robot)
    found.study += list_formula_problems(study)
    return registry


def _check_against_data(
    study: Study,
    robot: Robot,
    measured: Measurements,
    labels: NDArray[np.object_] | None,
    registry: Registry,
    found: FoundProblems,
) -> None:
    """Check what a study says that depends on its measurements."""
    with found.of_study():
        check_mechanism_names(study, robot, registry)
    with found.of_study():
        check_own_causes(study, robot, measured)
    with found.of_study():
        arrange_tools(study.robot, measured)
    with found.of_study():
        check_split(study.split, measured, labels)
    if study.simulate.effect:
        no_tools = np.zeros((len(measured.targets), 3))
        units = Problem(robot, measured, no_tools).names()
        members = list_members(len(measured.targets), len(measured.groups))
        columns = describe_columns(measured)
        found.study += list_name_problems(study, units, members, columns)


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


def _read_file(study: Study, folder: Path, robot: Robot) -> Measurements:
    """Read a study's measurements, with what it states of their features."""
    source = find_source(study, folder)
    columns = study.measurements.columns
    used = list_own_words(study)
    if study.split.column is not None:
        used.add(study.split.column)
    measured = read_measurements(source, robot, columns, used=used)
    known = read_known_features(study)
    return apply_known_features(measured, known)
