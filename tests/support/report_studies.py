"""What the tests of the report share."""

from __future__ import annotations

import io
import json
from pathlib import Path

from modelsel._records import parse_record
from modelsel.report.document import Source
from modelsel.report.terminal import Amount, show_study
from modelsel.results.reading import read_records
from modelsel.results.schemas.details_schema import DetailsRecord
from modelsel.results.schemas.schema import StudyRecord


def written(folder: Path) -> tuple[dict, dict]:
    """result.json and details.json as plain values, to change."""
    result, details = (
        json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
        for name in ("result", "details")
    )
    return result, details


def source_of(result: dict, details: dict) -> Source:
    """What a report is made of, from plain values."""
    return Source(parse_record(result, StudyRecord), parse_record(details, DetailsRecord))


def read_source(folder: Path) -> Source:
    """What a report is made of, from a study's folder."""
    return Source(*read_records(folder))


def terminal_lines(record: StudyRecord, details: DetailsRecord) -> list[str]:
    """Everything that a terminal shows of a study below its title, no line folded."""
    from rich.console import Console

    stream = io.StringIO()
    console = Console(file=stream, width=100_000)
    show_study(record, details, console, Amount.EVERYTHING)
    lines = [line for line in stream.getvalue().splitlines() if line]
    title = next(k for k, line in enumerate(lines) if line.startswith("Robot "))
    return lines[title + 1 :]
