"""README's table of real robots says what the studies' own pages say."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROW = re.compile(
    r"^\| \[([\w-]+)\]\(studies/.*\| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \|$", re.MULTILINE
)
SHOWN = {name: figures for name, *figures in ROW.findall((ROOT / "README.md").read_text("utf-8"))}


def test_every_study_of_a_real_robot_is_shown() -> None:
    studies = {folder.parent.name for folder in ROOT.glob("studies/*/README.md")}
    assert SHOWN.keys() == studies - {"puma760"}


@pytest.mark.parametrize("name", SHOWN)
def test_its_figures_are_those_of_its_page(name) -> None:
    page = (ROOT / "studies" / name / "README.md").read_text("utf-8")
    own = re.findall(r"^\| (?:nominal|geometric|chosen)\b.*\| ([\d.]+) \|$", page, re.MULTILINE)
    for shown, figure in zip(SHOWN[name], own, strict=True):
        decimals = len(shown.partition(".")[2])
        assert shown == f"{float(figure):.{decimals}f}"
