"""Points and joint readings in two files, after the study that was made of such two: validated,
compensated, and every message with the file and the line that people have."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner, Result

from modelsel.calibration.loading import load_calibration
from modelsel.cli.main import run_command_line
from modelsel.exceptions import DataError
from modelsel.measurements.formats.table import DataFile
from modelsel.measurements.measurements import build_measurements
from modelsel.measurements.reader import read_measurements
from modelsel.robot.files import load_robot
from modelsel.study.drafts.joined_study import draft_joined_study
from modelsel.study.simulation import simulate_points

ROWS = 60
TOOL = np.array([[40.0, -25, 120]])
POINTS = ["X [µm]", "Y [µm]", "Z [µm]"]


def run(*words: str | Path) -> Result:
    return CliRunner().invoke(run_command_line, [str(word) for word in words])


def write_pair(folder: Path, name: str, seed: int, missed: Sequence[int] = ()) -> None:
    """Write points in micrometres with a payload, and a log of readings in degrees."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.8, 1.8, (ROWS, 6))
    at = build_measurements(q, np.zeros((ROWS, 3)))
    points = simulate_points(load_robot("ur10"), TOOL, [], at=at, noise_mm=0.05, rng=rng)
    names = [f"P{k + 1:03d}" for k in range(ROWS)]
    measured = pd.DataFrame(points[["x_mm", "y_mm", "z_mm"]].to_numpy() * 1e3, columns=POINTS)
    measured.insert(0, "Point", names)
    measured["load_kg"] = np.arange(ROWS) % 2 * 3.0
    measured.drop(index=list(missed)).to_csv(folder / f"{name}.csv", index=False)
    readings = pd.DataFrame(np.degrees(q), columns=[f"A{j} [deg]" for j in range(1, 7)])
    readings.insert(0, "Name", names)
    readings.to_csv(folder / f"{name}_log.csv", index=False)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study of two files, finished, and two more of another day."""
    folder = tmp_path_factory.mktemp("joined")
    write_pair(folder, "first", 1, missed=(10,))
    write_pair(folder, "later", 2, missed=(4,))
    made = run(*pair("init", folder, "first"), "--robot", "ur10", "--yes", "--out", folder / "s")
    assert made.exit_code == 0, made.output
    with (folder / "s" / "study.toml").open("a") as file:
        file.write('\n[model]\ncandidates = ["encoder-scale"]\n')
    options = ("--out", folder / "out", "--no-report", "--no-sampling", "-q")
    done = run("study", folder / "s", *options)
    assert done.exit_code == 0, done.output
    return folder


def pair(command: str, folder: Path, name: str, *before: Path) -> list[str | Path]:
    return [command, *before, folder / f"{name}.csv", "--joints", folder / f"{name}_log.csv"]


def spoil(folder: Path, name: str, column: str, row: int, cell: object) -> None:
    """Write a pair whose points have one other cell."""
    table = pd.read_csv(folder / "later.csv").astype(object)
    table.loc[row, column] = cell
    table.to_csv(folder / f"{name}.csv", index=False)
    log = (folder / "later_log.csv").read_text()
    (folder / f"{name}_log.csv").write_text(log)


@pytest.mark.integration
def test_joined_positions_are_written_in_the_contracts_unit(folder: Path) -> None:
    """x_mm holds millimetres, though the points are in micrometres."""
    written = pd.read_csv(folder / "s" / "measurements.csv")
    points = pd.read_csv(folder / "first.csv")
    seen = written.dropna(subset="x_mm")
    assert np.allclose(seen["x_mm"], points["X [µm]"] / 1e3)
    assert written["source"][0] == "P001, first.csv line 2"
    assert written["source"][10] == "P011, first_log.csv line 12"
    assert written["source"][11] == "P012, first.csv line 12"


@pytest.mark.integration
def test_two_files_validate_a_study_of_two(folder: Path) -> None:
    ran = run(*pair("validate", folder, "later", folder / "out"))
    assert ran.exit_code == 0, ran.output
    assert 'Joined by name ("Point" = "Name"): 59 of 59 points.' in ran.stdout
    assert "still valid within noise" in ran.stdout
    assert "no position: line 6 of later_log.csv" in ran.stdout
    again = run(*pair("validate", folder, "first", folder / "out"), "--json")
    answer = json.loads(again.stdout)
    assert answer["rows"] == ROWS - 1
    assert any("made the calibration" in sentence for sentence in answer["warnings"])
    assert answer["columns"]["x_mm"] == "X [µm]"


def test_a_cell_is_named_in_the_file_that_has_it(folder: Path) -> None:
    """Line 9 of the points, which is line 10 of the log: one shot was missed before."""
    spoil(folder, "bad_load", "load_kg", 7, "heavy")
    ran = run(*pair("validate", folder, "bad_load", folder / "out"))
    assert ran.exit_code == 3
    assert (
        'bad_load.csv, line 9, column load_kg: expected a finite number, found "heavy"'
        in ran.stderr
    )
    log = pd.read_csv(folder / "later_log.csv").astype(object)
    log.loc[8, "A2 [deg]"] = "stop"
    log.to_csv(folder / "bad_log.csv", index=False)
    (folder / "bad.csv").write_text((folder / "later.csv").read_text())
    ran = run(*pair("validate", folder, "bad", folder / "out"))
    assert ran.exit_code == 3
    assert "bad_log.csv, line 10, column A2 [deg]" in ran.stderr


def test_points_alone_ask_for_the_log(folder: Path) -> None:
    ran = run("validate", folder / "out", folder / "later.csv")
    assert ran.exit_code == 3
    assert "it holds points only" in ran.stderr
    assert "--joints LOG" in ran.stderr
    lines = (folder / "later.csv").read_text().splitlines()
    bare = folder / "bare.txt"
    bare.write_text("\n".join(["# mm", *(line.rpartition(",")[0] for line in lines[1:])]))
    nameless = run("validate", folder / "out", bare)  # names, no header
    assert (nameless.exit_code, "it holds points only" in nameless.stderr) == (3, True)
    idle = run("validate", folder / "out", folder / "later.csv", "--join", "name")
    assert idle.exit_code == 2
    assert "go with --joints" in idle.stderr


@pytest.mark.parametrize("command", ["validate", "compensate"])
def test_one_file_of_readings_and_points_is_proposed_a_mapping(folder: Path, command: str) -> None:
    """A later file of another form than the two that the study was joined from."""
    points = pd.read_csv(folder / "later.csv")[["Point", *POINTS]]
    log = pd.read_csv(folder / "later_log.csv").rename(columns={"Name": "Point"})
    whole = log.merge(points)
    whole.columns = [name.replace("A", "Joint ") for name in whole.columns]
    file = folder / "whole.csv"
    whole.to_csv(file, index=False)
    out = ("--out", folder / "whole_out.csv") if command == "compensate" else ()
    ran = run(command, folder / "out", file, *out)
    assert ran.exit_code == 3
    assert 'The joint readings look like "Joint 1 [deg]" to "Joint 6 [deg]"' in ran.stderr
    assert "--column 'q6_deg=Joint 6 [deg]'" in ran.stderr
    assert "NAME1" not in ran.stderr
    assert "points only" not in ran.stderr


def test_a_joint_without_a_column_is_named(folder: Path) -> None:
    log = pd.read_csv(folder / "later_log.csv").drop(columns="A4 [deg]")
    log = log.rename(columns=lambda name: name.replace("A", "J"))
    log.to_csv(folder / "gap.csv", index=False)
    ran = run("validate", folder / "out", folder / "gap.csv")
    assert ran.exit_code == 3
    assert '"J5 [deg]" and "J6 [deg]" look like joint readings, but joint 4 of 6' in ran.stderr


def test_commands_of_a_log_are_compensated_under_its_own_names(folder: Path) -> None:
    """A log alone holds commands; with points it says where they are wanted."""
    out = folder / "commands.csv"
    ran = run("compensate", folder / "out", folder / "later_log.csv", "--out", out)
    assert ran.exit_code == 0, ran.output
    assert len(pd.read_csv(out)) == ROWS
    ran = run(*pair("compensate", folder, "later", folder / "out"), "--out", out)
    assert ran.exit_code == 0, ran.output
    commands = pd.read_csv(out)
    points = pd.read_csv(folder / "later.csv")
    assert len(commands) == ROWS - 1
    assert "made the calibration" not in ran.stdout
    ran = run(*pair("compensate", folder, "first", folder / "out"), "--out", out)
    assert "where the target was measured is taken for where it is wanted" in ran.stdout
    assert np.allclose(commands["x_mm"], points["X [µm]"] / 1e3)


def test_one_bad_shot_is_no_drift(folder: Path) -> None:
    """It is told, left out, and the others are judged; many rows that are off are a drift."""
    x = pd.read_csv(folder / "later.csv")["X [µm]"]
    spoil(folder, "far", "X [µm]", 7, x[7] + 3000.0)
    ran = run(*pair("validate", folder, "far", folder / "out"))
    assert ran.exit_code == 0, ran.output
    assert "still valid within noise, without a row that is far off" in ran.stdout
    assert "Far off, and left out: P009, line 10 of far_log.csv (" in ran.stdout
    answer = json.loads(run(*pair("validate", folder, "far", folder / "out"), "--json").stdout)
    assert answer["left_out"] == [row["row"] for row in answer["beyond_noise"]] == [8]
    many = pd.read_csv(folder / "later.csv")
    many.loc[:9, "X [µm]"] += 3000.0
    many.to_csv(folder / "far.csv", index=False)
    ran = run(*pair("validate", folder, "far", folder / "out"))
    assert ran.exit_code == 5
    assert "has drifted" in ran.stdout


def test_rows_of_a_joined_table_name_both_files(folder: Path) -> None:
    files = (DataFile(folder / "later.csv"), DataFile(folder / "later_log.csv"))
    table = draft_joined_study(*files, load_robot("ur10"), {}).contract_table()
    of_points = table.where.refuse("it is odd.", row=6, column="x_mm")
    assert (of_points.file, of_points.line, of_points.column) == ("later.csv", 7, "X [µm]")
    of_log = table.where.refuse("it is odd.", row=6, column="q1_deg")
    assert (of_log.file, of_log.line, of_log.column) == ("later_log.csv", 8, "A1 [deg]")
    assert table.where.listed([6, 7]) == "lines 8, 9 of later_log.csv"


@pytest.mark.parametrize("bound", [("-1", "2"), ("0", "20"), ("nan", "20"), ("10", "inf")])
def test_a_bound_is_two_numbers_above_zero(bound: tuple[str, str], folder: Path) -> None:
    out = folder / "bound.csv"
    later = folder / "later_log.csv"
    ran = run("compensate", folder / "out", later, "--out", out, "--bound", *bound)
    assert ran.exit_code == 2
    assert "--bound takes two numbers above 0" in ran.stderr
    assert not out.exists()


def test_a_calibration_predicts_readings_files_and_frames_alike(folder: Path) -> None:
    """A robot's name does for its measurements, too."""
    c = load_calibration(folder / "out")
    log = pd.read_csv(folder / "later_log.csv")
    readings = np.radians(log[[f"A{j} [deg]" for j in range(1, 7)]].to_numpy())
    predicted = c.predict(readings)
    assert predicted.shape == (ROWS, 3)
    assert np.allclose(c.predict(log), predicted)
    assert np.allclose(c.predict(folder / "later_log.csv"), predicted)
    measured = read_measurements(folder / "s" / "measurements.csv", "UR 10")
    assert len(measured) == ROWS - 1
    assert np.allclose(c.predict(measured), measured.position, atol=0.5)
    with pytest.raises(DataError, match="expected an array of m x 6, found 2 x 5"):
        c.predict(np.zeros((2, 5)))


def test_files_in_each_others_place_are_told_whatever_the_command(folder: Path) -> None:
    log, points = folder / "later_log.csv", folder / "later.csv"
    ran = run("validate", folder / "out", log, "--joints", points)
    assert ran.exit_code == 3
    assert (
        "the files look swapped. Give them the other way round: later.csv, and --joints"
        in ran.stderr
    )
