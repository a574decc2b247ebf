"""Gear ratios: from the study file or a sheet beside the measurements, and what is looked for then."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from modelsel.cli.main import run_command_line
from modelsel.config.study_file import parse_study
from modelsel.exceptions import StudyError
from modelsel.measurements.formats.gear_ratios import find_gear_ratios
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.campaign_registry import set_gear_ratios
from modelsel.mechanisms.registry import BUILTIN, build_mechanisms
from modelsel.robot.files import load_robot
from modelsel.study.inputs.inputs import read_inputs
from modelsel.study.simulation import simulate_points

RATIOS = (121.0, 121.0, 401.0, 81.0, 80.0, 0.0)


def test_ripple_is_looked_for_at_the_turns_of_the_motor() -> None:
    robot = load_robot("ur10")
    registry = set_gear_ratios(BUILTIN, RATIOS)
    (once,) = build_mechanisms("gear-ripple:2:121", robot, registry)
    assert once.sentence == "Joint 2 turns unevenly, 121 waves a turn."
    assert build_mechanisms("gear-ripple:5:160", robot, registry)
    more = len(build_mechanisms("gear-ripple:2", robot, registry))
    assert more == len(build_mechanisms("gear-ripple:2", robot)) + 2
    assert len(build_mechanisms("gear-ripple:6", robot, registry)) == more - 2
    assert build_mechanisms("gear-ripple:3:401", robot, registry)
    with pytest.raises(StudyError, match=r"401 is not among .*gear_ratios"):
        build_mechanisms("gear-ripple:3:401", robot)
    # what is screened for without a ratio may be named
    assert build_mechanisms("gear-ripple:2:122", robot, registry)


@pytest.mark.parametrize(
    ("ratios", "said"),
    [("[121, 121]", "2 numbers, but ur10 has 6 joints"), ("[1,2,3,4,5,-6]", "a ratio is 0")],
)
def test_other_ratios_are_refused(ratios, said, tmp_path) -> None:
    head = 'name = "s"\n[robot]\nname = "ur10"\nregister = true\n'
    study = parse_study(
        f'{head}gear_ratios = {ratios}\n[measurements]\nfile = "m.csv"\n', "study.toml"
    )
    with pytest.raises(StudyError, match=said):
        read_inputs(study, tmp_path, BUILTIN)


def workbook(path: Path, rows: list[list[object]], word: str = "Getriebe lt. Liste") -> Path:
    from openpyxl import Workbook

    rng = np.random.default_rng(3)
    q = rng.uniform(-1.8, 1.8, (40, 6))
    at = build_measurements(q, np.zeros((40, 3)))
    robot = load_robot("ur10")
    points = simulate_points(robot, np.array([40.0, -25, 120]), [], at=at, noise_mm=0.05, rng=rng)
    x = points[["x_mm", "y_mm", "z_mm"]].to_numpy()
    book = Workbook()
    sheet = book.active
    sheet.append([*(f"J{k}" for k in range(1, 7)), "X", "Y", "Z"])
    for row in np.column_stack([np.degrees(q), x]).tolist():
        sheet.append(row)
    other = book.create_sheet("Mittel")
    other.append(["Reflektor", "RRR", 88203])
    other.append([word, "i"])
    for row in rows:
        other.append(row)
    book.save(path)
    return path


LISTED = [[f"Achse {k}", ratio] for k, ratio in enumerate((121, 121, 101, 81, 80, 51), 1)]


def test_a_sheet_beside_the_measurements_lists_them(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    workbook(tmp_path / "m.xlsx", LISTED)
    ran = CliRunner().invoke(run_command_line, ["init", "m.xlsx", "--robot", "ur10", "--yes"])
    assert ran.exit_code == 0, ran.output
    assert 'the sheet "Mittel", rows 3 to 8: 121, 121, 101, 81, 80, 51;' in ran.stdout
    table = tomllib.loads(Path("m/study.toml").read_text(encoding="utf-8"))
    assert table["robot"]["gear_ratios"] == [121, 121, 101, 81, 80, 51]
    dry = CliRunner().invoke(run_command_line, ["study", "m", "--dry-run"])
    assert dry.exit_code == 0, dry.output


@pytest.mark.parametrize("form", ["{}", "A{}"])
def test_the_number_of_a_joint_says_which(form, tmp_path) -> None:
    rows = [[form.format(k), ratio] for k, (_, ratio) in enumerate(LISTED, 1)]
    if form == "{}":
        rows = [[int(number), ratio] for number, ratio in rows]
    found = find_gear_ratios(workbook(tmp_path / "m.xlsx", rows, "Achse / Getriebe"), 6)
    assert found is not None
    assert found.values == (121, 121, 101, 81, 80, 51)


@pytest.mark.parametrize(
    ("rows", "word"),
    [
        (LISTED, "Grenzen"),
        (LISTED[:5], "Getriebe"),
        ([*LISTED[:2], ["Achse 3", 2000], *LISTED[3:]], "Getriebe"),
        ([*LISTED[:2], ["Achse 3", "fest"], *LISTED[3:]], "Getriebe"),
        (LISTED[::-1], "Getriebe"),
    ],
)
def test_other_lists_are_no_gear_ratios(rows, word, tmp_path) -> None:
    assert find_gear_ratios(workbook(tmp_path / "m.xlsx", rows, word), 6) is None
