"""result.json and details.json read back: whole, of one run, each value of its type, or refused in one sentence
with the place."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from .._json import read as read_text
from .._json import strict
from ..exceptions import StudyError
from .agreement import find_disagreement
from .details_schema import DetailsRecord
from .record_types import StrictRecord
from .schema import StudyRecord

SCHEMA = 1
REMEDY = "modelsel study STUDY.toml --out DIR makes it"
SHOWN = 80  # characters of a value in a message
EXPECTED = {
    "float_type": "a finite number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "string_type": "text that can be seen",
    "unseen": "text that can be seen",
    "bool_type": "true or false",
    "list_type": "a list",
    "tuple_type": "a list",
    "model_type": "a table",
    "dict_type": "a table",
}

Read = TypeVar("Read", bound=StrictRecord)


def read_records(folder: Path) -> tuple[StudyRecord, DetailsRecord]:
    """Read result.json and details.json of a folder. Raises StudyError that says how to make them."""
    record = _read_record(folder / "result.json", StudyRecord)
    details = _read_record(folder / "details.json", DetailsRecord, record.provenance.run)
    problem = find_disagreement(record, details)
    if problem is not None:
        raise StudyError(f"{folder}: {problem}; {REMEDY} anew.")
    return record, details


def parse_record(value: Any, model: type[Read]) -> Read:
    """Return a JSON value as a record. Raises ValueError with the first problem and its place."""
    try:
        return model.model_validate(value)
    except ValidationError as error:
        problem = describe_problem(error.errors(include_url=False)[0])
        raise ValueError(f"damaged: {problem}") from None


def _read_record(path: Path, model: type[Read], run: tuple[str, str] | None = None) -> Read:
    """Read one file; with `run`, refuse one that belongs to another."""
    try:
        value = strict(read_text(path))
        _check_schema(path, value)
        if run is not None and _run_of(value) != run:
            raise StudyError(
                f"{path.parent}: {path.name} belongs to another run than result.json; {REMEDY} anew."
            )
        return parse_record(value, model)
    except FileNotFoundError:
        raise StudyError(f"{path.parent}: there is no {path.name}; {REMEDY}.") from None
    except ValueError as error:
        raise StudyError(f"{path}: cannot be read: {error}; {REMEDY} anew.") from None


def _check_schema(path: Path, value: Any) -> None:
    """Raise StudyError where a file is not of the schema that this version reads."""
    version = value.get("schema") if isinstance(value, dict) else None
    if version != SCHEMA or version is True:
        raise StudyError(
            f"{path}: schema {str(version)[:40]}, this modelsel draws schema {SCHEMA}; {REMEDY} anew."
        )


def _run_of(value: dict[str, Any]) -> tuple[Any, Any]:
    return value.get("data_sha256"), value.get("study_sha256")


# -- what pydantic says, in words of the file
# -----------------------------------------------------------------------------------


def describe_problem(error: Any) -> str:
    """Describe an error of pydantic: its place (items counted from 1), what was expected, what is there."""
    kind, value = error["type"], error["input"]
    place = _place(error["loc"])
    if kind == "missing":
        return f"{place} is missing"
    if kind == "unseen_key":
        key = json.dumps(error["ctx"]["key"])[:SHOWN]
        return f"{place or 'the file'}: the key {key} holds a character that nobody sees"
    return f"{place or 'the file'}: expected {_expectation(error)}, found {_shown(value)}"


def _place(parts: tuple[int | str, ...]) -> str:
    """Return a path such as findings.1.p_value."""
    return ".".join(str(part + 1) if isinstance(part, int) else part for part in parts)


def _expectation(error: Any) -> str:
    kind, context = error["type"], error.get("ctx") or {}
    if kind in EXPECTED:
        return EXPECTED[kind]
    if kind in ("too_short", "too_long"):
        bound = context.get("min_length", context.get("max_length"))
        return f"a list of {'at least' if kind == 'too_short' else 'at most'} {bound}"
    if kind == "literal_error":
        return f"one of {context['expected']}"
    bound = context.get("le", context.get("ge"))
    return "a whole number" if isinstance(bound, int) else "a finite number"


def _shown(value: Any) -> str:
    """Return a value as a message shows it: a short text."""
    if isinstance(value, list):
        return f"a list of {len(value)}"
    if isinstance(value, dict):
        return "a table"
    return json.dumps(value, ensure_ascii=True)[:SHOWN]
