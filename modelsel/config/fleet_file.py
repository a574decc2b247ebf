"""The fleet file: TOML -> the studies of one job, and measurements in pieces; every problem of a
file is said at once."""

from __future__ import annotations

import os
import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any
from unicodedata import normalize

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from .._names import find_name_problem
from .._text import parse_toml, read_text
from ..exceptions import StudyError, suggest
from .messages import describe_error, format_place, to_toml_values
from .study_file import FileName, Name, Study, Vector, find_data, read_study

# One part of a path on any system, not hidden, and not a name that Windows keeps for a device or
# the summary has.
FOLDER = re.compile(
    r"(?!(?:con|prn|aux|nul|(?:com|lpt)[0-9\xb9\xb2\xb3]|summary)(?:\.|$))"
    r"(?![. ])[^\x00-\x1f/\\:*?\"<>|]{1,200}(?<![. ])",
    re.IGNORECASE,
)


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class StudyTable(_Table):
    """[[study]]: a study file, and what is different here: a robot, a day, a what-if."""

    file: FileName = Field(description="Study file, or its folder.")
    name: Name | None = Field(default=None, description="Name of its output folder.")
    measurements: FileName | None = Field(default=None, description="Another measurements file.")
    estimation: Annotated[int, Field(ge=1)] | None = Field(
        default=None, description="Another number of estimation configurations."
    )
    candidates: list[str] | None = Field(default=None, description="Other candidates.")
    seed: Annotated[int, Field(ge=0)] | None = Field(default=None, description="Another seed.")


class PartsTable(_Table):
    """[[parts]]: one measurement set in many Parquet files, fitted without ever being held
    whole."""

    name: Name = Field(description="Name of its output folder.")
    files: list[FileName] = Field(min_length=1, description="Parquet files, or patterns of them.")
    robot: FileName = Field(description="Name of a built-in robot, or a robot file.")
    tool_mm: Vector = Field(description="Nominal target in the flange frame [mm].")
    base: list[str] = Field(default=["geometric"], description="Mechanisms of the model.")
    folds: int = Field(default=10, ge=2, le=1000, description="Folds of the cross-validation.")


class FleetFile(_Table):
    """A fleet file, checked."""

    name: Name = Field(description="Name of the fleet.")
    studies: list[FileName] = Field(default=[], description="Patterns of study files.")
    study: list[StudyTable] = Field(
        default=[], description="Studies, and what is different in each."
    )
    parts: list[PartsTable] = Field(default=[], description="Measurement sets in many files.")


@dataclass(frozen=True)
class Task:
    """A study of the fleet: the name of its folder, the study, the folder its files stand in."""

    name: str
    study: Study
    folder: Path


@dataclass(frozen=True)
class Fleet:
    """A fleet, its files found: studies in the file's order, measurement sets in pieces."""

    name: str
    tasks: tuple[Task, ...]
    parts: tuple[PartsTable, ...]
    folder: Path


def read_fleet(path: Path) -> Fleet:
    """Read a fleet file and the study files it names. Raises StudyError with every problem and its
    place."""
    table = parse_toml(read_text(path, "the fleet file"), path.name)
    try:
        file = FleetFile.model_validate(to_toml_values(table))
    except ValidationError as error:
        raise StudyError(
            *(f"{path.name}: {_describe_problem(e)}" for e in error.errors())
        ) from None
    problems: list[str] = []
    entries = list[StudyTable]()
    for pattern in file.studies:
        studies = find_files(path.parent, pattern, problems)
        entries += [StudyTable(file=str(study.relative_to(path.parent))) for study in studies]
    read = [_read_task(entry, path.parent, problems) for entry in (*entries, *file.study)]
    tasks = tuple(task for task in read if task is not None)
    names = [task.name for task in tasks] + [part.name for part in file.parts]
    problems += _find_name_problems(names)
    if not names and not problems:
        problems.append('no studies: give studies = ["*/study.toml"], [[study]] or [[parts]].')
    if problems:
        raise StudyError(*(f"{path.name}: {problem}" for problem in problems))
    return Fleet(file.name, tasks, tuple(file.parts), path.parent)


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


def _read_task(entry: StudyTable, folder: Path, problems: list[str]) -> Task | None:
    """Read a study with what is different in this entry; append to `problems` where it cannot
    be."""
    path = folder / entry.file
    try:
        study = read_study(path)
    except StudyError as error:
        problems += [f"{entry.file}: {problem}" for problem in error.problems]
        return None
    if path.is_dir():
        path = path / "study.toml"
    name = entry.name or path.resolve().parent.name
    return Task(name, _change_study(study, entry, folder, path.parent), path.parent)


def _change_study(study: Study, entry: StudyTable, folder: Path, study_folder: Path) -> Study:
    changes: dict[str, Any] = {}
    if entry.measurements is not None:
        file = os.path.relpath(find_data(entry.measurements, folder), study_folder)
        changes["measurements"] = study.measurements.model_copy(update={"file": file})
    if entry.estimation is not None:
        split = {"estimation": entry.estimation, "column": None}
        changes["split"] = study.split.model_copy(update=split)
    if entry.candidates is not None:
        changes["model"] = study.model.model_copy(update={"candidates": entry.candidates})
    if entry.seed is not None:
        changes["seed"] = entry.seed
    return study.model_copy(update=changes)


def _describe_problem(error: Any) -> str:
    """Describe a problem of pydantic's by its place in the fleet file."""
    location = error["loc"]
    place = format_place(location)
    if error["type"] == "missing":
        return f"{place} is missing."
    if error["type"] != "extra_forbidden":
        return f"{place}: {describe_error(error)}."
    tables: dict[str, type[_Table]] = {"study": StudyTable, "parts": PartsTable}
    table = tables.get(str(location[0]), FleetFile) if len(location) > 1 else FleetFile
    return f'unknown key "{place}". {suggest(str(location[-1]), table.model_fields)}'
