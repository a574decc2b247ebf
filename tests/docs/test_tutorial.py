"""The tutorial and the page on Python print what they show: every command and block is run.
`python tests/rewrite.py tutorial` writes the shown output anew."""

from __future__ import annotations

import contextlib
import re
import shutil
import tempfile
import textwrap
from pathlib import Path

from click.testing import CliRunner
from shown_code import SHOWN, fenced, printed

from modelsel.cli.main import run_command_line

ROOT = Path(__file__).parents[2]
TUTORIAL, PYTHON = (
    ROOT / "docs" / "tutorials" / "first-study.md",
    ROOT / "docs" / "reference" / "python.md",
)
AGAIN = "python tests/rewrite.py tutorial writes it anew"
CAMPAIGN = """name = "campaign"
seed = {seed}
[robot]
name = "puma760"
tool_mm = [0, 0, 100]
[measurements]
file = "measurements.csv"
[split]
estimation = {estimation}
[model]
candidates = {candidates}
[simulate]
configurations = {count}
noise_mm = 0.05
"""
EFFECT = '[[simulate.effect]]\nframe = {}\naxis = "{}"\ncause = "{}"\nsize = {}\n'
WORN = ((4, "ty", "1", 0.3), (1, "rz", "approach1", -1.5e-4))
RIVALS = '["gear-eccentricity", "axis-wobble", "joint-compliance", "base-tilt", "joint2-twist"]'


def invoked(*words: str) -> str:
    """What a command prints on the output; it must be done (0) or have said what a check found
    (5)."""
    ran = CliRunner().invoke(run_command_line, [*words])
    assert ran.exit_code in (0, 5), ran.output
    return ran.stdout


def workshop(folder: Path, text: str) -> None:
    """The files that the tutorial's commands run on: its own cell, two campaigns before and after,
    a study with rivals."""
    (folder / "cell").mkdir()
    shutil.copy(ROOT / "studies" / "puma760" / "measurements.csv", folder / "cell")
    (study,) = fenced("toml", text)
    (folder / "cell" / "study.toml").write_text(study)
    (folder / "targets.csv").write_text(fenced("csv", text)[1])
    shape = {"candidates": '"all"', "estimation": 80, "count": 120}
    for name, effects, keys in (
        ("before", [(3, "rz", "cos(q2+q3)", -1e-3)], shape | {"seed": 1}),
        ("after", [(3, "rz", "cos(q2+q3)", -1.4e-3), *WORN], shape | {"seed": 2}),
        (
            "rivals",
            [(2, "rz", "cos(q2)", -1.1e-4)],
            {"seed": 3, "candidates": RIVALS, "estimation": 50, "count": 60},
        ),
    ):
        here = folder / "studies" / name
        here.mkdir(parents=True)
        (here / "study.toml").write_text(
            CAMPAIGN.format(**keys) + "".join(EFFECT.format(*e) for e in effects)
        )
        invoked("simulate", str(here), "--out", str(here / "measurements.csv"))
        if name != "rivals":
            invoked(
                "study",
                str(here),
                "--out",
                str(folder / "reports" / name),
                "--json",
                "--no-report",
                "--no-sampling",
            )


def commands(block: str) -> str:
    """A console block as it would be now: each command, then what it prints, folded."""
    out = ""
    for line in re.findall(r"^\$ modelsel (.*)$", block, re.MULTILINE):
        shown = invoked(*line.split())
        out += f"$ modelsel {line}\n" + "".join(
            textwrap.fill(row, 112, subsequent_indent="    ", break_on_hyphens=False) + "\n"
            for row in shown.splitlines()
        )
    return out


def used(text: str, folder: Path) -> list[tuple[str, str]]:
    """(as shown, as it is now) of every console block of the tutorial."""
    workshop(folder, text)
    with contextlib.chdir(folder):
        return [(block, commands(block)) for block in fenced("console", text)]


def test_commands_print_what_is_shown(tmp_path) -> None:
    found = used(TUTORIAL.read_text(encoding="utf-8"), tmp_path)
    assert len(found) >= 7
    for shown, now in found:
        assert shown == now, AGAIN


def test_csv_shown_is_the_file_s() -> None:
    header = fenced("csv", TUTORIAL.read_text(encoding="utf-8"))[0]
    assert (
        (ROOT / "studies" / "puma760" / "measurements.csv")
        .read_text(encoding="utf-8")
        .startswith(header)
    )


def test_python_prints_what_is_shown() -> None:
    blocks = SHOWN.findall(PYTHON.read_text(encoding="utf-8"))
    assert blocks
    assert printed([code for code, _ in blocks], {}) == [output for _, output in blocks], AGAIN


def rewrite() -> None:
    """The pages' shown output as it is now."""
    text = TUTORIAL.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        for old, new in used(text, Path(folder)):
            text = text.replace(f"```console\n{old}", f"```console\n{new}")
    TUTORIAL.write_text(text, encoding="utf-8")
    text = PYTHON.read_text(encoding="utf-8")
    blocks = SHOWN.findall(text)
    for (code, old), new in zip(blocks, printed([code for code, _ in blocks], {}), strict=True):
        text = text.replace(f"{code}```\n\n```text\n{old}", f"{code}```\n\n```text\n{new}")
    PYTHON.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    rewrite()
