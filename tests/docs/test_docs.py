"""The documentation site: it builds strictly and without a network, its links lead somewhere, its
catalogue is the registry's, its tables have every key."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from modelsel.cli.main import COMMANDS, INTERRUPTED
from modelsel.exceptions import CHECK_FAILED, DataError, ModelselError, NotEstimable, StudyError
from modelsel.mechanisms.registry import BUILTIN

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
CONTRACT = DOCS / "reference" / "files.md"
LOADS = {
    "script": "src",
    "img": "src",
    "iframe": "src",
    "source": "src",
    "video": "src",
    "object": "data",
    "link": "href",
}
sys.path.insert(0, str(DOCS / "making"))


# -- the site
# ------------------------------------------------------------------------------------------------------------


class _Page(HTMLParser):
    """What a page loads, where it links to, and its anchors."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loads, self.links, self.anchors = list[str](), list[str](), set[str]()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = {k: v or "" for k, v in attrs}
        if tag in LOADS and LOADS[tag] in found and found.get("rel") != "canonical":
            self.loads.append(found[LOADS[tag]])
        if tag == "a" and "href" in found:
            self.links.append(found["href"])
        self.anchors |= {found[k] for k in ("id", "name") if k in found}


@pytest.fixture(scope="module")
def site(tmp_path_factory, drawn) -> Path:
    """The site, built strictly, with the study that other tests have run: any warning of mkdocs (a
    link, an anchor, a missing page) stops it."""
    out = tmp_path_factory.mktemp("site")
    command = [
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "--strict",
        "--quiet",
        "--site-dir",
        str(out),
    ]
    nowhere = dict.fromkeys(
        ("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY"), "http://127.0.0.1:9"
    )
    built = subprocess.run(
        command,
        cwd=ROOT,
        env=os.environ | nowhere | {"NO_MKDOCS_2_WARNING": "1", "MODELSEL_EXAMPLE": str(drawn)},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert built.returncode == 0, built.stdout + built.stderr
    return out


@pytest.fixture(scope="module")
def pages(site) -> dict[Path, _Page]:
    return {
        path: _Page(path.read_text(encoding="utf-8"))
        for path in site.rglob("*.html")
        if path.parent.name != "made"
    }


def test_nothing_is_loaded_from_elsewhere(site, pages) -> None:
    assert len(pages) > 10
    for path, page in pages.items():
        away = [load for load in page.loads if urlsplit(load).netloc or load.startswith("//")]
        assert not away, f"{path.name} loads {away}"
    for path in [*site.rglob("*.css"), *site.rglob("*.svg")]:
        text = path.read_text(encoding="utf-8")
        away = re.findall(r"(?:url\(|@import|href=|src=)\s*[\"']?((?:https?:)?//[^\"')\s]+)", text)
        assert not away, f"{path.name} loads {away}"


def test_links_lead_somewhere(site, pages) -> None:
    for path, page in pages.items():
        for link in (*page.links, *page.loads):
            parts = urlsplit(link)
            if parts.scheme or parts.netloc or path.name == "404.html":
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            target = target / "index.html" if target.is_dir() else target
            assert target.is_file(), f"{path.name}: {link}"
            if parts.fragment and target in pages:
                anchors = pages[target].anchors
                assert unquote(parts.fragment) in anchors, f"{path.name}: {link}"


def test_formulas_are_drawn_without_a_script(site) -> None:
    text = (site / "explanation" / "statistics.html").read_text(encoding="utf-8")
    assert text.count("<math") > 20
    assert "arithmatex" not in text
    assert "\\(" not in text


def test_catalogue_is_the_registry(site, pages) -> None:
    page = pages[site / "reference" / "mechanisms.html"]
    assert set(BUILTIN) <= page.anchors
    assert {f"../mechanisms/{name}.svg" for name in BUILTIN} <= set(page.loads)
    pictures = {path.stem: path.stat().st_size for path in (site / "mechanisms").iterdir()}
    assert set(pictures) == set(BUILTIN)
    assert max(pictures.values()) < 40_000


def test_every_command_and_name_has_its_place(site, pages) -> None:
    import modelsel

    assert set(COMMANDS) <= pages[site / "reference" / "commands.html"].anchors
    said = (site / "reference" / "python.html").read_text(encoding="utf-8")
    assert all(f"<code>{name}</code>" in said for name in modelsel.__all__)


# -- the catalogue
# ---------------------------------------------------------------------------------------------------------


def test_a_mechanism_without_its_text_stops_the_build() -> None:
    import catalogue

    entry = next(iter(BUILTIN.values()))
    with pytest.raises(KeyError, match="hose-twist"):
        catalogue.texts({**BUILTIN, "hose-twist": entry})
    with pytest.raises(KeyError, match="refraction"):
        catalogue.texts({name: value for name, value in BUILTIN.items() if name != "refraction"})


def test_a_picture_is_the_same_bytes_twice() -> None:
    import arm
    import catalogue

    from modelsel.robot.files import load_robot

    robot = load_robot(catalogue.ROBOT)
    one, two = (arm.picture(catalogue.shown("backlash", robot), robot) for _ in range(2))
    assert one == two


def test_what_is_drawn_is_what_the_chain_does() -> None:
    """The displacement in the pictures is the columns' own, to first order, for every mechanism."""
    import arm
    import catalogue
    import numpy as np

    from modelsel.fitting.design import compute_design

    for stem in BUILTIN:
        robot = catalogue.host(stem)
        mechanism = catalogue.shown(stem, robot)
        at, _ = arm.sweep(robot, arm.driver(mechanism))
        small = 1e-3 * arm.values(mechanism.terms)
        moved = arm.displacement(at, mechanism.terms, small)
        linear = compute_design(at, mechanism.terms)[0] @ small
        assert np.abs(moved - linear).max() < 1e-2 * np.abs(linear).max(), stem
        assert np.abs(linear).max() > 0, stem


# -- notebooks
# -------------------------------------------------------------------------------------------------------------


def test_a_notebook_becomes_a_page(tmp_path) -> None:
    import notebooks

    outputs = [
        ("1 + 1", {"output_type": "execute_result", "data": {"text/plain": ["2"]}}),
        ("print(3)", {"output_type": "stream", "text": ["3\n"]}),
        ("plot()", {"data": {"image/png": "iVBO\nRw0=\n", "text/plain": "<Figure>"}}),
    ]
    cells = [
        {"cell_type": "markdown", "source": ["# First steps\n", "Some words."]},
        *(
            {"cell_type": "code", "source": source, "outputs": [output]}
            for source, output in outputs
        ),
    ]
    (tmp_path / "first_steps.ipynb").write_text(json.dumps({"cells": cells, "nbformat": 4}))
    title, text = notebooks.pages(tmp_path)["first_steps"]
    assert title == "First steps"
    assert "```python\n1 + 1\n```\n\n```text\n2\n```" in text
    assert "```text\n3\n```" in text
    assert 'src="data:image/png;base64,iVBORw0="' in text
    assert "(first_steps.ipynb)" in text


# -- the reference
# ---------------------------------------------------------------------------------------------------------


def table(heading: str) -> dict[str, list[str]]:
    """{first cell: the others} of the table below a heading of the contract page."""
    part = (
        CONTRACT.read_text(encoding="utf-8").split(f"\n## {heading}\n", 1)[1].split("\n## ", 1)[0]
    )
    rows = [line.strip("| ").split(" | ") for line in part.splitlines() if line.startswith("| `")]
    return {row[0].strip("`"): row[1:] for row in rows}


@pytest.mark.parametrize(
    ("heading", "keys"), [("Study file", "study_keys"), ("Fleet file", "fleet_keys")]
)
def test_every_key_stands_there_with_its_default(heading, keys) -> None:
    import reference

    shown = {key: cells[0].strip("`") for key, cells in table(heading).items()}
    assert shown == getattr(reference, keys)()


def test_every_key_of_a_result_is_explained(drawn) -> None:
    result = json.loads((drawn / "result.json").read_text(encoding="utf-8"))
    said = " ".join(" ".join([key, *cells]) for key, cells in table("`result.json`").items())
    parts = [
        result,
        result["ladder"][0],
        result["candidates"],
        result["findings"][0],
        result["findings"][0]["credible_set"][0],
        result["nothing_else"],
        result["parameters"][0],
        result["significance"][0],
        result["sampling"],
        result["correlation"],
        result["error_map"],
        result["configurations"],
        result["chosen"],
    ]
    assert {
        key for part in parts for key in part if not re.search(rf"(?<!\w){key}(?!\w)", said)
    } == set()


def test_every_key_of_a_calibration_is_explained(drawn) -> None:
    stored = json.loads((drawn / "calibration.json").read_text(encoding="utf-8"))
    said = " ".join(table("`calibration.json`"))
    assert {key for key in stored if key not in said} == set()


def test_constants_are_the_program_s() -> None:
    from modelsel.diagnosis.candidates.candidate_list import REGISTERED
    from modelsel.diagnosis.inference.credible_sets import ALIKE, CREDIBLE, LISTED, SURE
    from modelsel.diagnosis.search.state import LEVEL
    from modelsel.diagnosis.search.stepwise import MAX_EFFECTS

    said = {
        page: (DOCS / f"{shelf}/{page}.md").read_text(encoding="utf-8")
        for shelf, page in (
            ("explanation", "statistics"),
            ("how-to", "choose"),
            ("explanation", "limits"),
            ("reference", "files"),
        )
    }
    assert f"share {REGISTERED} of the prior" in said["statistics"]
    assert f"hold {SURE} of the probability" in said["statistics"]
    assert f"holds {CREDIBLE:.0%}".replace("%", " %") in said["statistics"]
    assert all(
        f"correlation above {ALIKE} beyond the base" in said[page]
        for page in ("statistics", "choose")
    )
    assert f"found at {LEVEL} or less" in said["files"]
    assert f"to {CREDIBLE} or {LISTED} entries" in said["files"]
    assert MAX_EFFECTS == 24
    assert "stops at twenty-four" in said["limits"]


def test_exit_status_table() -> None:
    text = (DOCS / "reference" / "commands.md").read_text(encoding="utf-8")
    statuses = {kind.exit_code for kind in (ModelselError, StudyError, DataError, NotEstimable)} | {
        INTERRUPTED,
        CHECK_FAILED,
    }
    assert set(map(str, statuses)) <= set(re.findall(r"^\| (\d+) \|", text, re.MULTILINE))
