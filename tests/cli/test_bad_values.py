"""Values that nobody means, in study files, robot files and measurements: each is told once, in the
words of the file."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner, Result

from modelsel._files import write_atomically
from modelsel.cli.main import run_command_line
from modelsel.config.study_file import Study, parse_study
from modelsel.exceptions import DataError, StudyError
from modelsel.measurements.formats.table import load_table
from modelsel.measurements.measurements import build_measurements
from modelsel.measurements.reader import read_measurements
from modelsel.robot.files import load_robot, read_robot
from modelsel.robot.kinematics import Robot
from modelsel.study.pipeline.runner import run_study
from modelsel.study.simulation import simulate_points

STUDY = 'name = "a"\n[robot]\nname = "ur10"\n{robot}\n[measurements]\nfile = "{file}"\n{model}'
ROBOT = 'name = "arm"\n[[joint]]\nxyz_mm = [0, 0, 100]\n{joint}\n'


def run(*words: str | Path) -> Result:
    return CliRunner().invoke(run_command_line, [str(word) for word in words])


@pytest.mark.parametrize(
    ("robot", "file", "model", "said"),
    [
        ("register = 'per day'", "m.csv", "", "expected true or false or 'per group', found"),
        ("tool_mm = [1, nan, 2]", "m.csv", "", "tool_mm.2: expected a finite number, found 'nan'"),
        ("tool_mm = [1, 1e300, 2]", "m.csv", "", "tool_mm.2: expected 1000"),
        (f"tool_mm = [1, {10**305}, 2]", "m.csv", "", " digits'"),
        ("tool_mm = [1, 2]", "m.csv", "", "tool_mm: expected exactly 3 values, found"),
        (
            "register = true",
            "m.csv",
            '[model]\nbase = ["a", "a"]',
            'model.base: lists "a" twice; keep one',
        ),
        (
            "register = true",
            "m.csv",
            '[model]\nladder = [["a"], ["b", "b"]]',
            'ladder.2: lists "b" twice',
        ),
        ("tool_mm = true", "m.csv", "", "tool_mm: expected a list, found true"),
        ("register = true", "a\\u0000b", "", "file: expected text without line breaks"),
        ("register = true", "a" * 5000, "", "file: expected at most 4000 characters"),
        (
            "register = true",
            "m.csv",
            "[model]\ncandidates = 'x'",
            "expected 'all' or a list, found",
        ),
    ],
)
def test_a_wrong_value_is_told_once_in_plain_words(
    robot: str, file: str, model: str, said: str
) -> None:
    with pytest.raises(StudyError) as caught:
        parse_study(STUDY.format(robot=robot, file=file, model=model), "study.toml")
    assert len(caught.value.problems) == 1
    assert said in caught.value.problems[0]


@pytest.mark.parametrize(
    ("joint", "said"),
    [
        ("limits_mm = [0, 10]", "joint 1.limits_mm: the joint turns: its limits are limits_deg."),
        (
            'kind = "prismatic"\nlimits_deg = [0, 10]',
            "joint 1.limits_deg: the joint slides: its limits are limits_mm.",
        ),
        ("mass_kg = -3", "joint 1.mass_kg: expected a mass, 0 or above."),
    ],
)
def test_a_robot_file_is_not_read_past_what_it_says(joint: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    path.write_text(ROBOT.format(joint=joint))
    with pytest.raises(StudyError, match=said):
        read_robot(path)


def measured(robot: Robot, rows: int, **others: object) -> pd.DataFrame:
    """Readings and positions of an arm at some poses, with other columns."""
    rng = np.random.default_rng(3)
    q = robot.draw(rng, rows)
    at = build_measurements(q, np.zeros((rows, 3)))
    tool = np.array([[0.0, 0.0, 100.0]])
    points = simulate_points(robot, tool, [], at=at, noise_mm=0.05, rng=rng)
    position = points[["x_mm", "y_mm", "z_mm"]].to_numpy()
    columns = {f"q{j}_rad": q[:, j - 1] for j in range(1, robot.n + 1)}
    axes = dict(zip(("x_mm", "y_mm", "z_mm"), position.T, strict=True))
    return pd.DataFrame({**columns, **axes, **others})


def test_columns_that_are_no_causes_are_ignored_with_the_reason() -> None:
    robot = load_robot("ur10")
    rows = np.arange(12.0) ** 2
    frame = measured(robot, 12, q2=rows, torque2=rows, **{"a b": rows, "": rows, "gap": rows})
    frame.loc[3, "gap"] = np.nan
    data = read_measurements(frame, robot)
    note = next(note for note in data.notes if note.code == "covariates-ignored")
    assert '"q2" (a name that modelsel gives to values of its own)' in note.sentence
    assert '"torque2" (a name' in note.sentence
    assert '"a b" (not a plain word)' in note.sentence
    assert "one without a name" in note.sentence
    words = '"gap" (an empty cell in DataFrame, row 3; every row needs a number, 1e+30 at most)'
    assert words in note.sentence


@pytest.mark.parametrize("value", [-300.0, 293.15], ids=["below absolute zero", "kelvin"])
def test_what_no_robot_stands_is_no_temperature(value: float) -> None:
    robot = load_robot("ur10")
    frame = measured(robot, 12, temperature_C=20.0)
    frame.loc[4, "temperature_C"] = value
    words = r"row 4, column temperature_C: .* between -273\.15 and 200"
    with pytest.raises(DataError, match=words):
        read_measurements(frame, robot)


def test_a_load_has_a_mass() -> None:
    robot = load_robot("ur10")
    frame = measured(robot, 12, payload_kg=5.0)
    frame.loc[4, "payload_kg"] = -5.0
    words = r"row 4, column payload_kg: .* between 0 and 5000, found \"-5"
    with pytest.raises(DataError, match=words):
        read_measurements(frame, robot)


@pytest.mark.slow
def test_check_says_what_study_would_refuse(tmp_path: Path) -> None:
    """Positions that do not move at all are no arm's."""
    robot = load_robot("ur10")
    measured(robot, 60).assign(x_mm=1.0, y_mm=2.0, z_mm=3.0).to_csv(tmp_path / "m.csv", index=False)
    ran = run("check", tmp_path / "m.csv", "--robot", "ur10")
    assert ran.exit_code == 0
    assert (
        "of the length of the arm's links and target in all from where the robot has them, and `modelsel study` refuses"
        in ran.stdout
    )
    measured(robot, 1).to_csv(tmp_path / "one.csv", index=False)
    ran = run("check", tmp_path / "one.csv", "--robot", "ur10")
    assert ran.stdout.startswith("1 row, 1 configuration,")


