"""A simple mistake of the set-up is found and told, each planted in data of arms with errors of
their own."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders import OFF_AXIS, planted, seeds, study_with
from builders import drawn as drawn_arm
from click.testing import CliRunner
from report_studies import terminal_lines
from setup_mistakes import Change, arm, said, shifted

from modelsel._typing import Array
from modelsel.cli.main import run_command_line
from modelsel.config.study_file import read_study
from modelsel.exceptions import DataError
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.geometry import geometric
from modelsel.mechanisms.registry import BUILTIN
from modelsel.notices import SETUP_MISTAKE
from modelsel.results.sentences.study_sentences import opening_sentences
from modelsel.robot.files import load_robot
from modelsel.robot.rigid import from_rpy
from modelsel.study.inputs.inputs import read_inputs
from modelsel.study.pipeline.runner import run_study
from modelsel.study.preparation.preparation import prepare

STUDIES = Path(__file__).parents[2] / "studies"
RIGHT_ANGLE = np.pi / 2


def sense(*joints: int) -> Change:
    return lambda q, x: (q * [-1.0 if j + 1 in joints else 1.0 for j in range(q.shape[1])], x)


def columns(a: int, b: int) -> Change:
    def change(q: Array, x: Array) -> tuple[Array, Array]:
        order = np.arange(q.shape[1])
        order[[a - 1, b - 1]] = b - 1, a - 1
        return q[:, order], x

    return change


MISTAKES: dict[str, tuple[Change, str]] = {
    **{f"sense {j}": (sense(j), f"joint {j} turns the other way") for j in (1, 2, 3, 4, 5, 6)},
    "two senses": (sense(2, 3), "joint 2 turns the other way and joint 3 turns the other way"),
    "many senses": (sense(1, 2, 4, 5), "joints 1, 2, 4 and 5 turn the other way"),
    "zero 90": (shifted(3, RIGHT_ANGLE), "90° is subtracted from q3"),
    "zero -90": (shifted(2, -RIGHT_ANGLE), "90° is added to q2"),
    "zero 180": (shifted(4, 2 * RIGHT_ANGLE), "180° is added to q4"),
    "columns": (columns(2, 3), "q2 and q3 are exchanged"),
    "wrist columns": (columns(4, 5), "q4 and q5 are exchanged"),
    "reversed": (lambda q, x: (q[:, ::-1], x), "the joints are counted from the flange"),
    "coupled": (
        lambda q, x: (q + np.outer(q[:, 1], np.arange(6) == 2), x),
        "q2 is subtracted from q3",
    ),
    "degrees": (lambda q, x: (np.degrees(q), x), "all readings are in degrees, not radians"),
    "radians": (lambda q, x: (np.radians(q), x), "all readings are in radians, not degrees"),
    "one radians": (
        lambda q, x: (np.where(np.arange(6) == 2, np.radians(q), q), x),
        "q3 is in radians, not degrees",
    ),
    "metres": (lambda q, x: (q, x / 1000), "the positions are metres"),
    "inches": (lambda q, x: (q, x / 25.4), "the positions are inches"),
}


@pytest.mark.long
@pytest.mark.parametrize("name", MISTAKES)
@pytest.mark.parametrize("robot", ["ur5", "puma760"])
def test_a_planted_mistake_is_named_with_its_numbers(robot, name, rng) -> None:
    change, words = MISTAKES[name]
    sentence = said(arm(rng, robot), change)
    assert sentence is not None
    assert words in sentence
    assert re.search(
        r"fit [\d,]+ times better \([\d.]+ mm instead of [\d,.]+ mm, median\) if [^:]+: (check|name|convert) ",
        sentence,
    )


@pytest.mark.long
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_mirrored_positions(axis, rng) -> None:
    flip = np.where(np.arange(3) == axis, -1.0, 1.0)
    assert "left-handed" in (said(arm(rng, "ur5"), lambda q, x: (q, x * flip)) or "")
    own = said(arm(rng, "ur5", registered=False), lambda q, x: (q, x * flip), False) or ""
    assert f"{'xyz'[axis]} has the opposite sign" in own


@pytest.mark.parametrize("name", ["sense 1", "sense 3", "zero 90", "columns", "degrees", "metres"])
def test_in_the_robots_own_frame(name, rng) -> None:
    """Without registration."""
    change, words = MISTAKES[name]
    assert words in (said(arm(rng, "ur5", registered=False), change, False) or "")


@pytest.mark.parametrize("registered", [False, True])
@pytest.mark.parametrize(("size", "unit"), [(1000.0, "metres"), (25.4, "inches")])
def test_one_column_in_another_unit(registered: bool, size: float, unit: str, rng) -> None:
    at = arm(rng, "ur5", registered=registered)
    axis = int(rng.integers(3))
    name = "xyz"[axis]
    wrong = np.where(np.arange(3) == axis, size, 1.0)
    sentence = said(at, lambda q, x: (q, x / wrong), registered) or ""
    assert (
        f"if the values of {name} are {unit}: check the unit of the column of {name}." in sentence
    )


@pytest.mark.slow
def test_what_the_study_says_of_tool_and_frame(rng) -> None:
    """A tool left out, a tracker that is not the base, and that with a joint's sense."""
    at = arm(rng, "ur5", registered=False)
    bare = replace(at, tools=np.zeros((1, 3)))
    sentence = said(bare, lambda q, x: (q, x), False) or ""
    assert "the target sits at " in sentence
    assert sentence.endswith("on the flange: check tool_mm in the study.")
    numbers = [
        float(part) for part in sentence.partition("sits at ")[2].partition(" mm")[0].split(",")
    ]
    assert numbers == pytest.approx(OFF_AXIS, abs=1.5)
    turned = from_rpy(0.1, 0.2, -0.4)
    assert "register = true" in (said(at, lambda q, x: (q, x @ turned.T + 100), False) or "")
    both = said(at, lambda q, x: (sense(3)(q, x)[0], x @ turned.T + 100), False) or ""
    assert "register = true" in both
    assert "joint 3 turns the other way" in both


