"""Write a study folder: study.toml, and beside it the measurements and the robot file."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..._files import STUDY_FILE, check_writable, csv_bytes, write_all
from ..._names import find_name_problem
from ..._text import read_text
from ...config.study_file import parse_study
from ...exceptions import StudyError
from ...measurements.formats.table import Table
from ...measurements.measurements import Measurements
from ...measurements.quantities.row_names import find_row_names
from ...robot.files import is_robot_file
from ..inputs.stated_setup import StatedSetup
from ..tables.robot_tables import is_robot_table
from .new_study import StudyDraft, count_estimation

JOINED_FILE = "measurements.csv"
# of joined rows: where each stands in the files that people have
SOURCE_COLUMN = "source"
AS_FOUND = StatedSetup()
PLAIN_KEY = re.compile(r"[A-Za-z0-9_-]+")


@dataclass(frozen=True)
class RobotSource:
    """How a user names a robot: its name or file, of a URDF the links `base` and `tip`; `written`:
    the URDF that a xacro file expands to, or the robot file that a table of DH parameters makes."""

    given: str
    base: str | None = None
    tip: str | None = None
    written: bytes | None = None

    def list_keys(self, name: str) -> dict[str, str]:
        """List the keys of the study's table [robot], for a robot of some `name`."""
        if not self.is_file:
            return {"name": name}
        keys = {"file": self.file, "base": self.base, "tip": self.tip}
        return {key: value for key, value in keys.items() if value is not None}

    @property
    def is_file(self) -> bool:
        """Whether it is a file, and not a built-in name."""
        return is_robot_file(self.given) or is_robot_table(self.given)

    @property
    def file(self) -> str:
        """The robot file's name in the study folder."""
        path = Path(self.given)
        if self.written is None:
            return path.name
        if is_robot_table(path):
            return f"{path.stem}.toml"
        name = path.name.removesuffix(path.suffix)
        stem = name.removesuffix(".urdf")
        return f"{stem}.urdf"

    def read(self) -> bytes:
        """Read the robot file."""
        if self.written is not None:
            return self.written
        return read_text(Path(self.given), "the robot file").encode()


def write_study_folder(
    draft: StudyDraft,
    data: Measurements,
    robot: RobotSource,
    folder: Path,
    setup: StatedSetup = AS_FOUND,
) -> list[Path]:
    """Write a study of a draft. Returns the files written. Raises StudyError where there is a study
    already, or another file of the name of one."""
    check_new(folder)
    files: dict[str, bytes] = {}
    source = draft.source
    if isinstance(source, Table):
        files[JOINED_FILE] = write_joined_table(draft.contract_table())
    elif not _is_inside(source.path, folder):
        files[source.path.name] = source.path.read_bytes()
    if robot.is_file:
        written = robot.written is not None
        if written or not _is_inside(Path(robot.given), folder):
            files[robot.file] = robot.read()
    keys = robot.list_keys(draft.robot.name)
    text = format_study(draft, data, keys, folder.resolve().name, setup)
    parse_study(text, STUDY_FILE)
    files[STUDY_FILE] = text.encode()
    _refuse_other_content(folder, files)
    write_all(folder, files)
    return [folder / name for name in files]


def _refuse_other_content(folder: Path, files: Mapping[str, bytes]) -> None:
    """Refuse to replace a file of the folder by one of the same name. Raises StudyError."""
    for name, content in files.items():
        path = folder / name
        if path.is_file() and path.read_bytes() != content:
            raise StudyError(
                f"{path}: another file of this name is there and would be replaced. Give another folder "
                "with --out."
            )


def _is_inside(path: Path, folder: Path) -> bool:
    real = path.resolve()
    parent = real.parent
    return parent == folder.resolve()


def check_new(folder: Path) -> None:
    """Refuse a folder that has a study already, that cannot be written, or whose name cannot be
    the study's. Raises StudyError."""
    problem = find_name_problem(folder.resolve().name)
    if problem is not None:
        why, _, _ = problem.rpartition(". ")
        raise StudyError(
            f"{folder}: the study would be called as its folder, and this is not a name: {why}. Give "
            "another folder with --out."
        )
    if (folder / STUDY_FILE).exists():
        raise StudyError(f"{folder / STUDY_FILE} already exists. Give another folder with --out.")
    check_writable(folder)


def format_study(
    draft: StudyDraft,
    data: Measurements,
    robot: Mapping[str, str],
    name: str,
    setup: StatedSetup = AS_FOUND,
) -> str:
    """Write the text of a study file, which a person may go on with."""
    lines = [f"name = {_quote(name)}", "seed = 1", "", "[robot]"]
    lines += [f"{key} = {_quote(value)}" for key, value in robot.items()]
    lines += setup.format_lines()
    if draft.gears is not None:
        listed = ", ".join(f"{value:g}" for value in draft.gears.values)
        lines += [f"gear_ratios = [{listed}]  # turns of the motor per turn of each joint"]
    lines += ["", "[measurements]", *_format_measurements(draft)]
    estimation = count_estimation(data)
    if estimation is not None:
        lines += [
            "",
            "[split]",
            f"estimation = {estimation}  # the other configurations are held out",
        ]
    return "\n".join(lines) + "\n"


def _format_measurements(draft: StudyDraft) -> list[str]:
    """Write the lines of the table of measurements; of joined files the columns have their names
    already, and those that they had are kept."""
    source = draft.source
    if isinstance(source, Table):
        lines = [f"file = {_quote(JOINED_FILE)}"]
        if source.where.parts and draft.columns:
            lines += [
                "",
                "[measurements.joined]  # name of a measurements file = name in the files",
            ]
            lines += _format_names(draft.columns)
        return lines
    keys = {"file": source.path.name, "sheet": source.sheet, "decimal": source.decimal}
    lines = []
    for key, value in keys.items():
        if value is not None:
            lines.append(f"{key} = {_quote(value)}")
    if source.headerless:
        lines.append("header = false")
    if draft.columns:
        lines += ["", "[measurements.columns]  # name of a measurements file = name in this one"]
        lines += _format_names(draft.columns)
    return lines


def _format_names(columns: Mapping[str, str]) -> list[str]:
    """Write contract name = name in a file, a line each."""
    return [f"{_key(name)} = {_quote(given)}" for name, given in columns.items()]


def write_joined_table(table: Table) -> bytes:
    """Write joined measurements as CSV; the first column says where each row stands in the files
    that people have."""
    import pandas as pd

    frame = pd.DataFrame(dict(table.columns))
    is_joined = bool(table.where.parts)
    if is_joined and SOURCE_COLUMN not in table:
        sources = _name_sources(table)
        frame.insert(0, SOURCE_COLUMN, sources)
    return csv_bytes(frame, None)


def _name_sources(table: Table) -> list[str]:
    """Name the point of every row, where points have names, and its line in the instrument's file;
    of a missed shot the line of its readings."""
    log = table.where
    points, *_ = log.parts.values()
    names = find_row_names(table)
    sources = []
    for row in range(len(table)):
        is_measured = points.number(row) > 0
        where = points if is_measured else log
        place = where.name_row_alone(row)
        source = f"{where.file} {place}"
        if names is not None:
            name = str(names[row])
            label = name.strip()
            source = f"{label}, {source}"
        sources.append(source)
    return sources


def _quote(text: str) -> str:
    """Write a text as a TOML string."""
    quoted = json.dumps(text, ensure_ascii=False)
    return quoted.replace("\x7f", "\\u007f")


def _key(name: Any) -> str:
    return str(name) if PLAIN_KEY.fullmatch(str(name)) else _quote(str(name))