@pytest.mark.parametrize(
    ("more", "status"),
    [
        ("", 0),
        ('[split]\ncolumn = "role"\n', 3),
        ("[split]\nestimation = 500\n", 2),
        ("[split]\nestimation = 2\n", 4),
        ('[model]\nbase = ["geometrc"]\n', 2),
    ],
    ids=["none", "column", "too many", "too few", "name"],
)
def test_check_ends_as_the_study_would(more: str, status: int, tmp_path: Path) -> None:
    """With its sentence and its status, in words and as JSON."""
    robot = load_robot("ur10")
    measured(robot, 40).to_csv(tmp_path / "m.csv", index=False)
    text = STUDY.format(robot="tool_mm = [0, 0, 100]", file="m.csv", model=more)
    (tmp_path / "study.toml").write_text(text)
    refused = run("study", tmp_path, "--dry-run")
    checked = run("check", tmp_path)
    as_json = run("check", tmp_path, "--json")
    assert [ran.exit_code for ran in (refused, checked, as_json)] == [status] * 3
    told = json.loads(as_json.stdout)["study"]
    assert told["exit"] == status
    said = [f"modelsel: {sentence}" for sentence in told["refused"] or ()]
    if status:
        assert refused.stderr.splitlines() == said
        assert "`modelsel study` refuses this study: " in checked.stdout


def test_a_folder_is_no_measurements_file(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"it is a folder\. Give the file"):
        load_table(tmp_path)


def test_init_says_which_cell_keeps_a_column_from_being_used(tmp_path: Path) -> None:
    robot = load_robot("ur10")
    frame = measured(robot, 40, load_kg=2.0).astype(object)
    frame.loc[7, "load_kg"] = "heavy"
    frame.to_csv(tmp_path / "m.csv", index=False)
    ran = run("init", tmp_path / "m.csv", "--robot", "ur10", "--yes", "--out", tmp_path / "s")
    assert ran.exit_code == 0, ran.output
    assert 'Not used: "load_kg" ("heavy" in m.csv, line 9).' in ran.stdout


def test_init_says_how_a_column_of_numbers_could_be_looked_at(tmp_path: Path) -> None:
    """Brackets and strokes cannot stand in a formula; under the name that is proposed it is looked at."""
    robot = load_robot("ur10")
    frame = measured(robot, 40).assign(**{"Vorschub [mm/min]": np.arange(40) % 7 * 100.0})
    file, out = tmp_path / "m.csv", tmp_path / "s"
    frame.to_csv(file, index=False)
    said = run("init", file, "--robot", "ur10", "--yes", "--out", out).stdout
    proposed = re.search(r'Not used: "Vorschub \[mm/min\]" \(call it (\w+) in the file', said)
    assert proposed is not None, said
    frame.rename(columns={"Vorschub [mm/min]": proposed[1]}).to_csv(file, index=False)
    said = run("init", file, "--robot", "ur10", "--yes", "--out", tmp_path / "t").stdout
    assert f'Looked at as possible causes of errors, too: "{proposed[1]}".' in said


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes on Windows")
def test_nothing_takes_the_place_of_a_pipe(tmp_path: Path) -> None:
    """Nor of a device: /dev/null stays what it is."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(StudyError, match="a device or a pipe, not a file"):
        write_atomically(pipe, b"new")
    assert pipe.is_fifo()
    with pytest.raises(StudyError, match="it is a folder"):
        write_atomically(tmp_path, b"new")


@pytest.mark.integration
def test_positions_that_are_all_the_same_are_no_metres() -> None:
    robot = load_robot("ur10")
    frame = measured(robot, 40)
    frame[["x_mm", "y_mm", "z_mm"]] = 1.0, 2.0, 3.0
    table = {"name": "ur10", "register": True}
    with pytest.raises(DataError) as caught:
        run_study(Study(name="same", robot=table, measurements=frame), sampling=False)
    assert caught.value.remedy.startswith("Every row has the same position: check the columns")


@pytest.mark.slow
def test_large_readings_are_written_out(tmp_path: Path) -> None:
    """Positions in the columns of the joints."""
    frame = measured(load_robot("ur10"), 12)
    frame.columns = pd.Index([*"XYZ", *(f"A{j}" for j in range(1, 7))])
    frame[["A4", "A5", "A6"]] = frame[["A4", "A5", "A6"]].abs() + 3000
    frame.to_csv(tmp_path / "m.csv", index=False)
    ran = run("init", tmp_path / "m.csv", "--robot", "ur10", "--yes", "--out", tmp_path / "out")
    assert re.search(r'"A1" to "A6" in degrees \(up to \d,\d\d0\)\.', ran.stdout), ran.stdout
