"""summary.pdf of a fleet: notes are counted beside each study and told once below, on few pages."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import pytest

from modelsel.report.pages.fleet_summary import write_summary

# pages are read by a package that the unit tests do without
pytestmark = pytest.mark.integration

NOTES = ("columns-ignored", "approach-from-order", "counters-ignored", "table-differs")


def make_study(name: str, folder: Path, codes: tuple[str, ...]) -> dict[str, Any]:
    """A row of a fleet, and the notes of its result."""
    notes = [{"code": code, "sentence": f"What {code} says."} for code in codes]
    (folder / name).mkdir()
    (folder / name / "result.json").write_text(json.dumps({"warnings": notes}))
    errors = {"nominal_mm": 1.9, "base_mm": 0.3, "chosen_mm": 0.04, "noise_mm": 0.02}
    counts = {"estimation": 60, "held_out": 40, "exit": 0}
    found = "encoder-eccentricity:1 + approach-backlash:3"
    words = {"name": name, "state": "done", "robot": "ur5", "found": found}
    words["found_as"] = f"{found} (doubtful)"
    return {**words, **counts, **errors, "warnings": " + ".join(codes)}


def read_pages(rows: list[dict[str, Any]], folder: Path) -> list[str]:
    from pypdf import PdfReader

    pages = PdfReader(io.BytesIO(write_summary("Halle 3", rows, folder))).pages
    return [" ".join(page.extract_text().split()) for page in pages]


def test_notes_are_counted_and_told_once_on_one_page(tmp_path) -> None:
    rows = [make_study(f"arm{k}", tmp_path, NOTES) for k in range(4)]
    (page,) = read_pages(rows, tmp_path)
    assert "Warnings" not in page
    assert "found beyond the base notes" in page
    assert page.count("approach-backlash:3 (doubtful)") == len(rows)
    for code in NOTES:
        assert page.count(f"What {code} says.") == 1


def test_words_of_one_study_are_not_those_of_the_others(tmp_path) -> None:
    """What a note quotes may hold in one study alone; the same words are nobody's."""
    rows = [make_study(f"arm{k}", tmp_path, NOTES) for k in range(3)]
    notes = [{"code": code, "sentence": f"Other {code}."} for code in NOTES[:1]]
    (tmp_path / "arm2" / "result.json").write_text(json.dumps({"warnings": notes}))
    (page,) = read_pages(rows, tmp_path)
    assert f"arm0: What {NOTES[0]} says. Others say it in other words." in page
    assert f"arm0: What {NOTES[1]}" not in page


@pytest.mark.parametrize(("count", "of"), [(1, "1 study"), (2, "2 studies")])
def test_one_study_is_one(tmp_path, count, of) -> None:
    rows = [make_study(f"arm{k}", tmp_path, ()) for k in range(count)]
    (page,) = read_pages(rows, tmp_path)
    assert f"What the chosen models of {of} have beyond the base" in page


def test_what_looks_wrong_is_a_warning(tmp_path) -> None:
    rows = [make_study("arm", tmp_path, ("setup-mistake", *NOTES))]
    (page,) = read_pages(rows, tmp_path)
    warnings, _, notes = page.partition("One warning of each kind")
    assert "What setup-mistake says." in warnings
    assert "What setup-mistake says." not in notes
    assert "What columns-ignored says." in notes
