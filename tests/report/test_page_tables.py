"""What the page to explore has in common with the PDF: the calibrated parameters, what to do about each
finding, the campaign; and that narrow screens show all of it whole."""

from __future__ import annotations

from html import unescape
from re import findall, sub

import pytest
from browser import chromium, opened, resize
from report_studies import read_source, source_of, written

from modelsel.diagnosis.findings.sentences import choose_prefix
from modelsel.report.document import walk_blocks
from modelsel.report.html import write_page
from modelsel.report.pages.parameter_uncertainty import (
    QUANTILE_COLUMNS,
    tabulate_quantiles,
    write_posterior_page,
)
from modelsel.results.sentences.finding_advice import advise
from modelsel.results.sentences.parameter_table import PARAMETER_COLUMNS, tabulate_calibrated

WIDTHS = (1400, 420)
AXES = ("tx", "ty", "tz", "rx", "ry", "rz")


@pytest.fixture(scope="module")
def browser():
    with chromium(prefers_reduced_motion="reduce") as driver:
        yield driver


def css(page, selector: str) -> list:
    return page.find_elements("css selector", selector)


def page_of(result: dict, details: dict) -> str:
    return write_page(source_of(result, details)).decode()


def read_rows(page: str, of: str = "calibrated") -> list[list[str]]:
    """The rows of a table, by default that of the parameters, as text."""
    _, _, rest = page.partition(f'<table class="plain stack {of}">')
    body, _, _ = rest.partition("</table>")
    lines = findall(r"<tr>(.*?)</tr>", body)
    return [[unescape(cell) for cell in findall(r"<t[dh][^>]*>(.*?)</t", line)] for line in lines]


def test_table_of_parameters_is_that_of_the_pdf(drawn) -> None:
    source = read_source(drawn)
    rows = tabulate_calibrated(source.record, source.details)
    head, *body = read_rows((drawn / "report.html").read_text())
    assert head == [name for name, _ in PARAMETER_COLUMNS]
    assert body == [row.cells for row in rows]
    assert len(body) > 40


def test_table_of_quantiles_is_that_of_the_pdf(drawn) -> None:
    source = read_source(drawn)
    blocks = list(walk_blocks(write_posterior_page(source)))
    (table,) = [block for block in blocks if block["kind"] == "table"]
    page = page_of(*written(drawn))
    head, *body = read_rows(page, "quantiles")
    plain = [word.replace("\N{NO-BREAK SPACE}", " ") for word in head]
    assert plain == [name for name, _ in QUANTILE_COLUMNS]
    assert body == tabulate_quantiles(source.record.sampling.quantiles)
    assert len(body) > 3
    (caption,) = findall(r"<figcaption>(.*?)</figcaption>", page)
    assert unescape(caption).replace("\N{NO-BREAK SPACE}", " ") == table["caption"]


def test_no_table_of_quantiles_without_a_sampling(drawn) -> None:
    result, details = written(drawn)
    result["sampling"] = None
    assert read_rows(page_of(result, details), "quantiles") == []


