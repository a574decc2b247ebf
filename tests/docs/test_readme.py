"""README and CONTRIBUTING say what is true: their Python runs and prints what they show, the report
is the study's. `python tests/rewrite.py readme` writes the README's shown output anew."""

from __future__ import annotations

import ast
import html
import io
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from builders import drawn
from click.testing import CliRunner
from house_rules import FLOORS, INNER_FLOORS, PACKAGE
from shown_code import ROOT, SHOWN, fenced, printed

import modelsel
from modelsel import load_calibration
from modelsel.cli.main import COMMANDS, run_command_line
from modelsel.config.study_file import parse_study
from modelsel.exceptions import StudyError
from modelsel.fitting.design import compute_design, residuals
from modelsel.measurements.reader import read_measurements
from modelsel.mechanisms.registry import BUILTIN, build_mechanisms, with_plugins
from modelsel.report.terminal import WIDTH, show_study
from modelsel.robot.files import load_robot

README, CONTRIBUTING = ROOT / "README.md", ROOT / "CONTRIBUTING.md"
AGAIN = "python tests/rewrite.py readme writes it anew"


def section(title: str, text: str) -> str:
    """The part of a page below a heading."""
    return re.split(r"\n##+ ", text.split(f"## {title}\n", 1)[1])[0]


def excerpt(result: modelsel.Result) -> str:
    """What a study prints before the files that it has written."""
    from rich.console import Console

    stream = io.StringIO()
    show_study(result.record, result.details, Console(file=stream, width=WIDTH))
    return stream.getvalue().lstrip("\n")


def floors() -> str:
    """The list of the package's folders, top to bottom, with what each says of itself; the folders in
    one are below it."""
    lines = []
    for folder in FLOORS[1:]:
        lines.append(f"{folder + '/':17}{first_line(folder)}")
        lines += [
            f"{f'  {inner}/':17}{first_line(f'{folder}/{inner}')}"
            for inner in INNER_FLOORS.get(folder) or inner_folders(folder)
        ]
    return "\n".join(lines) + "\n"


def inner_folders(folder: str) -> list[str]:
    """The folders of modules in one whose order is no rule."""
    return sorted(path.parent.name for path in (PACKAGE / folder).glob("*/__init__.py"))


def first_line(folder: str) -> str:
    """What a folder of the package says of itself."""
    text = (PACKAGE / folder / "__init__.py").read_text(encoding="utf-8")
    return (ast.get_docstring(ast.parse(text)) or "").partition("\n")[0]


@pytest.fixture(scope="module")
def page() -> str:
    return README.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def ran(page) -> tuple[list[str], dict[str, object]]:
    names: dict[str, object] = {}
    return printed([code for code, _ in SHOWN.findall(page)], names), names


def test_python_prints_what_is_shown(page, ran) -> None:
    shown = [output for _, output in SHOWN.findall(page)]
    assert len(shown) == len(fenced("python", page)) == 1, "a block of Python without its output"
    assert ran[0] == shown, AGAIN


def test_at_most_twelve_lines_beside_imports(page) -> None:
    for block in fenced("python", page):
        assert (
            len(
                [line for line in block.splitlines() if line and not re.match(r"from|import", line)]
            )
            <= 12
        )


def test_excerpt_is_what_the_study_prints(page, ran) -> None:
    assert fenced("text", section("What it says", page)) == [excerpt(ran[1]["result"])], AGAIN


def test_a_study_of_your_own_is_one(page) -> None:
    """The study file and the table shown are read as they stand."""
    (toml,), (table,) = (fenced(kind, section("Your own data", page)) for kind in ("toml", "csv"))
    study = parse_study(toml, "README.md")
    found = read_measurements(
        pd.read_csv(io.StringIO(table)), load_robot(study.robot.name).prismatic
    )
    assert (study.robot.register_, study.measurements.file, found.q.shape) == (
        True,
        "measurements.csv",
        (1, 6),
    )


