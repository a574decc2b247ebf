"""What does not repeat, in the report: a section with sentences, a picture and a table in the PDF and
on the page, one sentence where the instrument stands alone, nothing where no part was looked for."""

from __future__ import annotations

import re
from html import escape
from pathlib import Path

import pytest
from browser import chromium, opened, resize
from error_parts import INSTRUMENT, many, part, records
from report_studies import source_of, written

from modelsel.report import drawing
from modelsel.report.document import Source, collect_blocks
from modelsel.report.figures.error_parts import MAX_REACH, measure_axis, scale_intervals
from modelsel.report.html import write_page
from modelsel.report.pages.error_budget import TITLE, tabulate_parts, write_repeatability_page
from modelsel.report.pdf import compile_pdf, fill_template
from modelsel.results.repeatability.repeatability import compute_target_rms
from modelsel.results.schemas.schema import ErrorPartRecord

HARDLY_KNOWN = part("joint 9", 1e-5, 4.5e-6, 3.1e-4, share=0.1)


def with_parts(folder: Path, parts: list[ErrorPartRecord]) -> Source:
    """The PUMA study's report with these parts."""
    result, details = written(folder)
    result["repeatability"] = [one.to_dict() for one in parts]
    return source_of(result, details)


def plain(text: str) -> str:
    return re.sub(r"\s+", "", text.replace("\u200b", ""))


# -- the PDF
# --------------------------------------------------------------------------------------------------------------------


def test_section_has_sentences_picture_and_table(drawn) -> None:
    from pypdf import PdfReader

    parts = records(*many(7))
    source = with_parts(drawn, parts)
    blocks = collect_blocks(source, drawing.PAGES, ("repeatability",))
    assert [block["kind"] for block in blocks] == ["heading", "text", "points", "figure", "table"]
    assert set(source.pictures) == {"repeatability.svg"}
    pdf, warnings = compile_pdf(fill_template(source, blocks), source.pictures)
    assert not warnings
    (drawn.parent / "budget.pdf").write_bytes(pdf)
    pages = PdfReader(drawn.parent / "budget.pdf").pages
    text = plain("".join(page.extract_text() for page in pages))
    assert plain(TITLE) in text
    assert all(plain(one.sentence) in text for one in parts)
    assert all(plain("".join(row)) in text for row in tabulate_parts(parts))


def test_a_row_has_every_figure_in_its_unit() -> None:
    first, second = tabulate_parts(records(INSTRUMENT, part("joint 2", 21.3e-6, 18.2e-6, 24.4e-6)))
    assert first == ["instrument", "8.1 µm", "7.6 to 8.7 µm", "0.014 mm", "60 %"]
    # 0.0081 mm in each of three coordinates is 0.6 of the mean square
    moved = 0.0081 * (3 * 0.4 / 0.6) ** 0.5
    assert second == ["joint 2", "21 µrad", "18 to 24 µrad", f"{moved:.2g} mm", "40 %"]


def test_section_follows_the_residuals_and_opens_no_page(drawn) -> None:
    names = list(drawing.PAGES)
    assert names.index("repeatability") == names.index("residuals") + 1
    blocks = write_repeatability_page(with_parts(drawn, records(*many(2))))
    assert blocks[0] == {"kind": "heading", "text": TITLE, "level": 1, "opens": False}


def test_the_instrument_alone_is_one_sentence(drawn) -> None:
    (alone,) = parts = records(part("instrument", 0.01, 0.009, 0.011, share=1.0))
    source = with_parts(drawn, parts)
    blocks = write_repeatability_page(source)
    assert [block["text"] for block in blocks] == [TITLE, alone.sentence]
    assert source.pictures == {}
    page = write_page(source).decode()
    assert escape(alone.sentence) in page
    assert 'class="scale range"' not in page


def test_no_part_no_section(drawn) -> None:
    source = with_parts(drawn, [])
    assert write_repeatability_page(source) == []
    assert TITLE not in write_page(source).decode()


def test_a_hardly_known_part_does_not_squeeze_the_others() -> None:
    parts = records(INSTRUMENT, HARDLY_KNOWN)
    rms, low, high = scale_intervals(parts)
    assert rms == pytest.approx(compute_target_rms(parts))
    assert low / rms == pytest.approx([one.low / one.scale for one in parts])
    end = measure_axis(rms, high)
    assert end == pytest.approx(MAX_REACH * rms.max())
    assert end < high.max()
    assert measure_axis(rms[:1], high[:1]) == high[0]


# -- the page
# --------------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def browser():
    with chromium(prefers_reduced_motion="reduce") as driver:
        yield driver


def read_widths(page, selector: str, within: str) -> list[float]:
    """Widths of elements, as shares of what they stand in."""
    script = (
        "return [...document.querySelectorAll(arguments[0])].map((e) => "
        "e.getBoundingClientRect().width / e.closest(arguments[1]).getBoundingClientRect().width)"
    )
    return page.execute_script(script, selector, within)


@pytest.mark.slow
def test_page_draws_shares_and_intervals(browser, drawn, tmp_path) -> None:
    parts = records(*many(6), HARDLY_KNOWN)
    (tmp_path / "report.html").write_bytes(write_page(with_parts(drawn, parts)))
    resize(browser, 1280, 1000)
    browser.get_log("browser")
    page = opened(browser, tmp_path / "report.html")
    assert browser.get_log("browser") == []
    section = page.find_element("id", "repeatability")
    assert all(one.sentence in section.text for one in parts)
    assert all(cell in section.text for row in tabulate_parts(parts) for cell in row)
    bars = read_widths(page, "#repeatability .bar", ".track")
    assert len(bars) == len(parts)
    # a bar stands in its cell's padding
    assert [bar / bars[0] for bar in bars] == pytest.approx(
        [one.share / parts[0].share for one in parts], rel=0.02
    )
    intervals = read_widths(page, "#repeatability .range i", ".range")
    rms, low, high = scale_intervals(parts)
    end = measure_axis(rms, high)
    drawn_to = [min(value, end) for value in high]
    assert intervals == pytest.approx((drawn_to - low) / end, abs=0.01)
    resize(page, 380, 800)
    assert page.execute_script("return document.documentElement.scrollWidth") <= 380


def test_words_of_a_part_stay_words(drawn) -> None:
    evil = '</script><script>document.title = "owned"</script>'
    parts = [one.model_copy(update={"sentence": evil}) for one in records(*many(2))]
    assert evil not in write_page(with_parts(drawn, parts)).decode()
