"""Gravity that is not known, or cannot be right where the robot stands, is said; gravity, target and
frame can be stated."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner, Result

from modelsel.cli.main import run_command_line
from modelsel.config.study_file import parse_study
from modelsel.exceptions import StudyError
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.notices import Note
from modelsel.results.conclusions.cautions import explain_unknown_gravity
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward
from modelsel.robot.rigid import rotation_matrix
from modelsel.study.inputs.inputs import read_nominal_robot
from modelsel.study.inputs.stated_setup import StatedSetup, point_gravity
from modelsel.study.preparation.gravity_direction import note_gravity

TOOL = np.array([40.0, -25, 120])
ROBOT = load_robot("ur10")


def placed(turn: np.ndarray) -> Problem:
    data = build_measurements(np.zeros((1, 6)), np.zeros((1, 3)))
    return Problem(ROBOT, data, TOOL[None], placement=(turn[None], np.zeros((1, 3))))


@pytest.mark.parametrize(
    ("degrees", "said"), [(180, True), (172, True), (165, False), (0, False), (90, False)]
)
def test_gravity_along_the_frames_z_is_warned_of(degrees, said) -> None:
    problem = placed(rotation_matrix(0, np.radians(degrees)))
    notes = note_gravity(ROBOT, problem, False)
    assert [note.code for note in notes] == ["gravity-upwards"] * said
    assert note_gravity(ROBOT, problem, True) == []
    if degrees == 180:
        assert "write gravity = [0, 0, 1] under [robot]" in notes[0].sentence
        assert "--gravity 0 0 1)" in notes[0].sentence
    hanging = point_gravity(ROBOT, (0, 0, 2))
    upright = note_gravity(hanging, placed(np.eye(3)), False)
    assert "the robot's gravity is [0, 0, -1]" in upright[0].sentence


def test_a_place_that_is_no_number_is_refused() -> None:
    with pytest.raises(StudyError, match=r"--tool: expected three finite .* found nan 0\.0 0\.0"):
        StatedSetup(tool=(np.nan, 0.0, 0.0))
    with pytest.raises(StudyError, match=r"--gravity: expected three finite"):
        StatedSetup(gravity=(0.0, 0.0, -np.inf))
    with pytest.raises(StudyError, match=r"--gravity: expected a direction .* such as 0 0 -1"):
        StatedSetup(gravity=(0.0, 0.0, 0.0)).place(ROBOT)
    assert StatedSetup(gravity=(0.0, -1e-200, 0.0)).place(ROBOT).gravity == (0, -1, 0)


def test_unknown_gravity_stands_in_the_verdict() -> None:
    unknown = note_gravity(replace(ROBOT, gravity=None), placed(np.eye(3)), False)
    said = explain_unknown_gravity(unknown)
    assert "were not looked for, since no direction of gravity is known" in said
    assert "write gravity = [0, 0, -1] under [robot]" in said
    assert explain_unknown_gravity([Note("file-format", "plain")]) == ""


def test_a_study_states_gravity(tmp_path) -> None:
    text = 'name = "a"\n[robot]\nname = "ur10"\nregister = true\ngravity = {}\n[measurements]\nfile = "m.csv"\n'
    study = parse_study(text.format("[0, 3, 4]"), "study.toml")
    assert read_nominal_robot(study, tmp_path).gravity == (0.0, 0.6, 0.8)
    with pytest.raises(StudyError, match="the direction has no length"):
        parse_study(text.format("[0, 0, 0]"), "study.toml")
    plain = parse_study(text.replace("gravity = {}\n", ""), "study.toml")
    assert "gravity" not in plain.model_dump()["robot"]


def invoked(*words: object) -> Result:
    return CliRunner().invoke(run_command_line, [str(word) for word in words])


def write(turn: np.ndarray) -> None:
    rng = np.random.default_rng(5)
    q = rng.uniform(-1.8, 1.8, (40, 6))
    points = (forward(ROBOT, q, TOOL) + rng.normal(0, 0.05, (40, 3))) @ turn.T
    frame = pd.DataFrame(np.degrees(q).round(4), columns=[f"J{k}" for k in range(1, 7)])
    frame[["X", "Y", "Z"]] = points.round(3)
    frame.to_csv("m.csv", index=False)


def test_init_states_the_set_up(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    write(np.eye(3))
    ran = invoked(
        *["init", "m.csv", "--robot", "ur10", "--yes", "--aligned", "--tool", "40", "-25", "120"]
    )
    assert ran.exit_code == 0, ran.output
    assert "As aligned, with the target given, the nominal arm fits to 0.0" in ran.stdout
    robot = tomllib.loads(Path("m/study.toml").read_text())["robot"]
    assert robot == {"name": "ur10", "register": False, "tool_mm": [40, -25, 120]}
    assert invoked("study", "m", "--dry-run").exit_code == 0
    refused = invoked(*["init", "m.csv", "--robot", "ur10", "--yes", "--aligned", "--out", "n"])
    assert (refused.exit_code, "--tool X Y Z" in refused.output) == (2, True)
    far = invoked(
        *[
            "init",
            "m.csv",
            "--robot",
            "ur10",
            "--yes",
            "--aligned",
            "--tool",
            "40",
            "900",
            "120",
            "--out",
            "f",
        ]
    )
    assert "That is far" in far.stdout


def test_init_warns_of_gravity_and_takes_another(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    write(rotation_matrix(0, np.pi))
    words = ["init", "m.csv", "--robot", "ur10", "--yes"]
    warned = invoked(*words)
    assert "points along +z of the measurements' frame" in warned.stdout
    stated = invoked(*words, "--gravity", 0, 0, 1, "--out", "s")
    assert "points along +z" not in stated.stdout
    assert tomllib.loads(Path("s/study.toml").read_text())["robot"]["gravity"] == [0, 0, 1]
    mapped = invoked(
        *words,
        "--column",
        "q1_deg=J1",
        *[f"--column=q{k}_deg=J{k}" for k in range(2, 7)],
        "--out",
        "c",
    )
    assert 'As given: q1_deg = "J1", q2_deg = "J2"' in mapped.stdout


@pytest.mark.slow
def test_gravity_is_not_questioned_where_the_arm_is_far_off(tmp_path, monkeypatch) -> None:
    """The zero of joint 5 is 40° off: first the mistake, then where the robot stands."""
    monkeypatch.chdir(tmp_path)
    write(rotation_matrix(0, np.pi))
    frame = pd.read_csv("m.csv")
    frame["J5"] += 40
    frame.to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert "(median): that is far" in ran.stdout
    assert "gravity" not in ran.stdout.lower()
    dry = invoked("study", "m", "--dry-run")
    assert dry.exit_code == 0
    assert "joint 5" in dry.stdout
    assert "gravity" not in dry.stdout.lower()
