"""Small findings in one line, doubt beside the name, usable numbers below: on the terminal, in the PDF and on the
page."""

from __future__ import annotations

import json
import re
from html import escape

import pytest
from report_studies import source_of, terminal_lines, written

from modelsel.report import drawing
from modelsel.report.document import Source, collect_blocks, use_minus, walk_blocks
from modelsel.report.html import write_page
from modelsel.results.sentences.small_findings import MIN_GROUPED, split_findings
from modelsel.results.sentences.study_sentences import write_figures, write_levels
from modelsel.results.sentences.tables import write_notebook_page

SUM = "Three smaller errors, 0.0213 mm rms together: some names."


def with_small(folder, small: tuple[int, ...]) -> Source:
    """The PUMA study's report where some findings, by their place, do not matter, and the second is doubtful."""
    result, details = written(folder)
    for k, finding in enumerate(result["findings"]):
        finding["matters"] = k not in small
    result["findings"][1]["doubtful"] = True
    result["small_findings"] = {"count": len(small), "rms_mm": 0.0213, "sentence": SUM}
    return source_of(result, details)


def test_every_finding_of_the_study_has_numbers_a_worst_posture_and_causes(drawn) -> None:
    result, _ = written(drawn)
    for finding in result["findings"]:
        assert finding["usable"]
        assert len(finding["worst"]["joints_deg"]) == 6
        assert finding["worst"]["mm"] > 0
        assert finding["rms_mm"] > 0
        assert finding["matters"]
        assert not finding["doubtful"]
        is_forbidden = "with the opposite sign" in finding["sentence"]
        assert bool(finding["usual_causes"]) != is_forbidden
        assert ("Usual causes: " in finding["sentence"]) != is_forbidden
    assert result["small_findings"] is None


def test_the_terminal_tells_those_that_matter_first_and_the_rest_in_one_line(drawn) -> None:
    source = with_small(drawn, (0, 2, 3))
    lines = terminal_lines(source.record, source.details)
    findings = source.record.findings
    told = [line for line in lines if line.startswith("Found")]
    levels = [write_levels(finding) for finding in findings]
    assert all("level by level: place " in line for line in levels)
    assert told == [
        f"Found, but doubtful: {findings[1].sentence} {levels[1]}",
        f"Found: {findings[4].sentence} {levels[4]}",
        f"Found: {findings[5].sentence} {levels[5]}",
    ]
    first = lines.index(told[0])
    assert lines[first + 1] == f"    {write_figures(findings[1])}"
    assert lines[first + 6] == SUM


def test_two_small_findings_are_told_in_full_in_the_order_of_all(drawn) -> None:
    record = with_small(drawn, (0, 2)).record
    assert MIN_GROUPED == 3
    assert split_findings(record.findings, record.small_findings) == ([0, 1, 2, 3, 4, 5], [])


def test_the_pdf_has_no_page_of_a_small_finding(drawn) -> None:
    source = with_small(drawn, (0, 2, 3))
    labels = [detail.label for detail in source.details.findings]
    blocks = collect_blocks(source, drawing.PAGES, ("first", "findings"))
    headings = [block["text"] for block in blocks if block["kind"] == "heading"]
    assert [words for words in headings if words.startswith(("Finding ", "Smaller"))] == [
        f"Finding 2: {labels[1]} (doubtful)",
        f"Finding 5: {labels[4]}",
        f"Finding 6: {labels[5]}",
        "Smaller findings",
    ]
    tables = [block for block in blocks if block["kind"] == "table"]
    first, last = tables[0], tables[-1]
    assert "Three smaller errors, 0.0213 mm rms together." in [b.get("text") for b in blocks]
    assert "3 smaller ones stand together in Findings." in first["caption"]
    assert [row[1] for row in first["rows"]] == [f"{labels[1]} (doubtful)", *labels[4:6]]
    assert [row[:2] for row in last["rows"]] == [
        ["1", labels[0]],
        ["3", labels[2]],
        ["4", labels[3]],
    ]
    told = " ".join(block.get("text", "") for block in walk_blocks(blocks))
    assert use_minus(write_figures(source.record.findings[4])) in told


def test_the_page_carries_what_it_tells_and_what_it_groups(drawn) -> None:
    source = with_small(drawn, (0, 2, 3))
    page = write_page(source).decode()
    found = re.search(r'id="data">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    data = json.loads(found[1])
    assert data["told"] == [1, 4, 5]
    assert data["grouped"] == [0, 2, 3]
    assert data["small"] == SUM
    assert data["figures"] == [write_figures(finding) for finding in source.record.findings]
    assert data["result"]["findings"][1]["doubtful"]


def test_a_notebook_tells_the_sum_too(drawn) -> None:
    record = with_small(drawn, (0, 2, 3)).record
    page = write_notebook_page(record)
    assert page.count(SUM) == 1
    assert '<td style="text-align:left">found, but doubtful</td>' in page
    assert escape(record.findings[2].sentence) not in page


@pytest.fixture(scope="module")
def browser():
    from browser import chromium

    with chromium(prefers_reduced_motion="reduce") as driver:
        yield driver


@pytest.mark.slow
def test_the_page_opens_what_it_groups(browser, drawn, tmp_path) -> None:
    from browser import opened

    source = with_small(drawn, (0, 2, 3))
    (tmp_path / "report.html").write_bytes(write_page(source))
    page = opened(browser, tmp_path / "report.html")
    text = page.find_element("tag name", "body").text
    findings = source.record.findings
    assert SUM in text
    assert findings[4].sentence in text
    assert write_figures(findings[4]) in text
    assert "found, but doubtful" in text
    assert findings[2].sentence not in text
    label = source.details.findings[2].label
    (button,) = [
        b for b in page.find_elements("css selector", "#findings button") if b.text.endswith(label)
    ]
    button.click()
    assert findings[2].sentence in page.find_element("id", "panel").text