SCROLLING = """
document.querySelectorAll("details").forEach((one) => { one.open = true; });
const wide = document.querySelector(".wide:has(.calibrated)");
wide.firstElementChild.style.minWidth = arguments[0];
return [document.documentElement.scrollWidth, wide.scrollWidth > wide.clientWidth];
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("width", "least", "scrolls"),
    [(1280, "0", False), (700, "0", False), (700, "60rem", True), (390, "0", False)],
)
def test_wide_tables_scroll_within_themselves(browser, drawn, width, least, scrolls) -> None:
    resize(browser, width, 900)
    opened(browser, drawn / "report.html")
    assert browser.execute_script(SCROLLING, least) == [width, scrolls]


def test_words_of_the_data_are_escaped_in_the_table(drawn) -> None:
    result, details = written(drawn)
    evil = '<img src=x onerror="alert(1)">'
    details["parameters"][0]["meaning"] = evil
    details["campaign"] = {"operator": evil}
    result["unidentifiable"][0]["sentence"] = evil
    page = page_of(result, details)
    assert evil not in page
    assert page.count("&lt;img src=x onerror=") == 3
    assert evil in [row[1] for row in read_rows(page)]


def test_long_numbers_of_causes_are_rounded(drawn) -> None:
    result, details = written(drawn)
    details["parameters"][0]["meaning"] = "joint 3, its turn × cos(q2+q3-0.2277659647)"
    meanings = [row[1] for row in read_rows(page_of(result, details))]
    assert "joint 3, its turn × cos(q2+q3-0.2278)" in meanings


def test_sets_of_effects_are_those_of_the_result(drawn) -> None:
    result, details = written(drawn)
    models = [
        {"effects": ["joint-compliance:2", "6 tx <b>"], "probability": 0.7, "chosen": True},
        {"effects": ["link-bending:1"], "probability": 0.3, "chosen": False},
    ]
    result["weighed_models"] = models
    page = page_of(result, details)
    head, *body = read_rows(page, "sets")
    assert head == ["effects", "probability"]
    instead = "link-bending:1 in place of 6 tx <b> + joint-compliance:2"
    assert body == [["the findings", "0.700"], [instead, "0.300"]]
    assert "<b>" not in page
    result["weighed_models"] = []
    assert "sets-title" not in page_of(result, details)


def test_no_parameter_no_section(drawn) -> None:
    result, details = written(drawn)
    result["parameters"] = []
    page = page_of(result, details)
    assert "parameters-title" not in page


def test_campaign_stands_in_the_head(drawn) -> None:
    result, details = written(drawn)
    assert "Serial number" not in page_of(result, details)
    details["campaign"] = {
        "date": "2026-11-22",
        "instrument": "AT960",
        "serial_number": "4711",
        "operator": "A. B.",
        "ambient": "21 degC",
    }
    head, _, _ = page_of(result, details).partition("</header>")
    said = "Date: 2026-11-22 · Instrument: AT960 · Serial number: 4711 · Operator: A. B. · Ambient: 21 degC"
    assert said in sub(r"<[^>]+>", "", head)


@pytest.mark.slow
def test_findings_say_what_to_do_and_what_it_is_worth(browser, drawn) -> None:
    source = read_source(drawn)
    opened(browser, drawn / "report.html")
    rows = css(browser, "#findings tbody tr")
    assert len(rows) == len(source.record.findings)
    for k, (row, finding) in enumerate(zip(rows, source.record.findings, strict=True)):
        advice = advise(source.record, finding)
        _, what, worth, verdict = row.find_elements("css selector", "td")
        assert what.text.endswith(f"What to do. {advice.sentence}")
        assert worth.text == advice.worth
        assert verdict.text.startswith(finding.verdict)
        browser.execute_script(
            "document.querySelectorAll('#findings button')[arguments[0]].click()", k
        )
        panel = browser.find_element("id", "panel").text
        assert f"What to do. {advice.sentence}" in panel
        assert "chance alone would do as well" in panel


def test_names_on_buttons_break_after_a_hyphen_alone(browser, drawn) -> None:
    """A word of a finding's name stands in one line."""
    resize(browser, 900, 900)
    opened(browser, drawn / "report.html")
    lines = browser.execute_script(
        "const [button] = document.querySelectorAll('#findings button'), out = []; "
        "button.textContent = '1\\u00a0joint-compliance:2'; const range = document.createRange(); "
        "for (const [from, to] of [[2, 8], [8, 20]]) { range.setStart(button.firstChild, from); "
        "range.setEnd(button.firstChild, to); out.push(range.getClientRects().length); } return out"
    )
    assert lines == [1, 1]


def test_pictures_have_the_units_of_the_sentences(browser, drawn) -> None:
    opened(browser, drawn / "report.html")
    for size in (5e-8, 5e-5, 2e-4, 1e-3, 0.3, 0.8):
        factor, unit = browser.execute_script("return scaled('rad', arguments[0])", size)
        divisor, prefixed = choose_prefix(size, "rad")
        assert unit == prefixed
        assert factor == pytest.approx(1 / divisor)


def test_causes_below_a_picture_have_four_digits(browser, drawn) -> None:
    opened(browser, drawn / "report.html")
    text = browser.execute_script(
        "return scatter({ x: [0, 1], before: [1, 1], after: [0, 0], curve: [[0, 1], [1, 1]], unit: 'mm', "
        "against: 'cos(q2+1.570796327)', title: 'Residual' }).textContent"
    )
    assert "cos(q2+1.571)" in text
    assert "1.5707" not in text


def test_the_map_s_legend_speaks_of_frames(drawn) -> None:
    page = (drawn / "report.html").read_text(encoding="utf-8")
    assert "Orange frame within a cell" in page
    assert "Orange ring" not in page