@pytest.mark.integration
@seeds(1, 2, 3)
def test_a_tool_that_is_off_is_no_mistake_of_a_joint(rng) -> None:
    """With frame and target found nothing is left to explain: a turned zero of the first joint, which
    the frame takes up, or of the last one, which the target takes up, was told."""
    at = arm(rng, str(rng.choice(["ur5", "puma760", "irb120"])), registered=False)
    direction = rng.normal(size=3)
    off = direction * rng.uniform(5e-3, 9e-3) * at.reach_mm / np.linalg.norm(direction)
    moved = replace(at, tools=at.tools + off)
    sentence = said(moved, lambda q, x: (q, x), False) or ""
    assert not re.search(r"joint|q\d", sentence)


@pytest.mark.slow
@pytest.mark.long
@seeds(1, 2)
@pytest.mark.parametrize("registered", [True, False])
@pytest.mark.parametrize("robot", ["ur5", "puma760", "iiwa14"])
def test_no_false_alarm(robot, registered, rng) -> None:
    """Geometric errors ten times the usual, gross points, another robot: no simple mistake explains
    any of it, but the links."""

    def same(q: Array, x: Array) -> tuple[Array, Array]:
        return q, x

    at = arm(rng, robot, 60, registered)
    assert said(at, same, registered) is None
    terms = geometric(at.robot).terms
    size = np.array([1e-2 if t.unit == "rad" else 3.0 for t in terms])
    rough = planted(drawn_arm(robot, rng, 60), terms, rng.normal(0, size), rng, 0.05)
    assert said(rough, same, registered) is None
    gross = at.data.position + np.where(rng.random((60, 1)) < 0.1, 500.0, 0.0) * rng.normal(
        size=(60, 3)
    )
    assert said(at, lambda q, x: (q, gross), registered) is None
    other = replace(
        drawn_arm("irb1600" if robot != "iiwa14" else "fr3", rng, 60, OFF_AXIS), robot=at.robot
    )
    wrong_robot = said(
        other, same, registered
    )  # links and zeros may turn one arm into the other: then that is said
    assert (
        wrong_robot is None
        or "check the robot file, and whether it describes this robot" in wrong_robot
    )


