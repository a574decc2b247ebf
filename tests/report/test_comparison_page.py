"""Two studies on one page: what each says, which findings both have, and which parameters changed."""

from __future__ import annotations

import json
import re
from html import unescape
from pathlib import Path

import pytest
from browser import chromium, requests, resize
from click.testing import CliRunner

from modelsel.cli.main import run_command_line
from modelsel.report.comparison_page import Name, _write_figure, match_findings

STUDY = """name = "{name}"
seed = {seed}
[robot]
name = "puma760"
tool_mm = [0, 0, 100]
[measurements]
file = "measurements.csv"
[split]
estimation = 80
[simulate]
configurations = 120
noise_mm = 0.05
"""
EFFECT = '[[simulate.effect]]\nframe = {}\naxis = "{}"\ncause = "{}"\nsize = {}\n'
SOFTER = (3, "rz", "cos(q2+q3)", 1.4e-3)
BEFORE, AFTER = (
    [(3, "rz", "cos(q2+q3)", 1e-3)],
    [SOFTER, (4, "ty", "1", 0.3), (1, "rz", "approach1", -1.5e-4)],
)


def run(*words: object, status: int = 0) -> str:
    done = CliRunner().invoke(run_command_line, [str(word) for word in words])
    assert done.exit_code == status, done.output
    return done.output


@pytest.fixture(scope="module")
def reports(tmp_path_factory) -> Path:
    """Two studies of one arm: joint 3 softens, play comes into joint 1, link 3 is bent."""
    folder = tmp_path_factory.mktemp("compared")
    for seed, (name, effects) in enumerate((("spring", BEFORE), ("<i>autumn</i>", AFTER)), 1):
        place = folder / f"s{seed}"
        place.mkdir()
        text = STUDY.format(name=name, seed=seed) + "".join(EFFECT.format(*e) for e in effects)
        (place / "study.toml").write_text(text)
        run("simulate", place, "--out", place / "measurements.csv")
        run("study", place, "--out", place, "--no-report", "--no-sampling", "--json")
    return folder


@pytest.fixture(scope="module")
def page(reports) -> Path:
    said = run("compare", reports / "s1", reports / "s2", "--html", reports / "both.html")
    assert said.endswith(f"Written: {reports / 'both.html'}\n")
    return reports / "both.html"


def text_of(page: Path) -> str:
    text = unescape(re.sub(r"<[^>]+>", "", page.read_text(encoding="utf-8")))
    return text.replace("\N{NO-BREAK SPACE}", " ")


def record(reports: Path, number: int) -> dict:
    return json.loads((reports / f"s{number}" / "result.json").read_text())


@pytest.mark.integration
def test_page_says_what_the_studies_and_the_command_say(reports, page) -> None:
    text = text_of(page)
    for number in (1, 2):
        result = record(reports, number)
        assert all(sentence in text for sentence in result["verdict"])
        details = json.loads((reports / f"s{number}" / "details.json").read_text())
        assert result["findings"]
        assert all(f"{one['label']}{one['what']}" in text for one in details["findings"])
    said = json.loads(run("compare", reports / "s1", reports / "s2", "--json"))
    assert all(sentence in text for sentence in said["sentences"])
    explained = said["explained_by"]
    assert explained
    table = page.read_text().split('class="plain stack parameters"')[1].split("</table>")[0]
    assert re.findall(r"<b>(\w+)</b>", table) == [one["symbol"] for one in explained]
    moves = [one["moves_mm"] for one in explained]
    assert moves == sorted(moves, reverse=True)
    moved = sum(change["p"] <= 0.05 for change in said["changes"])
    tested = len(said["changes"])
    assert f"{tested} parameters tested one by one, {moved} beyond chance" in text


@pytest.mark.integration
def test_findings_of_both_and_of_one_alone(reports, page) -> None:
    table = page.read_text().split('class="plain stack findings"')[1].split("</table>")[0]
    rows = [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in table.split("<tr>")[2:]]
    assert [row[0] for row in rows] == ["both", "the second only"]
    assert rows[0][3].count(" grew: ") == 1
    for number, cell in enumerate(rows[0][1:3], 1):
        label = json.loads((reports / f"s{number}" / "details.json").read_text())["findings"][0][
            "label"
        ]
        assert label in cell
        assert label in rows[0][3]
    assert rows[1][1] == "–"
    assert "approach-backlash:1" in rows[1][2]
    assert "approach-backlash:1 appeared" in rows[1][3]


@pytest.mark.slow
@pytest.mark.parametrize("width", [1400, 420])
def test_page_reads_at_both_widths_and_asks_for_nothing(page, width) -> None:
    with chromium(prefers_color_scheme="light") as driver:
        resize(driver, width, 900)
        driver.get_log("performance")  # of the browser's own start
        driver.get(page.as_uri())
        assert driver.execute_script("return document.documentElement.scrollWidth") <= width
        assert driver.get_log("browser") == []
        assert all(url.startswith(("file:", "data:")) for url in requests(driver))
        assert driver.find_element("tag name", "h1").text == "spring → <i>autumn</i>"
        first, second = (side.rect for side in driver.find_elements("class name", "side"))
        assert (first["y"] == second["y"]) == (width == 1400)


@pytest.mark.integration
def test_a_calibration_without_its_study_is_refused(reports, tmp_path) -> None:
    kept = tmp_path / "calibration.json"
    kept.write_bytes((reports / "s1" / "calibration.json").read_bytes())
    run("compare", kept, reports / "s2")
    said = run("compare", kept, reports / "s2", "--html", tmp_path / "both.html", status=2)
    assert "there is no result.json" in said
    assert not (tmp_path / "both.html").exists()


def test_figures_have_no_powers_of_ten() -> None:
    assert _write_figure(112.4, 2) == "110"
    assert _write_figure(-0.01234, 2) == "−0.012"


def named(label: str, *others: str) -> Name:
    return Name(label, frozenset((label, *others)))


def test_matching_takes_names_first_then_what_moves_alike() -> None:
    a, b, twin, other = named("a"), named("b", "c"), named("c", "b"), named("d", "c")
    assert match_findings([a, b], [b, a]) == [(0, 1), (1, 0)]
    assert match_findings([a, b], [twin, b]) == [(1, 1), (0, None), (None, 0)]
    assert match_findings([a, b], [twin]) == [(1, 0), (0, None)]
    assert match_findings([twin], [other]) == [(0, None), (None, 0)]
    assert match_findings([], [a]) == [(None, 0)]
