"""The page to explore, in a browser: opens without a word or a request, is worked by mouse and by
keys, reads light and dark.

`python tests/rewrite.py page` writes the README's pictures of the report anew, from reports/puma760.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from browser import chromium, opened, requests, resize
from report_studies import read_source, source_of, written

from modelsel.report.html import write_page as html

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def browser():
    with chromium(prefers_reduced_motion="reduce") as driver:
        yield driver


@pytest.fixture
def page(browser, drawn):
    resize(browser, 1280, 1000)
    browser.get_log("browser")
    browser.get_log("performance")
    return opened(browser, drawn / "report.html")


def css(page, selector: str) -> list:
    return page.find_elements("css selector", selector)


def cell(page, place: str, cause: str):
    (found,) = css(page, f"td[aria-label^='{place}, cause {cause}, ']")
    return found


def test_opens_in_silence_and_asks_no_network(page) -> None:
    assert page.get_log("browser") == []
    asked = requests(page)
    assert asked
    assert all(url.startswith(("file:", "data:")) for url in asked), asked


def test_verdict_ladder_and_findings_are_there(page, drawn) -> None:
    result, text = (
        json.loads((drawn / "result.json").read_text()),
        page.find_element("tag name", "body").text,
    )
    assert all(sentence in text for sentence in result["verdict"])
    assert all(finding["sentence"] in text for finding in result["findings"])
    assert len(css(page, "#ladder tbody tr")) == 8


def test_whole_map_is_there_and_says_itself(page, drawn) -> None:
    shown = result_map(drawn)
    cells = css(page, "td[role=gridcell][tabindex]")
    assert len(cells) == sum(v is not None for row in shown["f"] for v in row)
    label = cell(page, "frame 5 rz", "q4").get_attribute("aria-label")
    i, j = shown["places"].index("5 rz"), shown["causes"].index("q4")
    assert f"F {shown['f'][i][j]:.3g}" in label
    assert f"p {shown['p_family_wise'][i][j]:.3g}" in label
    assert "named in a finding" in label
    assert [t.get_attribute("role") for t in css(page, "table.map")] == ["grid", "grid"]


def result_map(folder: Path) -> dict:
    return json.loads((folder / "result.json").read_text())["error_map"]


def test_click_on_a_cell_shows_its_panel(page) -> None:
    chosen = cell(page, "frame 5 rz", "q4")
    page.execute_script("arguments[0].scrollIntoView({block: 'center', inline: 'center'})", chosen)
    chosen.click()
    text = page.find_element("id", "panel").text
    assert text.startswith("frame 5 rz · q4")
    assert "Joint 5 turns with joint 4." in text  # the mechanism's card
    assert re.search(r"wrist-coupling:5\n0\.9", text)  # the credible set
    assert len(css(page, "#panel svg")) == 2  # the residual against the cause, from chosen and base
    assert len(css(page, "#panel svg circle")) > 200
    assert chosen.get_attribute("aria-selected") == "true"
    css(page, "#panel button")[0].click()
    assert css(page, "#panel h3")[0].text == "Finding 3: wrist-coupling:5"
    assert page.get_log("browser") == []


def test_points_of_a_cell_are_the_python_s(page, drawn) -> None:
    """The page's own residual about frame 5 rz against q4 is what details.json holds for the
    finding."""
    source = read_source(drawn)
    i, j = (result_map(drawn)[k].index(v) for k, v in (("places", "5 rz"), ("causes", "q4")))
    got = page.execute_script(
        f"const d = JSON.parse(document.getElementById('data').textContent); return numbers(d, {i}, {j})"
    )
    (panel,) = next(f for f in source.details.findings if f.label == "wrist-coupling:5").panels
    assert got["x"] == pytest.approx(panel.x, abs=1e-2)
    assert got["after"] == pytest.approx(panel.after, abs=3e-6)


@pytest.mark.slow
@pytest.mark.parametrize("place", ["frame 1 rz", "frame 2 rz", "frame 7 tx"])
def test_every_kind_of_cell_opens(page, place) -> None:
    """Waves, pairs, single causes, ripples: a picture with finite numbers, no word on the
    console."""
    pictures = page.execute_script(
        f"return [...document.querySelectorAll(\"td[aria-label^='{place}, ']\")].map("
        "(td) => { td.click(); return document.getElementById('panel').innerHTML; })"
    )
    assert len(pictures) > 20
    assert not [p for p in pictures if "NaN" in p or "Infinity" in p]
    assert page.get_log("browser") == []


def test_keyboard_reaches_and_opens_a_cell(page) -> None:
    from selenium.webdriver.common.keys import Keys

    first = css(page, "#map td[tabindex='0']")
    assert len(first) == 1  # one stop of the tab key for the whole map
    for _ in range(40):
        page.switch_to.active_element.send_keys(Keys.TAB)
        if page.switch_to.active_element == first[0]:
            break
    assert page.switch_to.active_element == first[0]
    page.switch_to.active_element.send_keys(Keys.ARROW_DOWN)
    page.switch_to.active_element.send_keys(Keys.ARROW_RIGHT)
    now = page.switch_to.active_element
    assert now != first[0]
    assert [c.get_attribute("tabindex") for c in (now, first[0])] == ["0", "-1"]
    now.send_keys(Keys.ENTER)
    place, cause = re.match(
        r"(frame \S+ \S+), cause (.+), F", now.get_attribute("aria-label")
    ).groups()
    assert page.find_element("id", "panel").text.startswith(f"{place} · {cause}")
    assert page.find_element("id", "panel").get_attribute("aria-live") == "polite"


def picture(page) -> bytes:
    return page.execute_script("return document.getElementById('space').toDataURL()")


def test_workspace_turns_and_switches_rungs(page) -> None:
    from selenium.webdriver.common.keys import Keys

    canvas, after = page.find_element("id", "space"), picture(page)
    canvas.send_keys(Keys.ARROW_LEFT)
    turned = picture(page)
    assert turned != after
    page.find_element("id", "reset").click()
    assert picture(page) == after
    from selenium.webdriver.common.action_chains import ActionChains

    ActionChains(page).move_to_element(canvas).click_and_hold().move_by_offset(
        60, 20
    ).release().perform()
    assert picture(page) != after
    page.find_element("id", "reset").click()
    page.find_element("id", "before").click()
    assert picture(page) != after
    assert "nominal" in page.find_element("id", "space-status").text
    assert page.find_element("id", "before").get_attribute("aria-pressed") == "true"
    page.find_element("id", "after").click()
    assert picture(page) == after


WEIGHTS = (0.2126, 0.7152, 0.0722)  # of red, green and blue in relative luminance (WCAG 2.1)


def luminance(colour: str) -> float:
    channels = [int(v) / 255 for v in re.findall(r"\d+", colour)[:3]]
    return sum(
        w * (c / 12.92 if c <= 0.03928 else ((c + 0.055) / 1.055) ** 2.4)
        for w, c in zip(WEIGHTS, channels, strict=True)
    )


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_contrast_in_both_schemes(drawn, scheme) -> None:
    """Text against the page: 4.5 to 1 at least (WCAG 2.1, 1.4.3)."""
    with chromium(prefers_color_scheme=scheme) as driver:
        opened(driver, drawn / "report.html")
        ground = driver.execute_script("return getComputedStyle(document.body).backgroundColor")
        assert (luminance(ground) > 0.5) == (scheme == "light")
        for selector in ("h1", "h2", ".quiet", ".verdict", "#findings td", ".map th"):
            ink = driver.execute_script(
                f"return getComputedStyle(document.querySelector('{selector}')).color"
            )
            low, high = sorted((luminance(ink), luminance(ground)))
            assert (high + 0.05) / (low + 0.05) >= 4.5, selector


WIDTHS = (1400, 420)


@pytest.mark.parametrize("width", WIDTHS)
def test_maps_fit_their_windows(page, width) -> None:
    """Every cell of every column lies between the edges of its window, and can be scrolled to."""
    resize(page, width, 900)
    outside = page.execute_script(
        "return [...document.querySelectorAll('.scroll')].flatMap((host) => { "
        "const box = host.getBoundingClientRect(); "
        "return [...host.querySelectorAll('td[tabindex]')].filter((td) => { "
        "const at = td.getBoundingClientRect(); "
        "return at.left < box.left || at.right > box.right || at.width < 4; }); }).length"
    )
    assert outside == 0
    assert page.execute_script("return document.documentElement.scrollWidth") <= width
    reached = page.execute_script(
        "const host = document.getElementById('map'); host.scrollTop = host.scrollHeight; "
        "const last = [...host.querySelectorAll('td[tabindex]')].pop().getBoundingClientRect(); "
        "return last.bottom <= host.getBoundingClientRect().bottom + 1"
    )
    assert reached


SEEN = """
const at = arguments[0].getBoundingClientRect(), box = arguments[0].closest(".scroll").getBoundingClientRect();
return at.top >= Math.max(0, box.top) && at.bottom <= Math.min(innerHeight, box.bottom);
"""


@pytest.mark.parametrize("width", WIDTHS)
def test_finding_chosen_shows_its_cell_its_curve_and_the_arm(page, drawn, width) -> None:
    resize(page, width, 900)
    result, details = written(drawn)
    buttons = css(page, "#findings button")
    assert len(buttons) == len(result["findings"])
    for k, button in enumerate(buttons):
        page.execute_script("arguments[0].click()", button)
        chosen = css(page, "td[aria-selected='true']")
        labels = [td.get_attribute("aria-label") for td in chosen]
        screws = result["findings"][k]["credible_set"][0]["screws"]
        assert chosen
        assert all(", named in a finding" in label for label in labels)
        assert {label.split(",")[0] for label in labels} <= {
            f"frame {screw['frame']} {screw['axis']}" for screw in screws
        }
        assert any(page.execute_script(SEEN, td) for td in chosen)
        panel = page.find_element("id", "panel")
        assert f"Finding {k + 1}: {details['findings'][k]['label']}" in panel.text
        assert page.execute_script(
            "return arguments[0].getBoundingClientRect().top < innerHeight", panel
        )
        assert page.switch_to.active_element == panel
        pictures = len(details["findings"][k]["panels"]) + 1
        assert len(css(page, "#panel svg")) == pictures
        assert "NaN" not in panel.get_attribute("innerHTML")
    assert page.get_log("browser") == []


def test_what_is_left_beside_the_credible_set_is_told(browser, drawn, tmp_path) -> None:
    """The bars of a finding and the rest are one together; nothing where no rest is."""
    for share in (0.8, 1.0):
        result, details = written(drawn)
        finding = result["findings"][0]
        finding["credible_set"] = [finding["credible_set"][0] | {"probability": share}]
        finding.pop("levels"), finding.pop("claim")
        details["findings"][0]["rivals"] = details["findings"][0]["rivals"][:1]
        file = tmp_path / f"{share}.html"
        file.write_bytes(html(source_of(result, details)))
        opened(browser, file)
        button = css(browser, "#findings button")[0]
        browser.execute_script("arguments[0].click()", button)
        text = browser.find_element("id", "panel").text
        told = "The other 0.20 is the probability of less likely explanations, and of shapes"
        assert (told in text) == (share == 0.8)


def test_free_function_marks_the_cells_of_its_place_and_driver(browser, drawn, tmp_path) -> None:
    """It has no cell of its own: that is said, and the strongest that q4 alone drives is marked."""
    result, details = written(drawn)
    k = next(k for k, one in enumerate(details["findings"]) if one["label"] == "wrist-coupling:5")
    result["findings"][k]["credible_set"][0]["screws"][0]["cause"] = "free(q4)"
    (tmp_path / "report.html").write_bytes(html(source_of(result, details)))
    opened(browser, tmp_path / "report.html")
    css(browser, "#findings button")[k].click()
    (chosen,) = css(browser, "td[aria-selected='true']")
    shown = result["error_map"]
    row = shown["f"][shown["places"].index("5 rz")]
    driven = [
        (row[j], cause)
        for j, cause in enumerate(shown["causes"])
        if row[j] is not None
        and set(re.findall(r"q\d|[a-z]+\d?", cause)) - {"sin", "cos"} == {"q4"}
    ]
    assert len(driven) > 1
    assert f", cause {max(driven)[1]}, " in chosen.get_attribute("aria-label")
    assert "no cell of this finding's own shape" in browser.find_element("id", "panel").text


def test_arm_is_posed_where_the_finding_errs_most(page, drawn) -> None:
    """The joints that the finding moves are filled; the arrow is its largest displacement."""
    result, _ = written(drawn)
    for k, finding in enumerate(result["findings"]):
        page.execute_script(
            "document.querySelectorAll('#findings button')[arguments[0]].click()", k
        )
        (title,) = css(page, "#panel svg.posture title")
        assert f"by {finding['worst']['mm']:.3g} mm" in title.get_attribute("textContent")
        frames = {screw["frame"] for screw in finding["credible_set"][0]["screws"]}
        filled = css(page, "#panel svg.posture circle[fill='var(--ring)']")
        assert len(filled) == len(frames - {7})


def test_arm_turns_by_keys_and_by_mouse(page) -> None:
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.keys import Keys

    css(page, "#findings button")[0].click()
    (arm,) = css(page, "#panel svg.posture")
    page.execute_script("arguments[0].scrollIntoView({block: 'center'})", arm)
    before = arm.get_attribute("innerHTML")
    for key in (Keys.ARROW_LEFT, Keys.ARROW_UP, "+"):
        arm.send_keys(key)
        assert arm.get_attribute("innerHTML") != before
        arm.send_keys("0")
        assert arm.get_attribute("innerHTML") == before
    ActionChains(page).move_to_element(arm).click_and_hold().move_by_offset(
        40, 10
    ).release().perform()
    assert arm.get_attribute("innerHTML") != before


def test_findings_are_walked_and_linked_to(page, drawn) -> None:
    css(page, "#findings button")[0].click()
    previous, following = css(page, "#panel .tools button")
    assert not previous.is_enabled()
    following.click()
    assert "Finding 2:" in page.find_element("id", "panel").text
    page.get("about:blank")
    page.get(f"{(drawn / 'report.html').as_uri()}#finding-3")
    assert "Finding 3:" in page.find_element("id", "panel").text


def test_causes_come_by_strength_or_by_kind(page, drawn) -> None:
    shown = result_map(drawn)

    def causes() -> list[str]:
        return [th.get_attribute("title") for th in css(page, "#map tbody th")]

    def strength(cause: str) -> float:
        column = shown["causes"].index(cause)
        return max(row[column] or 0 for row in shown["f"])

    by_strength = causes()
    assert [strength(c) for c in by_strength] == sorted(map(strength, by_strength), reverse=True)
    css(page, "#order option[value='cause']")[0].click()
    by_kind = causes()
    assert by_kind == sorted(by_strength, key=shown["causes"].index)
    assert by_kind != by_strength


def test_narrow_screens_need_no_sideways_scroll(page) -> None:
    resize(page, 380, 800)
    assert page.execute_script("return document.documentElement.scrollWidth") <= 380


@pytest.mark.parametrize("width", [1280, 400])
def test_names_without_blanks_need_no_sideways_scroll(browser, drawn, tmp_path, width) -> None:
    """The study's, the operator's, and those of targets in the table of parameters."""
    result, details = written(drawn)
    name = "W" * 200
    result["study"] = name
    details["campaign"] = {"operator": name}
    details["parameters"][0]["meaning"] = f"target along the flange's x, target {name}"
    (tmp_path / "report.html").write_bytes(html(source_of(result, details)))
    opened(browser, tmp_path / "report.html")
    resize(browser, width, 900)
    for one in css(browser, "details"):
        browser.execute_script("arguments[0].open = true", one)
    assert browser.execute_script("return document.documentElement.scrollWidth") <= width


def test_words_of_the_data_stay_words(browser, drawn, tmp_path) -> None:
    result, details = written(drawn)
    evil = '</script><script>document.title = "owned"</script><img src=x onerror="document.title=\'owned\'">'
    result["study"] = result["verdict"][0] = result["findings"][0]["sentence"] = evil
    details["findings"][0]["label"] = evil
    (tmp_path / "report.html").write_bytes(html(source_of(result, details)))
    browser.get_log("browser")
    opened(browser, tmp_path / "report.html")
    css(browser, "#findings button")[0].click()
    assert browser.title == f"Calibration report: {evil}"
    assert browser.find_element("tag name", "h1").text == evil
    assert evil in browser.find_element("id", "panel").text
    assert css(browser, "img[src='x'], img[onerror]") == []
    assert browser.get_log("browser") == []


def test_little_to_show(browser, drawn, tmp_path) -> None:
    """No finding, no cell, nothing held out."""
    result, details = written(drawn)
    result["findings"], details["findings"] = [], []
    result["error_map"] = {"places": [], "causes": [], "f": [], "p_family_wise": []}
    details["map"] = {"places": [], "columns": [], "slopes": [], "named": []}
    for rung in result["ladder"]:
        rung["held_out"] = dict.fromkeys(rung["held_out"]) | {"rows": 0, "left_out": 0}
    (tmp_path / "report.html").write_bytes(html(source_of(result, details)))
    browser.get_log("browser")
    opened(browser, tmp_path / "report.html")
    assert "nothing was scanned" in browser.find_element("id", "map").text
    assert "on estimation configurations" in browser.find_element("id", "space-status").text
    assert browser.get_log("browser") == []


def rewrite() -> None:
    """reports/puma760-*.png: the first page of the PDF, the page to explore with a finding chosen."""
    folder = ROOT / "reports" / "puma760"
    first = [
        "pdftoppm",
        "-png",
        "-r",
        "72",
        "-f",
        "1",
        "-l",
        "1",
        "-singlefile",
        folder / "report.pdf",
    ]
    subprocess.run([*first, ROOT / "reports" / "puma760-pdf"], check=True)
    with chromium(prefers_reduced_motion="reduce", prefers_color_scheme="light") as driver:
        resize(driver, 1180, 1010)
        opened(driver, folder / "report.html")
        css(driver, "#findings button")[2].click()
        driver.execute_script("document.activeElement.blur()")
        driver.save_screenshot(ROOT / "reports" / "puma760-html.png")


if __name__ == "__main__":
    sys.exit(rewrite())
