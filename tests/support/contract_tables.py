"""The tables of docs/reference/files.md about result.json, written from its schema."""

from __future__ import annotations

from modelsel._records import StrictRecord
from modelsel.results.schemas.finding_schema import FindingRecord
from modelsel.results.schemas.schema import ErrorPartRecord, StudyRecord


def write_key_table(model: type[StrictRecord]) -> str:
    """Return a Markdown table of a record's keys and what they hold, from the schema's descriptions."""
    schema = model.model_json_schema(by_alias=True)
    lines = ["| key | holds |", "|---|---|"]
    for key, value in schema["properties"].items():
        lines.append(f"| `{key}` | {value['description']} |")
    return "\n".join(lines) + "\n"


def write_result_tables() -> str:
    """Return the tables of result.json, of one of its findings and of a part of what does not repeat, as
    docs/reference/files.md has them."""
    tables = (write_key_table(record) for record in (StudyRecord, FindingRecord, ErrorPartRecord))
    result, finding, part = tables
    return f"{result}\nA finding:\n\n{finding}\nA part of `repeatability`:\n\n{part}"