def test_narrow_cells_say_what_they_are(browser, drawn) -> None:
    """No figure and no verdict stands alone where there are no columns."""
    resize(browser, 420, 900)
    opened(browser, drawn / "report.html")
    labels = browser.execute_script(
        "return [...document.querySelectorAll('#findings tbody tr, .calibrated tbody tr')].map((row) => "
        "[...row.children].map((td) => [td.innerText, getComputedStyle(td, '::before').content]))"
    )
    assert len(labels) > 40
    for row in labels:
        for text, label in row[2:]:
            assert label.startswith('"'), (text, label)
            assert label.endswith(': "')
    assert browser.execute_script("return document.documentElement.scrollWidth") <= 420


CUT = """
const cut = [];
for (const row of document.querySelectorAll("#map thead tr")) {
  let end = -Infinity;
  for (const th of row.querySelectorAll("th")) {
    const range = document.createRange();
    range.selectNodeContents(th);
    const text = range.getBoundingClientRect(), box = document.getElementById("map").getBoundingClientRect();
    const style = getComputedStyle(th.lastChild), turned = style.writingMode.startsWith("vertical");
    // from the ends of its letters upwards and downwards, where a word is turned
    const half = (turned ? 0.95 * parseFloat(style.fontSize) : text.width) / 2, middle = (text.left + text.right) / 2;
    if (middle - half < end - 0.5 || middle + half > box.right + 0.5) cut.push(th.textContent);
    end = middle + half;
  }
}
return cut;
"""


@pytest.mark.parametrize("width", WIDTHS)
def test_heads_of_the_map_are_whole_and_apart(browser, drawn, tmp_path, width) -> None:
    """Of an arm of seven axes, too, whose target has but three columns."""
    result, details = written(drawn)
    shown, drawn_map = result["error_map"], details["map"]
    places = [f"{frame} {axis}" for frame in range(1, 8) for axis in AXES]
    places += ["8 tx", "8 ty", "8 tz"]
    count = len(places)
    for table in (shown["f"], shown["p_family_wise"], drawn_map["slopes"], drawn_map["places"]):
        table.extend([table[-1]] * (count - len(table)))
    shown["places"] = places
    drawn_map["places"] = [
        one | {"frame": int(place.split()[0]), "axis": place.split()[1]}
        for one, place in zip(drawn_map["places"], places, strict=True)
    ]
    file = tmp_path / "report.html"
    file.write_text(page_of(result, details))
    resize(browser, width, 900)
    opened(browser, file)
    labels = [th.get_attribute("aria-label") for th in css(browser, "#map thead th.group")]
    assert labels == [f"frame {k}" for k in range(1, 9)]
    assert browser.execute_script(CUT) == []


def test_pictures_of_a_finding_have_three_ticks_or_more(browser, drawn) -> None:
    opened(browser, drawn / "report.html")
    ticks = browser.execute_script(
        "const out = []; for (let k = 1; k < 400; k++) out.push(ticks(-k / 37, k / 37).length, ticks(0, k / 37).length); "
        "return [Math.min(...out), Math.max(...out)]"
    )
    assert ticks[0] >= 3
    assert ticks[1] <= 8


def test_a_line_ends_between_no_number_and_its_unit(browser, drawn) -> None:
    """In paragraphs that are written, and in cells that a script fills."""
    opened(browser, drawn / "report.html")
    parts = "document.querySelectorAll('.verdict, #findings td, #findings p')"
    joined = f"return Array.from({parts}, part => part.textContent).join('\\n')"
    text = browser.execute_script(joined)
    assert "\N{NO-BREAK SPACE}%" in text
    assert "\N{NO-BREAK SPACE}mm" in text
    assert not findall(r"\d (?:%|mm\b|µm\b|mrad\b|µrad\b|°C)", text)


def test_a_pose_beyond_the_measured_readings_says_so(browser, drawn, tmp_path) -> None:
    result, details = written(drawn)
    result["findings"][0]["worst"]["unmeasured_joints"] = [1, 4]
    for finding in result["findings"][1:]:
        finding["worst"]["unmeasured_joints"] = []
    file = tmp_path / "report.html"
    file.write_text(page_of(result, details), encoding="utf-8")
    opened(browser, file)
    said = []
    for k in (0, 1):
        browser.find_elements("css selector", "#findings button")[k].click()
        said.append(browser.find_element("id", "panel").text)
    assert "There joints 1, 4 stand beyond the measured range. Orange" in said[0]
    assert "stand beyond the measured range. Orange" not in said[1]
