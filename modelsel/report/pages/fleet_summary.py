"""summary.pdf: a fleet on one to three pages: every study in a line, what was found how often, what
failed, every kind of note."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..._version import VERSION
from ...exceptions import count_words
from ...notices import ALARMS
from ...results.sentences.study_sentences import format_mm
from ..document import Block, make_heading, make_table, make_text
from ..pdf import compile_pdf
from ..style import shorten

Row = dict[str, Any]
MAX_STUDIES = 45  # lines of the table; a larger fleet has the others in summary.csv
MAX_NAMES = 14  # findings that are counted
MAX_FAILURES = 12  # failures that are listed
MAX_MENTIONED = 6  # studies named beside a note or failure
LONGEST_REASON = 160  # letters of a reason
LONGEST_NOTE = 400  # letters of a note, of which each kind stands there once
LONGEST_FINDING = 50  # letters of a finding's name
LONGEST_STUDY = 30  # letters of a study's name in a list
LONGEST_HEADER = 70  # letters
ERROR_COLUMNS = ("nominal_mm", "base_mm", "chosen_mm", "noise_mm")


def write_summary(name: str, rows: Sequence[Row], out: Path) -> bytes:
    """Write the PDF of a fleet's rows, in their order; notes are read from the studies' folders below `out`. Raises
    ReportError."""
    done = [row for row in rows if row["state"] == "done"]
    failed = [row for row in rows if row["state"] != "done"]
    studies = count_words(len(rows), "study")
    blocks: list[Block] = [
        {
            "kind": "title",
            "over": "Fleet summary",
            "title": name,
            "about": f"{studies} · {len(done)} done, {len(failed)} failed",
        },
        *(make_text(sentence, "lead") for sentence in _lead_sentences(rows, done, failed)),
        *_write_findings(done),
        make_heading("Study by study"),
        *_write_studies(done),
        *_write_failures(failed),
        *_write_notes(done, out),
    ]
    content = {
        "title": f"Fleet summary: {name}",
        "short": shorten(name, LONGEST_HEADER),
        "robot": studies,
        "made": f"modelsel {VERSION}",
        "blocks": blocks,
    }
    pdf, _ = compile_pdf(content, {})
    return pdf


def _list_studies(rows: Sequence[Row]) -> str:
    """Return the names of studies, the first few of them."""
    names = [shorten(row["name"], LONGEST_STUDY) for row in rows]
    more = len(names) - MAX_MENTIONED
    listed = ", ".join(names[:MAX_MENTIONED])
    return f"{listed} and {more} more" if more > 0 else listed


# -- lead
# -----------------------------------------------------------------------------------------------------------------------


def _lead_sentences(rows: Sequence[Row], done: Sequence[Row], failed: Sequence[Row]) -> list[str]:
    """Return the fleet in a few sentences."""
    sentences = _error_sentences(done)
    unsure = [row for row in done if row["exit"]]
    if unsure:
        sentences.append(f"Done, but the chain has not converged: {_list_studies(unsure)}.")
    if failed:
        count = count_words(len(failed), "study")
        listed = _list_studies(failed)
        sentences.append(f"{count} of {len(rows)} failed: {listed}.")
    return sentences


def _error_sentences(done: Sequence[Row]) -> list[str]:
    """Return the errors before and after, and where the chosen model is worse than the base; none where nothing is
    held out."""
    measured = [
        row for row in done if row["nominal_mm"] is not None and row["chosen_mm"] is not None
    ]
    if not measured:
        return []
    before = _median(measured, "nominal_mm")
    after = _median(measured, "chosen_mm")
    studies = count_words(len(measured), "study")
    worst = max(measured, key=lambda row: row["chosen_mm"])
    largest = format_mm(worst["chosen_mm"])
    summary = (
        f"Mean error on held-out configurations, median over {studies}: {before} mm nominal, "
        f"{after} mm with the chosen model. The largest that is left: {largest} mm, {worst['name']}."
    )
    worse = [row for row in measured if _is_worse(row)]
    if not worse:
        return [summary]
    return [summary, f"Worse than with the base alone: {_list_studies(worse)}."]


def _median(rows: Sequence[Row], column: str) -> str:
    return format_mm(float(np.median([row[column] for row in rows])))


def _is_worse(row: Row) -> bool:
    return row["base_mm"] is not None and row["chosen_mm"] > row["base_mm"]


# -- tables
# ---------------------------------------------------------------------------------------------------------------------


def _write_findings(done: Sequence[Row]) -> list[Block]:
    """Write how often each name was found."""
    studies: dict[str, list[Row]] = {}
    for row in done:
        for name in str(row["found"] or "").split(" + "):
            if name:
                studies.setdefault(name, []).append(row)
    ranked = sorted(studies.items(), key=lambda item: (-len(item[1]), item[0]))
    if not ranked:
        return [make_text("Nothing beyond the base was found in any study.")]
    lines = [
        [shorten(name, LONGEST_FINDING), str(len(rows)), _list_studies(rows)]
        for name, rows in ranked[:MAX_NAMES]
    ]
    columns = [("found", "left"), ("studies", "right"), ("which", "left")]
    of_studies = count_words(len(done), "study")
    caption = (
        f"What the chosen models of {of_studies} have beyond the base, and how often it was found; what is "
        "not proven of it stands study by study."
    )
    more = len(ranked) - MAX_NAMES
    if more > 0:
        caption += f" And {count_words(more, 'more name')}."
    return [make_table(columns, lines, caption, [0.5, 0.0, 1.0])]


STUDY_COLUMNS = (
    ("study", "left"),
    ("robot", "left"),
    ("measured", "right"),
    ("nominal", "right"),
    ("base", "right"),
    ("chosen", "right"),
    ("noise", "right"),
    ("found beyond the base", "left"),
    ("notes", "left"),
)


def _write_studies(done: Sequence[Row]) -> list[Block]:
    """Write a line a study; of a large fleet those with the largest error left."""
    if not done:
        return [make_text("No study was finished.")]
    caption = (
        "Mean error on held-out configurations [mm] of the nominal, the base and the chosen model; noise: of one coordinate "
        "[mm]. Measured: configurations. Notes: how many, told below; a warning by its name. Each study's own folder has its report."
    )
    shown = list(done)
    if len(done) > MAX_STUDIES:
        shown = sorted(done, key=lambda row: -(row["chosen_mm"] or 0.0))[:MAX_STUDIES]
        caption += f" Of {len(done)} the {MAX_STUDIES} with the largest error left; all are in summary.csv."
    has_alarms = any(code in ALARMS for row in shown for code in row["warnings"].split(" + "))
    widths = [0.55, 0.45, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.35 if has_alarms else 0.0]
    return [make_table(STUDY_COLUMNS, [_study_line(row) for row in shown], caption, widths)]


def _study_line(row: Row) -> list[str]:
    nothing = "nothing" if row["chosen_mm"] is not None else "a fit alone"
    return [
        row["name"],
        row["robot"] or "–",
        f"{row['estimation'] + row['held_out']:,}",
        *(format_mm(row[column]) for column in ERROR_COLUMNS),
        row["found_as"] or nothing,
        _count_notes(row),
    ]


def _count_notes(row: Row) -> str:
    """Return the codes of a study's warnings, and how many notes it has."""
    codes = str(row["warnings"] or "").split(" + ")
    alarms = [code for code in codes if code in ALARMS]
    notes = sum(code != "" and code not in ALARMS for code in codes)
    return ", ".join([*alarms, *([str(notes)] if notes else [])]) or "–"


