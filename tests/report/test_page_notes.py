"""What the page to explore says of outliers, notes and the sampling: the sentences of the PDF; and that
its picture and its figures can be read."""

from __future__ import annotations

from html import unescape
from pathlib import Path
from re import findall, sub

import pytest
from browser import chromium, opened, resize
from report_studies import read_source, source_of, written

from modelsel.notices import STEP_SIDE_OPEN
from modelsel.report.document import walk_blocks
from modelsel.report.html import write_page
from modelsel.report.pages.appendix import write_outliers_page
from modelsel.report.pages.parameter_uncertainty import write_posterior_page

EVIL = '<img src=x onerror="alert(1)">'
UNCONVERGED = "The chain has not converged after 20,000 steps: none of its numbers are quoted."


def write_section(result: dict, details: dict, name: str) -> str:
    """A section of the page, as HTML; empty where the page has none."""
    page = write_page(source_of(result, details)).decode()
    _, _, rest = page.partition(f'<section id="{name}"')
    section, _, _ = rest.partition("</section>")
    return section


def read_pieces(section: str) -> list[str]:
    """Its headings, paragraphs and items as text."""
    pieces = findall(r"<(?:h2|h3|p|li)\b[^>]*>(.*?)</(?:h2|h3|p|li)>", section)
    return [
        unescape(sub(r"<[^>]+>", "", piece)).replace("\N{NO-BREAK SPACE}", " ") for piece in pieces
    ]


def list_words(blocks: list[dict]) -> list[str]:
    """The headings, paragraphs and items of blocks."""
    words: list[str] = []
    for block in walk_blocks(blocks):
        words += block.get("items", [])
        if block["kind"] in ("heading", "text"):
            words.append(block["text"])
    return words


def test_outliers_and_notes_are_those_of_the_pdf(drawn) -> None:
    result, details = written(drawn)
    result["outliers"] = [3, 7, 40]
    result["warnings"] = [
        {"code": "target-weak", "sentence": "The rows leave open where the target sits."},
        {"code": "setup-mistake", "sentence": "Joint 3 has another zero."},
        {"code": "table-differs", "sentence": EVIL},
    ]
    section = write_section(result, details, "notes")
    said = read_pieces(section)
    assert said == list_words(write_outliers_page(source_of(result, details)))
    assert said[1].startswith("Outliers left out: 3 rows (lines 5, 9, 42)")
    assert {"Warnings", "Notes", "Joint 3 has another zero.", EVIL} <= set(said)
    assert EVIL not in section


def test_no_outlier_is_said_too(drawn) -> None:
    result, details = written(drawn)
    result["outliers"], result["warnings"] = [], []
    assert read_pieces(write_section(result, details, "notes")) == [
        "Outliers and notes",
        "No row was left out.",
    ]


def test_rows_on_an_unknown_side_of_a_step_are_left_out_and_no_outliers(drawn) -> None:
    result, details = written(drawn)
    note = "1 held-out row lies between line 38 and line 40."
    result["outliers"] = []
    result["warnings"] = [{"code": STEP_SIDE_OPEN, "sentence": note}]
    said = read_pieces(write_section(result, details, "notes"))
    assert said == ["Outliers and notes", "No row was left out as an outlier.", "Notes", note]


def test_unconverged_chains_are_said(drawn) -> None:
    result, details = written(drawn)
    result["sampling"] |= {"converged": False, "sentence": EVIL}
    result["warnings"] = [{"code": "unconverged", "sentence": UNCONVERGED}]
    section = write_section(result, details, "certainty")
    said = read_pieces(section)
    assert any("the chains had not converged when sampling ended" in one for one in said)
    assert EVIL in said
    assert EVIL not in section
    assert UNCONVERGED in read_pieces(write_section(result, details, "notes"))


def test_certainty_is_that_of_the_pdf(drawn) -> None:
    source = read_source(drawn)
    of_pdf = set(list_words(write_posterior_page(source)))
    said = read_pieces(write_section(*written(drawn), "certainty"))
    assert len(said) > 3
    assert set(said) == of_pdf


def test_the_head_links_to_what_is_there(drawn) -> None:
    result, details = written(drawn)
    result["sampling"], result["parameters"] = None, []
    result["correlation"]["pairs"] = []
    for one, absent in ((written(drawn)[0], set()), (result, {"parameters", "certainty"})):
        page = write_page(source_of(one, details)).decode()
        head, _, body = page.partition("</header>")
        links = set(findall(r'href="#(\w+)-title"', head))
        assert {"parameters", "certainty", "notes"} - links == absent
        assert all(f'id="{name}-title"' in body for name in links)


BRIGHTNESS = """
const done = arguments[0], image = document.querySelector(".drawing img"), canvas = document.createElement("canvas");
const draw = canvas.getContext("2d");
[canvas.width, canvas.height] = [image.naturalWidth, image.naturalHeight];
draw.filter = getComputedStyle(image).filter;
draw.drawImage(image, 0, 0);
done([...draw.getImageData(1, 1, 1, 1).data].slice(0, 3));
"""


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_picture_of_the_arm_has_the_ground_of_the_page(drawn, scheme) -> None:
    with chromium(prefers_color_scheme=scheme) as driver:
        opened(driver, drawn / "report.html")
        ground = driver.execute_script("return getComputedStyle(document.body).backgroundColor")
        paper = [int(value) for value in findall(r"\d+", ground)]
        picture = driver.execute_async_script(BRIGHTNESS)
        assert picture == pytest.approx(paper, abs=6)


LINES = """
const [cell] = document.querySelectorAll("#findings td[data-head='gain, rms']"), { firstChild: text } = cell;
const range = document.createRange(), at = text.data.search("mm");
range.setStart(text, 0); range.setEnd(text, at + 2);
return [text.data.slice(0, at + 2), new Set([...range.getClientRects()].map((box) => box.top)).size];
"""


@pytest.mark.slow
@pytest.mark.parametrize("width", [1280, 700, 390])
def test_a_worth_stays_on_one_line_beside_a_long_name(drawn, tmp_path: Path, width) -> None:
    result, details = written(drawn)
    for finding in details["findings"]:
        finding["label"] = "joint-transmission-with-a-long-name-of-its-own:2 and other effects"
    file = tmp_path / "report.html"
    file.write_bytes(write_page(source_of(result, details)))
    with chromium(prefers_reduced_motion="reduce") as driver:
        resize(driver, width, 1000)
        opened(driver, file)
        text, lines = driver.execute_script(LINES)
        assert text.endswith("\N{NO-BREAK SPACE}mm")
        assert lines == 1
        right = "return document.querySelector('#findings table').getBoundingClientRect().right"
        assert driver.execute_script(right) <= width