def test_report_shown_is_the_study_s(ran) -> None:
    """reports/puma760: the page has the verdict of the study as it runs now, the calibration its
    estimates."""
    folder, result = ROOT / "reports" / "puma760", ran[1]["result"]
    again = "run modelsel study studies/puma760/study.toml, then python tests/rewrite.py page"
    written = (folder / "report.html").read_text(encoding="utf-8")
    page = html.unescape(written).replace("\N{NO-BREAK SPACE}", " ")
    assert all(sentence in page for sentence in result.record.verdict), again
    kept = load_calibration(folder / "calibration.json")
    assert kept.theta == pytest.approx(result.calibration.theta, rel=1e-6, abs=1e-12), again


def test_commands_and_links_exist(page) -> None:
    text = page + CONTRIBUTING.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([\w./-]+)(?:#[\w-]+)?\)", text):
        assert (ROOT / target).exists(), f"{target} does not exist"
    for target in re.findall(r"(?<![\w/])studies/(?!NAME)[\w-]+/[\w-]+\.\w+", text):
        assert (ROOT / target).exists(), f"{target} does not exist"
    for command in set(re.findall(r"`(?:\.venv/bin/)?modelsel (\w+)", text)):
        assert command in COMMANDS, f"modelsel {command} does not exist"


def test_floors_are_those_of_the_test(page) -> None:
    (shown,) = fenced("text", section("How it is built", page))
    assert shown == floors(), AGAIN


# -- CONTRIBUTING: a mechanism in ten lines
# ----------------------------------------------------------------------------


@pytest.fixture
def plugin(tmp_path, monkeypatch) -> Path:
    """The example installed: its module and its entry point, as pip would leave them."""
    text = section("A mechanism in ten lines", CONTRIBUTING.read_text(encoding="utf-8"))
    (code,), (toml,) = fenced("python", text), fenced("toml", text)
    (tmp_path / "hosepack.py").write_text(code, encoding="utf-8")
    info = tmp_path / "hosepack-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: hosepack\nVersion: 1.0\n")
    group, line = re.search(r'\[project\.entry-points\."(.+?)"\]\n(.+)', toml).groups()
    (info / "entry_points.txt").write_text(f"[{group}]\n{line.replace(chr(34), '')}\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("sys.dont_write_bytecode", True)
    yield tmp_path
    import sys

    sys.modules.pop("hosepack", None)


def test_example_is_a_mechanism(plugin, rng) -> None:
    registry, broken = with_plugins()
    assert not broken
    (name,) = set(registry) - set(BUILTIN)
    (mechanism,) = build_mechanisms(name, load_robot("puma760"), registry)
    at = drawn("puma760", rng, 40)
    columns, h = compute_design(at, mechanism.terms)[0], 1e-5
    for j, term in enumerate(mechanism.terms):
        low, high = (residuals(at, [term], np.array([step])) for step in (-h, h))
        difference = (low - high) / (2 * h)  # residual = measured - predicted
        assert np.abs(columns[:, :, j] - difference).max() <= 1e-6 * np.abs(difference).max()
        assert np.abs(difference).max() > 1
    with pytest.raises(StudyError):
        build_mechanisms(name, load_robot("puma760"))


def test_example_prints_as_shown(plugin) -> None:
    text = section("A mechanism in ten lines", CONTRIBUTING.read_text(encoding="utf-8"))
    (shown,) = fenced("console", text)
    command, _, output = shown.partition("\n")
    result = CliRunner().invoke(run_command_line, command.removeprefix("$ modelsel ").split())
    assert result.output == output


def rewrite() -> None:
    """The README with its shown output, excerpt and names of mechanisms as they are now."""
    text, names = README.read_text(encoding="utf-8"), {}
    blocks = SHOWN.findall(text)
    for (code, old), new in zip(blocks, printed([code for code, _ in blocks], names), strict=True):
        text = text.replace(f"{code}```\n\n```text\n{old}", f"{code}```\n\n```text\n{new}")
    said = section("What it says", text)
    text = text.replace(said, said.replace(fenced("text", said)[0], excerpt(names["result"])))
    (shown,) = fenced("text", section("How it is built", text))
    README.write_text(text.replace(shown, floors()), encoding="utf-8")


if __name__ == "__main__":
    rewrite()
