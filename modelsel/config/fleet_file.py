"""The fleet file: TOML -> the studies of one job, and measurements in pieces; every problem of a
file is said at once."""

from __future__ import annotations

import os
import re
import shlex
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any
from unicodedata import normalize

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from .._files import STUDY_FILE
from .._names import find_name_problem
from .._text import parse_toml, read_text
from ..exceptions import StudyError, suggest
from .messages import describe_value_problem, format_place, to_toml_values
from .study_file import Study, find_data, read_study, refuse_measurements
from .study_tables import FileName, Name, Vector

# One part of a path on any system, not hidden, and not a name that Windows keeps for a device or
# the summary has.
FOLDER = re.compile(
    r"(?!(?:con|prn|aux|nul|(?:com|lpt)[0-9\xb9\xb2\xb3]|summary)(?:\.|$))"
    r"(?![. ])[^\x00-\x1f/\\:*?\"<>|]{1,200}(?<![. ])",
    re.IGNORECASE,
)
# tables of a study file that a fleet file does not have
STUDY_TABLES = {"robot", "measurements"}


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class StudyTable(_Table):
    """[[study]]: a study file, and settings that replace those in it."""

    file: FileName = Field(description="Study file, or its folder.")
    name: Name | None = Field(default=None, description="Name of its output folder.")
    measurements: FileName | None = Field(default=None, description="Another measurements file.")
    estimation: Annotated[int, Field(ge=1)] | None = Field(
        default=None, description="Another number of estimation configurations."
    )
    candidates: list[str] | None = Field(default=None, description="Other candidates.")
    seed: Annotated[int, Field(ge=0)] | None = Field(default=None, description="Another seed.")


class PartsTable(_Table):
    """[[parts]]: one measurement set in many Parquet files, fitted without holding all of it in
    memory."""

    name: Name = Field(description="Name of its output folder.")
    files: list[FileName] = Field(
        min_length=1, description="Parquet files, or patterns of file names."
    )
    robot: FileName = Field(description="Name of a built-in robot, or a robot file.")
    tool_mm: Vector = Field(description="Nominal target in the flange frame [mm].")
    base: list[str] = Field(default=["geometric"], description="Mechanisms of the model.")
    folds: int = Field(default=10, ge=2, le=1000, description="Number of cross-validation folds.")


class FleetFile(_Table):
    """A fleet file, checked."""

    name: Name = Field(description="Name of the job.")
    studies: list[FileName] = Field(default=[], description="Patterns of study files.")
    study: list[StudyTable] = Field(default=[], description="Studies with changed settings.")
    parts: list[PartsTable] = Field(default=[], description="Measurement sets in many files.")


@dataclass(frozen=True)
class Task:
    """A study of the fleet: the name of its folder, the study, the folder its files stand in."""

    name: str
    study: Study
    folder: Path


@dataclass(frozen=True)
class WrongStudy:
    """A study of the fleet whose file cannot be read: the name of its folder, and why."""

    name: str
    why: str


@dataclass(frozen=True)
class Fleet:
    """A fleet, its files found: studies in the file's order, measurement sets in pieces."""

    name: str
    tasks: tuple[Task | WrongStudy, ...]
    parts: tuple[PartsTable, ...]
    folder: Path


def read_fleet(path: Path) -> Fleet:
    """Read a fleet file and the study files it names; one that cannot be read is a `WrongStudy`.
    Raises StudyError with every problem of the fleet file and its place."""
    refuse_measurements(path, "a fleet file")
    text = read_text(path, "the fleet file")
    table = parse_toml(text, path.name)
    _refuse_study(path, table)
    folder = path.parent
    problems: list[str] = []
    try:
        file = FleetFile.model_validate(to_toml_values(table))
    except ValidationError as error:
        for detail in error.errors():
            problem = _describe_problem(detail)
            problems.append(f"{path.name}: {problem}")
        raise StudyError(*problems) from None
    entries = list[StudyTable]()
    for pattern in file.studies:
        for study_path in find_files(folder, pattern, problems):
            relative = study_path.relative_to(folder)
            entry = StudyTable(file=str(relative))
            entries.append(entry)
    entries += file.study
    tasks = list[Task | WrongStudy]()
    for entry in entries:
        task = _read_task(entry, folder, problems)
        if task is not None:
            tasks.append(task)
    names = [task.name for task in tasks]
    names += [part.name for part in file.parts]
    problems += _find_name_problems(names)
    if not names and not problems:
        problems.append('no studies: give studies = ["*/study.toml"], [[study]] or [[parts]].')
    if problems:
        raise StudyError(*(f"{path.name}: {problem}" for problem in problems))
    return Fleet(file.name, tuple(tasks), tuple(file.parts), folder)


