"""A fleet on a terminal: a line per study that is done, then what failed and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..results.sentences.study_sentences import format_mm
from .text_tables import Row, fold_text, write_table

# columns of errors
SHOWN_ERRORS = ("nominal", "base", "chosen")
HEADS = ("measured", *SHOWN_ERRORS)
CAPTION = "Measured: configurations."


def write_fleet(studies: Sequence[Mapping[str, Any]], width: int) -> list[str]:
    """Write a fleet's rows into lines: mean held-out errors [mm] of the studies that are done, no
    name in them cut; then what failed and why."""
    lines: list[str] = []
    done = [study for study in studies if study["state"] == "done"]
    if done:
        rows = list(map(_write_study, done))
        table = write_table("study", HEADS, "found", rows, width)
        lines = ["", "Mean held-out error [mm]", *table, *fold_text(CAPTION, width)]
    for study in studies:
        if study["state"] != "done":
            lines += fold_text(f"{study['name']} failed: {study['why']}", width)
    return lines


def _write_study(study: Mapping[str, Any]) -> Row:
    measured = f"{study['estimation'] + study['held_out']:,}"
    errors = [format_mm(study[f"{model}_mm"]) for model in SHOWN_ERRORS]
    return Row(study["name"], [measured, *errors], study["found_as"] or "–")
