"""summary.pdf: a fleet on two or three pages: every study in a line, what was found how often, what
failed, every warning."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..._version import VERSION
from ...results.study_sentences import format_mm
from ..document import Block, make_heading, make_table, make_text
from ..pdf import compile_pdf
from ..style import shorten

Row = dict[str, Any]
ROWS = 45  # lines of the table; a larger fleet has the others in summary.csv
NAMES = 14  # findings that are counted
FAILED = 12  # failures that are listed
SAID = 6  # studies named beside a warning or failure
LONG = 160  # letters of a warning or reason


def summary(name: str, rows: Sequence[Row], out: Path) -> bytes:
    """The PDF of a fleet's rows, in their order; warnings are read from the studies' folders below
    `out`. Raises ReportError."""
    done = [row for row in rows if row["state"] == "done"]
    failed = [row for row in rows if row["state"] != "done"]
    title = {
        "kind": "title",
        "over": "Fleet summary",
        "title": name,
        "about": f"{_count(len(rows), 'study', 'studies')} · {len(done)} done, {len(failed)} failed",
    }
    blocks: list[Block] = [
        title,
        *(make_text(sentence, "lead") for sentence in _verdict(rows, done, failed)),
        *_found(done),
    ]
    blocks += [make_heading("Study by study", opens=False), *_studies(done)]
    blocks += _failures(failed) + _warnings(done, out)
    pdf, _ = compile_pdf(
        {
            "title": f"Fleet summary: {name}",
            "short": shorten(name, 70),
            "robot": _count(len(rows), "study", "studies"),
            "made": f"modelsel {VERSION}",
            "blocks": blocks,
        },
        {},
    )
    return pdf


def _count(n: int, one: str, many: str) -> str:
    return f"{n:,} {one if n == 1 else many}"


def _named(row: Row) -> list[str]:
    return str(row["found"]).split(" + ") if row["found"] else []


def _verdict(rows: Sequence[Row], done: Sequence[Row], failed: Sequence[Row]) -> list[str]:
    both = [row for row in done if row["nominal_mm"] is not None and row["chosen_mm"] is not None]
    out = []
    if both:
        before, after = (
            np.array([row[what] for row in both]) for what in ("nominal_mm", "chosen_mm")
        )
        worst = both[int(after.argmax())]
        out.append(
            f"Mean error on held-out configurations, median over {_count(len(both), 'study', 'studies')}: "
            f"{format_mm(float(np.median(before)))} mm nominal, {format_mm(float(np.median(after)))} mm with the chosen model. "
            f"The largest that is left: {format_mm(worst['chosen_mm'])} mm, {worst['name']}."
        )
        worse = [
            row["name"]
            for row in both
            if row["base_mm"] is not None and row["chosen_mm"] > row["base_mm"]
        ]
        if worse:
            out.append(f"Worse than with the base alone: {_some(worse)}.")
    unsure = [row["name"] for row in done if row["exit"]]
    if unsure:
        out.append(f"Done, but the chain has not converged: {_some(unsure)}.")
    if failed:
        out.append(
            f"{_count(len(failed), 'study', 'studies')} of {len(rows)} failed: {_some([row['name'] for row in failed])}."
        )
    return out


def _found(done: Sequence[Row]) -> list[Block]:
    """How often each name was found."""
    studies: dict[str, list[str]] = {}
    for row in done:
        for name in _named(row):
            studies.setdefault(name, []).append(row["name"])
    ranked = sorted(studies.items(), key=lambda item: (-len(item[1]), item[0]))
    if not ranked:
        return [make_text("Nothing beyond the base was found in any study.")]
    lines = [[shorten(name, 50), str(len(where)), _some(where)] for name, where in ranked[:NAMES]]
    more = f" And {len(ranked) - NAMES} more names." if len(ranked) > NAMES else ""
    return [
        make_table(
            [("found", "left"), ("studies", "right"), ("which", "left")],
            lines,
            f"What the chosen models have beyond the base, and in how many of {len(done)} studies.{more}",
            [0.5, 0.0, 1.0],
        )
    ]


def _studies(done: Sequence[Row]) -> list[Block]:
    if not done:
        return [make_text("No study was finished.")]
    left = sorted(done, key=lambda row: -(row["chosen_mm"] or 0.0)) if len(done) > ROWS else done
    shown = left[:ROWS]
    lines = [
        [
            row["name"],
            row["robot"] or "–",
            f"{row['estimation'] + row['held_out']:,}",
            *(format_mm(row[what]) for what in ("nominal_mm", "base_mm", "chosen_mm", "noise_mm")),
            row["found"] or ("nothing" if row["chosen_mm"] is not None else "a fit alone"),
            row["warnings"].replace(" + ", ", ") or "–",
        ]
        for row in shown
    ]
    columns = [("study", "left"), ("robot", "left")]
    columns += [(n, "right") for n in ("measured", "nominal", "base", "chosen", "noise")]
    columns += [("found beyond the base", "left"), ("warnings", "left")]
    caption = (
        "Mean error on held-out configurations [mm] of the nominal, the base and the chosen model; noise: of one coordinate "
        "[mm]. Measured: configurations. Each study's own folder has its report."
    )
    if len(done) > ROWS:
        caption += (
            f" Of {len(done)} the {ROWS} with the largest error left; all are in summary.csv."
        )
    return [make_table(columns, lines, caption, [0.55, 0.45, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.6])]


def _failures(failed: Sequence[Row]) -> list[Block]:
    if not failed:
        return []
    lines = [
        [row["name"], str(row["exit"]), shorten(" ".join(str(row["why"]).split()), LONG)]
        for row in failed[:FAILED]
    ]
    caption = "Exit: 1 internal error, 2 study file, 3 measurements, 4 not estimable."
    caption += (
        f" The first {FAILED} of {len(failed)}; all are in summary.csv."
        if len(failed) > FAILED
        else ""
    )
    return [
        make_heading("What failed", opens=False),
        make_table(
            [("study", "left"), ("exit", "right"), ("why", "left")], lines, caption, [0.3, 0.0, 1.0]
        ),
    ]


def _warnings(done: Sequence[Row], out: Path) -> list[Block]:
    """Every kind of warning once, in the words of the first study that has it."""
    first: dict[str, str] = {}
    studies: dict[str, list[str]] = {}
    for row in done:
        file = out / row["name"] / "result.json"
        if not row["warnings"] or not file.is_file():
            continue
        for warning in json.loads(file.read_text(encoding="utf-8"))["warnings"]:
            first.setdefault(warning["code"], warning["sentence"])
            where = studies.setdefault(warning["code"], [])
            where += [row["name"]] if row["name"] not in where else []
    if not first:
        return []
    lines = [
        [code, shorten(sentence, LONG), _some(studies[code])] for code, sentence in first.items()
    ]
    caption = "Of each kind one, in the words of the first study named."
    columns = [("warning", "left"), ("what it says", "left"), ("studies", "left")]
    return [
        make_heading("Warnings", opens=False),
        make_table(columns, lines, caption, [0.35, 1.0, 0.5]),
    ]


def _some(names: Sequence[str]) -> str:
    more = len(names) - SAID
    return ", ".join(shorten(n, 30) for n in names[:SAID]) + (
        f" and {more} more" if more > 0 else ""
    )
