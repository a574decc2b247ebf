"""Real robots' studies run, and say what their READMEs say: figures to the digits shown, the first
finding by name."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from modelsel.config.study_file import read_study
from modelsel.results.repeatability.repeatability import format_scale
from modelsel.study.pipeline.result import Result
from modelsel.study.pipeline.runner import run_study

STUDIES = Path(__file__).parents[2] / "studies"
DATA = {"wam-tracker": "jacobi-wam", "positioner": "rct-positioner", "tiago-mocap": "tiago-mocap"}


def find_data(folder: str) -> Path:
    """The data of a real robot. Absent data fail the test, unless MODELSEL_NO_DATA=1 says that this
    is meant."""
    data = Path(os.environ.get("MODELSEL_DATA") or Path(__file__).parents[3] / "shared" / "data")
    if not (data / folder).is_dir():
        if os.environ.get("MODELSEL_NO_DATA") == "1":
            pytest.skip("MODELSEL_NO_DATA=1")
        pytest.fail(
            f"{folder} is not at {data}: set MODELSEL_DATA, or MODELSEL_NO_DATA=1 to go without"
        )
    return data


def ran(name: str, monkeypatch: pytest.MonkeyPatch) -> Result:
    """The study's result."""
    monkeypatch.setenv("MODELSEL_DATA", str(find_data(DATA[name])))
    return run_study(read_study(STUDIES / name / "study.toml"), STUDIES / name, sampling=False)


def shown(name: str) -> dict[str, list[float]]:
    """Rows of the README's table of results: the first word -> its numbers, NaN for a dash."""
    page = (STUDIES / name / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (nominal|geometric|chosen)[^|]*\|(.+)\|$", page, re.MULTILINE)
    return {
        word: [float(cell.replace("–", "nan")) for cell in cells.split("|") if cell.strip()]
        for word, cells in rows
    }


@pytest.mark.long
@pytest.mark.parametrize("name", ["wam-tracker", "tiago-mocap", "positioner"])
def test_study_says_what_its_readme_says(name, monkeypatch) -> None:
    result, said = ran(name, monkeypatch), shown(name)
    base = next(r for r in result.models.ladder if r.names == ("geometric",))
    for word, rung in (
        ("nominal", result.models.ladder[0]),
        ("geometric", base),
        ("chosen", result.models.chosen),
    ):
        fitted, held_out = said[word][1], said[word][-1]
        assert rung.estimation.mean_mm == pytest.approx(fitted, abs=0.006), word
        assert rung.held_out.mean_mm == pytest.approx(held_out, abs=0.006), word
    assert result.models.chosen.held_out.mean_mm < base.held_out.mean_mm
    page = " ".join((STUDIES / name / "README.md").read_text(encoding="utf-8").split())
    for part in result.diagnosis.search.errors.parts:
        if part.name.startswith("joint"):
            scale, interval = format_scale(part)
            assert f"{scale} ({interval.rpartition(' ')[0]})" in page, part.name
    if name == "wam-tracker":
        effects = {one.effect.candidate.label: one.effect for one in result.diagnosis.findings}
        assert effects["approach-backlash:1"].named.verdict == "found"


TIAGO = """name = "tiago"
seed = 1
[robot]
file = "{robot}"
register = true
[measurements]
file = "tiago-mocap/measurements.csv"
[split]
estimation = 26
[model]
base = ["geometric"]
candidates = "all"
"""


@pytest.mark.long
def test_an_arm_far_off_is_fitted_as_well_under_parts_of_the_noise(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nominal 40 mm off, eight joints: weights for what rows share must not end the fit early."""
    data = find_data("tiago-mocap")
    monkeypatch.setenv("MODELSEL_DATA", str(data))
    held_out = []
    for number, noise in enumerate(("", "[noise]\nparts = []\n")):
        folder = tmp_path / str(number)
        folder.mkdir()
        robot = (data / "tiago-mocap" / "robot.toml").as_posix()
        (folder / "study.toml").write_text(TIAGO.format(robot=robot) + noise, encoding="utf-8")
        result = run_study(read_study(folder / "study.toml"), folder, sampling=False)
        held_out.append(result.models.chosen.held_out.mean_mm)
    assert held_out[0] < 1.1 * held_out[1]
