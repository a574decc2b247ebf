"""The last pages: outliers and notes, provenance."""

from __future__ import annotations

from ...notices import ALARMS, STEP_SIDE_OPEN
from ...results.schemas.schema import StudyRecord
from ...results.sentences.study_sentences import count_rows, describe_outliers
from ..document import Block, Source, make_heading, make_list, make_table, make_text
from .findings import name_finding

MAX_ROWS = 60  # numbers of outlying rows
PATH_CAPTION = (
    "In this order effects joined the model (+), were dropped (−) or gave way to others (→). Another form of the same has "
    "other constants, or a curve that is fitted anew."
)
MAX_FAULTY_ROWS = 12  # numbers of the rows of a fault
HASH_NAMES = {
    "data_sha256": "measurements, SHA-256",
    "study_sha256": "study file, SHA-256",
    "robot_sha256": "nominal robot, SHA-256",
}


def write_outliers_page(source: Source) -> list[Block]:
    """Write the rows left out, faults of the data, warnings of the set-up, notes."""
    record = source.record
    blocks = [make_heading("Outliers and notes"), make_text(_outlier_sentence(source))]
    faults = _list_faults(source)
    if faults:
        blocks.append(make_list(faults))
    alarms = [one.sentence for one in record.warnings if one.code in ALARMS]
    notes = [one.sentence for one in record.warnings if one.code not in ALARMS]
    for title, sentences in (("Warnings", alarms), ("Notes", notes)):
        if sentences:
            blocks += [make_heading(title, 2), make_list(sentences)]
    return blocks


def _list_faults(source: Source) -> list[str]:
    """Return which rows each finding concerns that is a fault of the data; it is told among the findings."""
    sentences = []
    for number, finding in enumerate(source.record.findings, 1):
        rows = finding.rows or []
        if not finding.first.is_fault or not rows:
            continue
        name = name_finding(finding, source.details.findings[number - 1])
        listed = source.where.listed(rows, MAX_FAULTY_ROWS)
        sentences.append(f"Finding {number}, {name}, concerns {count_rows(rows)} ({listed}).")
    return sentences


def _outlier_sentence(source: Source) -> str:
    """Return which rows were left out, and how they are counted."""
    where = source.where
    sentence = describe_outliers(source.record, where, MAX_ROWS)
    codes = {one.code for one in source.record.warnings}
    if not sentence and STEP_SIDE_OPEN in codes:
        return "No row was left out as an outlier."
    if not sentence:
        return "No row was left out."
    is_plain = where.is_text and where.at is None
    return f"{sentence} The header of the file is line 1." if is_plain else sentence


def list_provenance(record: StudyRecord) -> list[tuple[str, str]]:
    """Return (name, value) of the versions and hashes."""
    values = record.provenance.to_dict()
    return [(HASH_NAMES.get(key, key), str(value)) for key, value in values.items()]


def write_provenance_page(source: Source) -> list[Block]:
    """Write what this report was made from."""
    record = source.record
    rows = [
        ("study", record.study),
        ("robot", record.robot),
        ("seed", str(record.seed)),
        *list_provenance(record),
    ]
    columns = [("what", "left"), ("value", "left")]
    blocks = [
        make_heading("Provenance"),
        make_table(columns, rows, "", [0.0, 1.0]) | {"dense": True},
    ]
    if record.path:
        blocks += _write_path(record.path)
    reproducibility = (
        "The same measurements, study file and seed give the same bytes of result.json, of this report and of report.html. "
        "Every number in the text is from result.json."
    )
    return [*blocks, make_text(reproducibility, "quiet")]


def _write_path(path: list[str]) -> list[Block]:
    """Write the steps of the search as a table that breaks between pages."""
    rows = [[str(number), *_split_step(step)] for number, step in enumerate(path, 1)]
    columns = [("", "right"), ("", "left"), ("effect", "left"), ("in its place", "left")]
    table = make_table(columns, rows, PATH_CAPTION, [0.0, 0.0, 1.0, 1.0])
    heading = make_heading("How the model grew", 2)
    return [heading, table | {"dense": True, "breaks": True}]


def _split_step(step: str) -> list[str]:
    """Return a step's mark, its effect, and what took the place of that; a name that stays has
    another fitted curve or other constants."""
    before, arrow, after = step.partition(" -> ")
    if arrow:
        return ["→", before, "another form of the same" if before == after else after]
    mark, _, effect = step.partition(" ")
    return [mark.replace("-", "−"), effect, ""]
