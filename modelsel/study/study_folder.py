"""Write a study folder: study.toml, and beside it the measurements and the robot file."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .._files import check_writable, csv_bytes, write_all
from .._text import read_text
from ..config.study_file import parse_study
from ..exceptions import StudyError
from ..measurements.measurements import Measurements
from ..measurements.table import Table, rename_columns
from .new_study import StudyDraft, count_estimation

JOINED_FILE = "measurements.csv"
STUDY_FILE = "study.toml"
PLAIN_KEY = re.compile(r"[A-Za-z0-9_-]+")


def write_study_folder(
    draft: StudyDraft, data: Measurements, robot: Mapping[str, str], folder: Path
) -> list[Path]:
    """Write a study of a draft; `robot`: the keys of its table, `name` or `file` with `base` and
    `tip`. Returns the files written. Raises StudyError where there is a study already."""
    check_new(folder)
    files: dict[str, bytes] = {}
    source = draft.source
    if isinstance(source, Table):
        files[JOINED_FILE] = _write_table(rename_columns(source, draft.columns))
    elif source.path.resolve().parent != folder.resolve():
        files[source.path.name] = source.path.read_bytes()
    robot = dict(robot)
    if "file" in robot:
        path = Path(robot["file"])
        robot["file"] = path.name
        if path.resolve().parent != folder.resolve():
            files[path.name] = read_text(path, "the robot file").encode()
    text = format_study(draft, data, robot, folder.resolve().name)
    parse_study(text, STUDY_FILE)
    files[STUDY_FILE] = text.encode()
    write_all(folder, files)
    return [folder / name for name in files]


def check_new(folder: Path) -> None:
    """Refuse a folder that has a study already, or that cannot be written. Raises StudyError."""
    if (folder / STUDY_FILE).exists():
        raise StudyError(f"{folder / STUDY_FILE} already exists. Give another folder with --out.")
    check_writable(folder)


def format_study(draft: StudyDraft, data: Measurements, robot: Mapping[str, str], name: str) -> str:
    """Write the text of a study file, which a person may go on with."""
    lines = [f"name = {_quote(name)}", "seed = 1", "", "[robot]"]
    lines += [f"{key} = {_quote(value)}" for key, value in robot.items()]
    lines += ["register = true  # tracker frame and target are found from the measurements"]
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
    already."""
    source = draft.source
    if isinstance(source, Table):
        return [f"file = {_quote(JOINED_FILE)}"]
    lines = [f"file = {_quote(source.path.name)}"]
    if source.sheet is not None:
        lines.append(f"sheet = {_quote(source.sheet)}")
    if source.decimal is not None:
        lines.append(f"decimal = {_quote(source.decimal)}")
    if draft.columns:
        lines += ["", "[measurements.columns]  # name of a measurements file = name in this one"]
        lines += [f"{_key(name)} = {_quote(given)}" for name, given in draft.columns.items()]
    return lines


def _write_table(table: Table) -> bytes:
    """Write joined measurements as CSV."""
    import pandas as pd

    return csv_bytes(pd.DataFrame(dict(table.columns)), "%.17g")


def _quote(text: str) -> str:
    """Write a text as a TOML string."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _key(name: Any) -> str:
    return str(name) if PLAIN_KEY.fullmatch(str(name)) else _quote(str(name))
