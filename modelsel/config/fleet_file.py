"""The fleet file: TOML -> the studies of one job, and measurements in pieces; every problem of a
file is said at once."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any
from unicodedata import normalize

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from .._names import find_name_problem
from .._text import parse_toml, read_text
from ..exceptions import StudyError, suggest
from .messages import describe_error, to_toml_values
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
    """A fleet file and the study files it names. Raises StudyError with every problem and its
    place."""
    table = parse_toml(read_text(path, "the fleet file"), path.name)
    try:
        found = FleetFile.model_validate(to_toml_values(table))
    except ValidationError as error:
        raise StudyError(*(f"{path.name}: {_sentence(e)}" for e in error.errors())) from None
    problems: list[str] = []
    entries = [
        StudyTable(file=str(file.relative_to(path.parent)))
        for pattern in found.studies
        for file in find_files(path.parent, pattern, problems)
    ]
    tasks = [
        task
        for entry in (*entries, *found.study)
        if (task := _task(entry, path.parent, problems)) is not None
    ]
    names = [task.name for task in tasks] + [part.name for part in found.parts]
    folders = [
        normalize("NFC", name).casefold() for name in names
    ]  # as file systems may take them for one
    problems += [
        f'"{name}" stands twice: give [[study]] name = "…".'
        for name, folder in dict(zip(names, folders, strict=True)).items()
        if folders.count(folder) > 1
    ]
    problems += [
        f'"{name}" is no name for a folder: give another name, of letters and digits.'
        for name in names
        if not FOLDER.fullmatch(name) or find_name_problem(name) is not None
    ]
    if not names and not problems:
        problems.append('no studies: give studies = ["*/study.toml"], [[study]] or [[parts]].')
    if problems:
        raise StudyError(*(f"{path.name}: {problem}" for problem in problems))
    return Fleet(found.name, tuple(tasks), tuple(found.parts), path.parent)


def find_files(folder: Path, pattern: str, problems: list[str]) -> list[Path]:
    """The files of a pattern; where there is none, a problem more."""
    try:
        files = sorted(folder.glob(pattern))
    except (
        IndexError,
        ValueError,
        NotImplementedError,
        OSError,
    ):  # what pathlib says of a pattern that is none, or absolute
        files = []
    if not files:
        problems.append(
            f'studies: no file matches "{pattern}". Patterns are relative to the fleet file.'
        )
    return files


def _task(entry: StudyTable, folder: Path, problems: list[str]) -> Task | None:
    path = folder / entry.file
    try:
        study = read_study(path)
    except StudyError as error:
        problems += [f"{entry.file}: {problem}" for problem in error.problems]
        return None
    path = path / "study.toml" if path.is_dir() else path
    changes: dict[str, Any] = {}
    if entry.measurements is not None:
        file = find_data(entry.measurements, folder)
        changes["measurements"] = study.measurements.model_copy(
            update={"file": os.path.relpath(file, path.parent)}
        )
    if entry.estimation is not None:
        changes["split"] = study.split.model_copy(
            update={"estimation": entry.estimation, "column": None}
        )
    if entry.candidates is not None:
        changes["model"] = study.model.model_copy(update={"candidates": entry.candidates})
    if entry.seed is not None:
        changes["seed"] = entry.seed
    return Task(
        entry.name or path.resolve().parent.name, study.model_copy(update=changes), path.parent
    )


def _sentence(error: Any) -> str:
    place = ".".join(str(part + 1) if isinstance(part, int) else str(part) for part in error["loc"])
    if error["type"] == "extra_forbidden":
        inner: dict[str, type[_Table]] = (
            {"study": StudyTable, "parts": PartsTable} if len(error["loc"]) > 1 else {}
        )
        table = inner.get(str(error["loc"][0]), FleetFile)
        return f'unknown key "{place}". {suggest(str(error["loc"][-1]), table.model_fields)}'
    if error["type"] == "missing":
        return f"{place} is missing."
    return f"{place}: {describe_error(error)}."
