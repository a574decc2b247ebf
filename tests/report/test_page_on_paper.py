"""The page to explore on paper and on narrow screens: fills are printed, nothing is cut off, every bar has
its name and its scale."""

from __future__ import annotations

import pytest
from browser import chromium, opened, resize
from error_parts import many, records
from report_studies import source_of, written

from modelsel.report.html import write_page

FILLED = ("#ladder .bar", ".scale", ".scale .bar", ".range b", ".range i", "#map td[tabindex]")
PAPER = 718  # CSS pixels between the margins of a sheet of A4
ROWS = "return [...document.querySelectorAll('{}')].map((one) => {})"


@pytest.fixture(scope="module")
def page(drawn, tmp_path_factory):
    """The PUMA study's page with several parts of what does not repeat."""
    result, details = written(drawn)
    result["repeatability"] = [one.to_dict() for one in records(*many(3))]
    file = tmp_path_factory.mktemp("paper") / "report.html"
    file.write_bytes(write_page(source_of(result, details)))
    with chromium(prefers_reduced_motion="reduce") as driver:
        yield opened(driver, file)


@pytest.fixture
def paper(page):
    """The page as it is laid out for print."""
    resize(page, PAPER, 1000)
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    yield page
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})


def list_values(page, selector: str, value: str) -> list:
    return page.execute_script(ROWS.format(selector, value))


@pytest.mark.parametrize("selector", FILLED)
def test_fills_are_printed(paper, selector) -> None:
    said = list_values(paper, selector, "getComputedStyle(one).printColorAdjust")
    assert said
    assert set(said) == {"exact"}


def test_nothing_is_cut_or_scrolls_on_paper(paper) -> None:
    hidden = "[one.scrollHeight - one.clientHeight, one.scrollWidth - one.clientWidth]"
    boxes = list_values(paper, ".scroll, .wide", hidden)
    assert len(boxes) >= 3
    assert all(max(box) <= 1 for box in boxes)
    assert set(list_values(paper, ".scroll", "getComputedStyle(one).overflowY")) == {"visible"}


def test_what_is_clicked_is_not_printed(paper) -> None:
    shown = list_values(paper, "nav, #panel, .grids .tools, #reset", "one.offsetParent !== null")
    assert len(shown) == 4
    assert not any(shown)


@pytest.mark.parametrize("width", [645, 700, 850, 960, 1000, 1280])
def test_wide_tables_are_whole(page, width) -> None:
    resize(page, width, 1000)
    hidden = list_values(page, ".wide", "one.scrollWidth - one.clientWidth")
    assert len(hidden) >= 2
    assert set(hidden) == {0}


def test_bars_of_narrow_screens_have_names_and_scales(page) -> None:
    resize(page, 390, 1000)
    heads = list_values(page, "#repeatability thead th", "one.textContent")[-2:]
    before = "getComputedStyle(one, '::before').content"
    told = list_values(page, "#repeatability td.track", f"[one.dataset.head, {before}]")
    assert len(told) >= 4
    assert [name for name, _ in told[:2]] == heads
    assert all(name in content for name, content in told)
    for number in ("0 to 100 %", "at the target, 0 to "):
        assert any(number in head for head in heads)
    widths = list_values(page, "#repeatability .scale", "one.offsetWidth")
    assert min(widths) > 300


@pytest.mark.parametrize("size", [(1280, 1000), (700, 1000), (390, 800)])
def test_cube_of_vectors_is_whole_however_it_is_turned(page, size) -> None:
    """No stroke reaches the edge, from level to straight above."""
    resize(page, *size)
    drawn = page.execute_script(
        """
        const canvas = document.getElementById("space"), edges = [];
        const press = (key) => canvas.dispatchEvent(new KeyboardEvent("keydown", { key, cancelable: true }));
        press("0");
        for (let turn = 0; turn < 34; turn++) {
          press(turn < 17 ? "ArrowUp" : "ArrowLeft");
          const { width, height } = canvas, pen = canvas.getContext("2d");
          const sides = [[0, 0, width, 2], [0, height - 2, width, 2], [0, 0, 2, height], [width - 2, 0, 2, height]];
          const filled = (side) => pen.getImageData(...side).data.some((v) => v > 0);
          edges.push(sides.some(filled));
        }
        press("0");
        return edges;
        """
    )
    assert len(drawn) == 34
    assert not any(drawn)
