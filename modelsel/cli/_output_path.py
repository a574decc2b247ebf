"""Where a command writes: at a path that is given, and not over what people or other commands made."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import click

from .._files import PARQUET_SUFFIXES, STUDY_FILE
from ..exceptions import StudyError, one_line

REMEDY = "Give another file with {option}."
# endings of a table's name: of text, of Parquet, and none
TABLE_ENDINGS = ("", ".csv", ".txt", *PARQUET_SUFFIXES)
RESULT_FILE = "result.json"  # says that a folder holds a result


class OutputPath(click.Path):
    """The path of an option that says where to write; an empty one is refused, which a shell's
    variable without a value leaves and which would be the current folder."""

    def __init__(self, **options: Any):
        super().__init__(path_type=Path, **options)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Convert to a Path. Raises BadParameter."""
        if value == "":
            self.fail("expected a path, found an empty text.")
        path = Path(value)
        if not self.file_okay and path.is_file():
            self.fail(f"{value} is a file; a folder is expected.")
        if not self.dir_okay and path.is_dir():
            self.fail(f"{value} is a folder; a file is expected.")
        return super().convert(value, param, ctx)


def check_output(out: Path, inputs: Iterable[Path], option: str = "--out") -> None:
    """Refuse an output file that one of a command's inputs is, or that belongs to a study or a result
    beside it: neither is to be had again. Raises StudyError."""
    if not out.is_file():
        return
    remedy = REMEDY.format(option=option)
    if _is_among(out, inputs):
        raise StudyError(f"{out}: this command reads the file and would replace it. {remedy}")
    owner = _find_owner(out)
    if owner is not None:
        raise StudyError(f"{out}: the file belongs to {owner} and would be replaced. {remedy}")


def check_table_path(out: Path, *more: str) -> None:
    """Refuse the name of what is neither text nor Parquet for a table, which is written as one of
    these or as what has one of `more` endings. Raises StudyError."""
    from ..measurements.formats.spreadsheet import SPREADSHEET_SUFFIXES

    suffix = out.suffix.lower()
    if suffix in (*TABLE_ENDINGS, *more):
        return
    what, hint = f"as {suffix}", ""
    if suffix in SPREADSHEET_SUFFIXES:
        what, hint = f"as a spreadsheet ({suffix})", "; spreadsheet programs open CSV"
    endings = ", ".join([".csv", *more])
    raise StudyError(
        f"{out}: a table is written as CSV or as Parquet, not {what}. "
        f"Give a file {endings} or .parquet with --out{hint}."
    )


def describe_other_result(folder: Path, study: str, robot: str) -> str | None:
    """Say that a folder has the result of a study of another name or robot, which a run would replace; None
    where it has none. Studies in folders of one name have one name and one folder of results."""
    file = folder / RESULT_FILE
    try:
        text = file.read_text(encoding="utf-8")
        record = json.loads(text)
        other = record["study"]
        measured = record.get("robot", robot)
    except (OSError, ValueError, LookupError, TypeError):
        return None
    if other == study and measured == robot:
        return None
    shown = f'"{one_line(str(other))}"'
    if measured != robot:
        shown += f" of robot {one_line(str(measured))}"
    return (
        f"{folder} has the result of another study, {shown}, which this run replaces when it is "
        "done. To keep it, interrupt now and give another folder with --out."
    )


def _is_among(out: Path, paths: Iterable[Path]) -> bool:
    """Whether a file is one of some paths, under whatever name, the folders among them left out."""
    files = [path for path in paths if path.is_file()]
    return any(out.samefile(path) for path in files)


def _find_owner(out: Path) -> str | None:
    """Find what a file belongs to, in words: the result or the study of its folder; None where
    it is a file of its own."""
    from ..results.storage import WRITES

    folder = out.parent
    if out.name in WRITES and (folder / RESULT_FILE).is_file():
        return f"the result in {folder}"
    if _is_among(out, [folder / STUDY_FILE]) or _is_among(out, _list_inputs_beside(folder)):
        return f"the study in {folder}"
    return None


def _list_inputs_beside(folder: Path) -> list[Path]:
    """List the files that the study of a folder is read from; none where it has no such study."""
    from ..config.study_file import read_study
    from ..study.inputs.inputs import list_input_files

    path = folder / STUDY_FILE
    try:
        return list_input_files(read_study(path), path)
    except StudyError:
        return []