def _write_failures(failed: Sequence[Row]) -> list[Block]:
    """Write which studies failed and why; nothing where none did."""
    if not failed:
        return []
    lines = [_failure_line(row) for row in failed[:MAX_FAILURES]]
    columns = [("study", "left"), ("exit", "right"), ("why", "left")]
    caption = "Exit: 1 internal error, 2 study file, 3 measurements, 4 not estimable."
    if len(failed) > MAX_FAILURES:
        caption += f" The first {MAX_FAILURES} of {len(failed)}; all are in summary.csv."
    return [make_heading("What failed"), make_table(columns, lines, caption, [0.3, 0.0, 1.0])]


def _failure_line(row: Row) -> list[str]:
    reason = " ".join(str(row["why"]).split())
    return [row["name"], str(row["exit"]), shorten(reason, LONGEST_REASON)]


def _write_notes(done: Sequence[Row], out: Path) -> list[Block]:
    """Write every kind of warning, then of note, once, in the words of the first study that has it."""
    sentences: dict[str, dict[str, None]] = {}
    studies: dict[str, dict[str, Row]] = {}
    for row in done:
        for note in _read_notes(row, out):
            code = note["code"]
            sentences.setdefault(code, {})[note["sentence"]] = None
            studies.setdefault(code, {})[row["name"]] = row
    blocks: list[Block] = []
    for title, word in (("Warnings", "warning"), ("Notes", "note")):
        lines = [
            [
                code,
                _write_note(list(told), list(studies[code])),
                _list_studies(list(studies[code].values())),
            ]
            for code, told in sentences.items()
            if (code in ALARMS) == (word == "warning")
        ]
        if lines:
            columns = [(word, "left"), ("what it says", "left"), ("studies", "left")]
            caption = f"One {word} of each kind, in the words of the first study named."
            table = make_table(columns, lines, caption, [0.35, 1.0, 0.5])
            blocks += [make_heading(title), table]
    return blocks


def _write_note(sentences: Sequence[str], studies: Sequence[str]) -> str:
    """Write a note in the words of the first study that has it, whose they are where some differ."""
    first = shorten(sentences[0], LONGEST_NOTE)
    if len(sentences) == 1:
        return first
    return f"{shorten(studies[0], LONGEST_STUDY)}: {first} Others say it in other words."


def _read_notes(row: Row, out: Path) -> list[dict[str, str]]:
    """Return the warnings and notes of a study's result.json; none where it has none."""
    file = out / row["name"] / "result.json"
    if not row["warnings"] or not file.is_file():
        return []
    notes: list[dict[str, str]] = json.loads(file.read_text(encoding="utf-8"))["warnings"]
    return notes