def test_registration_is_no_merit_of_a_mistake() -> None:
    """Zeros off by half a degree, which frame and target take up for the most part; with the target
    on the last axis joint 5 may as well be half a turn off."""
    rng = np.random.default_rng(10)
    at = drawn_arm("puma760", rng, 60, (0, 0, 100))
    terms = geometric(at.robot).terms
    zeros = {f"γ{j}" for j in range(1, 7)}
    of_angles = [8e-3 if t.symbol in zeros else 1e-3 for t in terms]
    size = np.where([t.unit == "rad" for t in terms], of_angles, 0.5)
    rough = planted(at, terms, rng.normal(0, size), rng, 0.05)
    assert said(rough, lambda q, x: (q, x), False) is None


def test_gross_points_do_not_hide_a_mistake(rng) -> None:
    at = arm(rng, "ur5")
    gross = np.where(rng.random((80, 1)) < 0.1, 800.0, 0.0) * rng.normal(size=(80, 3))
    assert "joint 3 turns the other way" in (
        said(at, lambda q, x: (sense(3)(q, x)[0], x + gross)) or ""
    )


def test_few_configurations_say_nothing(rng) -> None:
    assert said(arm(rng, "ur5", 9), sense(3)) is None


@pytest.mark.long
@pytest.mark.parametrize("name", ["puma760", "ur5-tracker", "wam-tracker", "positioner"])
def test_the_studies_raise_no_alarm_and_their_mistakes_are_found(name, monkeypatch) -> None:
    """Their own data as they are, and with one joint's sense reversed (the positioner's positions
    do not tell it)."""
    data = Path(os.environ.get("MODELSEL_DATA") or Path(__file__).parents[3] / "shared" / "data")
    if name != "puma760" and os.environ.get("MODELSEL_NO_DATA") == "1":
        pytest.skip("MODELSEL_NO_DATA=1")
    monkeypatch.setenv("MODELSEL_DATA", str(data))
    study = read_study(STUDIES / name / "study.toml")
    robot, _, measured, labels = read_inputs(study, STUDIES / name, BUILTIN)
    notes = prepare(study, robot, measured, labels)[2]
    assert SETUP_MISTAKE not in [n.code for n in notes]
    wrong = replace(measured, q=sense(3)(measured.q, measured.position)[0])
    if name == "positioner":
        return
    try:
        found = "".join(
            n.sentence for n in prepare(study, robot, wrong, labels)[2] if n.code == SETUP_MISTAKE
        )
    except DataError as refused:
        found = str(refused)
    assert "if joint 3 turns the other way: check the sign of column q3, or which way" in found


@pytest.mark.slow
def test_it_is_told_first_and_nothing_is_changed(rng, tmp_path) -> None:
    """In check, in a dry run, on the first line of a study; the study itself takes the data as they
    stand."""
    at = arm(rng, "ur5", 40)
    q, position = sense(5)(at.data.q, at.data.position)
    build_measurements(q, position).to_frame().to_csv(tmp_path / "measurements.csv", index=False)
    (tmp_path / "study.toml").write_text(
        'name = "s"\n[robot]\nname = "ur5"\nregister = true\n[measurements]\n'
        'file = "measurements.csv"\n[model]\ncandidates = ["encoder-scale"]\n'
    )
    words = "if joint 5 turns the other way"
    for command in (
        ["check", str(tmp_path / "measurements.csv"), "--robot", "ur5"],
        ["study", str(tmp_path), "--dry-run"],
    ):
        ran = CliRunner().invoke(run_command_line, command)
        assert ran.exit_code == 0, ran.output
        assert words in ran.output
    result = run_study(tmp_path, sampling=False)
    assert next(w.code for w in result.warnings) == SETUP_MISTAKE
    np.testing.assert_array_equal(result.split.problem.data.q, q)
    lines = terminal_lines(result.record, result.details)
    assert lines[0].startswith("Check the set-up: The positions fit ")
    assert words in lines[0]
    assert sum(words in line for line in lines) == 1
    assert (
        opening_sentences(result.record)[0] == lines[0]
    )  # the report's first page, and its page to explore


@pytest.mark.integration
def test_a_refusal_says_the_mistake(rng) -> None:
    """Above a quarter of the reach."""
    at = arm(rng, "ur5", 40, registered=False)
    wrong = build_measurements(*sense(1)(at.data.q, at.data.position))
    with pytest.raises(
        DataError, match=r"quarter of the length of the arm's links.*joint 1 turns the other way"
    ):
        prepare(study_with(), load_robot("ur5"), wrong)
