"""What the tests of the report share."""

from __future__ import annotations

import json
from pathlib import Path

from modelsel._records import parse_record
from modelsel.report.document import Source
from modelsel.results.details_schema import DetailsRecord
from modelsel.results.schema import StudyRecord


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