def _refuse_study(path: Path, table: Mapping[str, Any]) -> None:
    """Refuse a study file in the place of a fleet file, and say what does with it. Raises StudyError."""
    is_study = bool(STUDY_TABLES & table.keys())
    lists_studies = bool({"studies", "study", "parts"} & table.keys())
    if is_study and not lists_studies:
        raise StudyError(
            f"{path.name}: this is a study file, not a fleet file. modelsel study "
            f"{shlex.quote(str(path))} runs it; a fleet file lists studies: "
            'studies = ["*/study.toml"].'
        )


def _find_name_problems(names: list[str]) -> list[str]:
    """Find names of two output folders, as file systems may take them for one, and names that no
    folder can have."""
    folders = {name: normalize("NFC", name).casefold() for name in names}
    counts = Counter(folders[name] for name in names)
    problems = [
        f'"{name}" stands twice: give [[study]] name = "…".'
        for name, folder in folders.items()
        if counts[folder] > 1
    ]
    problems += [
        f'"{name}" is not a name for a folder: give another name, of letters and digits.'
        for name in names
        if not FOLDER.fullmatch(name) or find_name_problem(name) is not None
    ]
    return problems


def find_files(folder: Path, pattern: str, problems: list[str]) -> list[Path]:
    """Find the files that match a pattern; append to `problems` where none does."""
    try:
        files = sorted(folder.glob(pattern))
    except (IndexError, ValueError, NotImplementedError, OSError):
        files = []  # what pathlib raises for an absolute pattern, or one that is not valid
    if not files:
        problems.append(
            f'studies: no file matches "{pattern}". Patterns are relative to the fleet file.'
        )
    return files


def _read_task(entry: StudyTable, folder: Path, problems: list[str]) -> Task | WrongStudy | None:
    """Read a study with what is different in this entry; append to `problems` where there is no
    such file."""
    path = folder / entry.file
    if path.is_dir():
        path = path / STUDY_FILE
    study_folder = path.parent
    name = entry.name or path.resolve().parent.name
    try:
        study = read_study(path)
    except StudyError as error:
        # each says the file's name, and the path says it, too
        file = f"{path.name}: "
        bare = [problem.removeprefix(file) for problem in error.problems]
        said = [f"{entry.file}: {problem}" for problem in bare]
        if path.exists():
            return WrongStudy(name, "\n".join(said))
        problems += said
        return None
    study = _change_study(study, entry, folder, study_folder)
    return Task(name, study, study_folder)


def _change_study(study: Study, entry: StudyTable, folder: Path, study_folder: Path) -> Study:
    changes: dict[str, Any] = {}
    estimation = entry.estimation
    candidates = entry.candidates
    if entry.measurements is not None:
        data = find_data(entry.measurements, folder)
        relative = os.path.relpath(data, study_folder)
        file = {"file": relative}
        changes["measurements"] = study.measurements.model_copy(update=file)
    if estimation is not None:
        split = {"estimation": estimation, "column": None}
        changes["split"] = study.split.model_copy(update=split)
    if candidates is not None:
        model = {"candidates": candidates}
        changes["model"] = study.model.model_copy(update=model)
    seed = entry.seed
    if seed is not None:
        changes["seed"] = seed
    return study.model_copy(update=changes)


def _describe_problem(error: Any) -> str:
    """Describe a problem of pydantic's by its place in the fleet file."""
    location = error["loc"]
    place = format_place(location)
    problem = describe_value_problem(error, place)
    if problem is not None:
        return problem
    tables: dict[str, type[_Table]] = {"study": StudyTable, "parts": PartsTable}
    first, *inner = location
    table: type[_Table] = FleetFile
    if inner:
        name = str(first)
        table = tables.get(name, FleetFile)
    last = location[-1]
    key = str(last)
    hint = suggest(key, table.model_fields)
    return f'unknown key "{place}". {hint}'
