"""result.json and details.json read back: whole, of one run, each value of its type, or refused in one sentence
with the place."""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeVar

from .._json import parse_json, read_json_text
from .._records import StrictRecord, parse_record
from ..exceptions import StudyError
from .agreement import find_disagreement
from .schemas.details_schema import DetailsRecord
from .schemas.schema import StudyRecord

SCHEMA = 1
REMEDY = "modelsel study STUDY.toml --out DIR makes it"

Read = TypeVar("Read", bound=StrictRecord)


def read_records(folder: Path) -> tuple[StudyRecord, DetailsRecord]:
    """Read result.json and details.json of a folder. Raises StudyError that says how to make them."""
    record = _read_record(folder / "result.json", StudyRecord)
    details = _read_record(folder / "details.json", DetailsRecord, record.provenance.run)
    problem = find_disagreement(record, details)
    if problem is not None:
        raise StudyError(f"{folder}: {problem}; {REMEDY} anew.")
    return _mark_fitted(record, details), details


def _mark_fitted(record: StudyRecord, details: DetailsRecord) -> StudyRecord:
    """Mark which explanation of every finding is fitted, where result.json was written before it said
    so: that of which the finding has its name."""
    findings = []
    for finding, drawn in zip(record.findings, details.findings, strict=True):
        marked = finding
        if "fitted" not in finding.model_fields_set:
            # the label may go on: with a number, "with the opposite sign"
            names = [f"{entry.name} " for entry in finding.credible_set]
            fitted = [k for k, name in enumerate(names) if f"{drawn.label} ".startswith(name)]
            if fitted and fitted[0] > 0:
                marked = finding.model_copy(update={"fitted": fitted[0]})
        findings.append(marked)
    return record.model_copy(update={"findings": findings})


def _read_record(path: Path, model: type[Read], run: tuple[str, str] | None = None) -> Read:
    """Read one file; with `run`, refuse one that belongs to another."""
    try:
        value = parse_json(read_json_text(path))
        _check_schema(path, value)
        if run is not None and _run_of(value) != run:
            raise StudyError(
                f"{path.parent}: {path.name} belongs to another run than result.json; {REMEDY} anew."
            )
        return _parse(value, model)
    except FileNotFoundError:
        raise StudyError(f"{path.parent}: there is no {path.name}; {REMEDY}.") from None
    except ValueError as error:
        raise StudyError(f"{path}: cannot be read: {error}; {REMEDY} anew.") from None


def _parse(value: Any, model: type[Read]) -> Read:
    """Return a file's value as a record. Raises ValueError that says it is damaged, and where."""
    try:
        return parse_record(value, model)
    except ValueError as error:
        raise ValueError(f"damaged: {error}") from None


def _check_schema(path: Path, value: Any) -> None:
    """Raise StudyError where a file is not of the schema that this version reads."""
    version = value.get("schema") if isinstance(value, dict) else None
    if version != SCHEMA or version is True:
        raise StudyError(
            f"{path}: schema {str(version)[:40]}, this modelsel draws schema {SCHEMA}; {REMEDY} anew."
        )


def _run_of(value: dict[str, Any]) -> tuple[Any, Any]:
    return value.get("data_sha256"), value.get("study_sha256")
