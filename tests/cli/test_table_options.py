"""Tables that leave their sheet or their decimal mark open, given to the commands that read one
without a study file."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from modelsel.cli.main import run_command_line
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward

TOOL = np.array([40.0, -25.0, 100.0])
STUDY = """name = "cell"
seed = 1
[robot]
name = "puma560"
tool_mm = [40, -25, 100]
[measurements]
file = "measurements.csv"
[model]
candidates = []
[noise]
floor_mm = 0.02
"""


def run(*words: str) -> tuple[int, str]:
    result = CliRunner().invoke(run_command_line, list(words))
    return result.exit_code, result.output


def points(seed: int, count: int = 60) -> pd.DataFrame:
    """Thousandths of a degree and of a mm."""
    rng = np.random.default_rng(seed)
    robot = load_robot("puma560")
    q = np.radians(np.degrees(robot.draw(rng, count)).round(3))
    x = forward(robot, q, TOOL) + rng.normal(0, 0.02, (count, 3))
    columns = {f"q{k}_deg": np.degrees(column) for k, column in enumerate(q.T, 1)}
    return pd.DataFrame(columns | dict(zip(("x_mm", "y_mm", "z_mm"), x.T, strict=True))).round(3)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A study, a book of two sheets and a text whose commas may be either."""
    home = tmp_path_factory.mktemp("cell")
    points(1).to_csv(home / "measurements.csv", index=False)
    (home / "study.toml").write_text(STUDY)
    with pd.ExcelWriter(home / "book.xlsx") as book:
        points(2).to_excel(book, sheet_name="May", index=False)
        points(3, 20).to_excel(book, sheet_name="June", index=False)
    rows = points(2)
    is_open = (rows.abs() >= 1).all(axis=1) & (rows.abs() < 1000).all(axis=1)
    text = rows[is_open].map(lambda value: f"{value:.3f}".replace(".", ","))
    text.to_csv(home / "open.csv", sep=";", index=False)
    done = run("study", str(home), "--out", str(home / "out"), "--no-report", "--no-sampling")
    assert done[0] == 0, done[1]
    return home


COMMANDS = {
    "check": ("check", "{data}", "--robot", "puma560"),
    "validate": ("validate", "out", "{data}"),
    "compensate": ("compensate", "out", "{data}", "--out", "corrected.csv"),
    "plan": ("plan", ".", "--pool", "{data}", "--count", "3"),
}


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_sheet_and_decimal_mark(folder, monkeypatch, command: str) -> None:
    monkeypatch.chdir(folder)
    for data, option, problem in (
        ("book.xlsx", ("--sheet", "May"), "2 sheets hold a table of numbers"),
        ("open.csv", ("--decimal", "comma"), "(a decimal comma)"),
    ):
        words = [word.format(data=data) for word in COMMANDS[command]]
        status, said = run(*words)
        assert status == 3, said
        assert problem in said
        assert option[0] in said
        status, said = run(*words, *option)
        assert status == 0, said
    status, said = run(
        *[word.format(data="book.xlsx") for word in COMMANDS[command]], "--sheet=July"
    )
    assert (status, 'no sheet "July"' in said) == (3, True)


@pytest.mark.integration
def test_plan_without_a_pool_reads_no_table(folder, monkeypatch) -> None:
    monkeypatch.chdir(folder)
    status, said = run("plan", ".", "--sheet", "May")
    assert (status, "--pool" in said) == (2, True)
