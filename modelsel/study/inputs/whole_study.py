"""A study with all that is wrong with its file, and with the files that it names, said at once."""

from __future__ import annotations

from pathlib import Path

from ..._arguments import check_path
from ..._files import STUDY_FILE
from ..._text import parse_toml, read_text
from ...config.readable_part import read_part
from ...config.study_file import Study, read_study
from ...exceptions import StudyError
from ...mechanisms.registry import with_plugins
from ...robot.kinematics import Robot
from .found_problems import FoundProblems
from .inputs import check_part, read_inputs, read_nominal_robot


def open_study(
    study: Study | Path | str, folder: Path | str | None, measured: bool = True
) -> tuple[Study, Path]:
    """Return a study and the folder of its files.

    The folder is the given one, else that of the study's own file, else the current one;
    `measured`: whether the measurements must be there. Raises StudyError.
    """
    if folder is not None:
        folder = check_path(folder, "the folder of the study's files")
    if isinstance(study, Study):
        return study, folder or Path()
    path = check_path(study, "a Study, or the path of a study file or of its folder")
    read = read_whole_study(path, measured)
    if folder is not None:
        return read, folder
    if path.is_dir():
        return read, path
    return read, path.parent


def read_whole_study(path: Path, measured: bool = True) -> Study:
    """Read a study file; a folder stands for its study.toml. `measured`: whether the measurements
    must be there. Raises StudyError with every problem, those of its names and of the files that it
    names among them."""
    try:
        return read_study(path)
    except StudyError as error:
        if not error.places:
            raise
        file = path / STUDY_FILE if path.is_dir() else path
        further = _list_further_problems(file, measured)
        raise StudyError(*error.problems, *further) from None


def read_study_robot(study: Study, folder: Path) -> Robot:
    """Read a study's nominal robot. Raises StudyError with all that is wrong with the study's
    inputs, where the robot is."""
    try:
        return read_nominal_robot(study, folder)
    except StudyError:
        registry, _ = with_plugins()
        read_inputs(study, folder, registry)
        raise


def _list_further_problems(file: Path, measured: bool) -> list[str]:
    """List what is wrong with the readable part of a study file that has wrong values."""
    text = read_text(file, "the study file")
    table = parse_toml(text, file.name)
    try:
        part = read_part(table)
    except RecursionError:
        return []
    if part is None:
        return []
    registry, _ = with_plugins()
    found = FoundProblems(file.name, [*part.problems])
    check_part(part, file.parent, registry, measured, found)
    return found.list_all()
