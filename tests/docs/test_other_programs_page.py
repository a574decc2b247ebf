"""The page on exports: its commands run, its tables have every form, its figures are the
program's."""

from __future__ import annotations

import re
import shlex
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from own_urdf import calibrated
from shown_code import ROOT, fenced

from modelsel._choices import EXPORT_FORMS, TARGET_FORMS
from modelsel.calibration.calibration_file import calibration_text
from modelsel.calibration.export.grid import CHECKED, MAX_POINTS
from modelsel.calibration.export.grid_options import LARGEST_MM
from modelsel.cli.main import run_command_line
from modelsel.robot.alignment import MAX_ANGLE, MAX_DISTANCE_MM
from modelsel.robot.files import load_robot
from modelsel.robot.rigid import transform
from modelsel.robot.urdf import read_urdf_text
from modelsel.robot.urdf_writer import write_urdf

PAGE = ROOT / "docs" / "how-to" / "other-programs.md"


@pytest.fixture(scope="module")
def page() -> str:
    return PAGE.read_text(encoding="utf-8")


def test_commands_run(page, tmp_path, monkeypatch) -> None:
    """On a calibrated UR5e that came from a URDF."""
    monkeypatch.chdir(tmp_path)
    robot = load_robot("ur5e")
    text = write_urdf(robot, {"tool0": transform()}, {})
    c = calibrated(robot, np.random.default_rng(3))
    arm = read_urdf_text(text, "ur5e.urdf", tip="tool0")
    folder = tmp_path / "reports" / "cell"
    folder.mkdir(parents=True)
    (folder / "calibration.json").write_text(calibration_text(replace(c, robot=arm)))
    (tmp_path / "ur5.urdf").write_text(text)
    q = [[0, -60, 80, -110, -90, 0], [20, -70, 90, -100, -80, 10]]
    pd.DataFrame(q, columns=[f"q{k}_deg" for k in range(1, 7)]).to_csv("targets.csv", index=False)
    ran = []
    for block in fenced("bash", page):
        for line in block.replace("\\\n", " ").splitlines():
            program, *words = shlex.split(line)
            if program != "modelsel":
                continue
            result = CliRunner().invoke(run_command_line, words)
            assert result.exit_code == 0, (line, result.output)
            out = words[words.index("--out") + 1]
            assert (tmp_path / out).stat().st_size > 100
            ran.append(words[0])
    assert ran == ["export"] * 4 + ["compensate"]


def test_every_form_is_told(page) -> None:
    for form in EXPORT_FORMS:
        assert f"| `{form}` |" in page or f"`--format {form}` " in page, form
    rows = re.findall(r"^\| `(\w+)` \| `\.", page, re.MULTILINE)
    assert tuple(rows) == TARGET_FORMS


def test_figures_are_the_program_s(page) -> None:
    words = re.sub(r"\s+", " ", page)
    assert f"more than {MAX_DISTANCE_MM:g} mm or {MAX_ANGLE * 1e3:g} mrad away" in words
    assert f"`--within` ({LARGEST_MM:g} mm), or it has {MAX_POINTS:,} points" in words
    assert f"at {CHECKED:,} places between" in words
