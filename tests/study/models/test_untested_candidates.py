"""Candidates that the measurements cannot test, and candidates that are listed twice."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from modelsel import Study, StudyError, rehearse_study, run_study
from modelsel.config.study_file import parse_study
from modelsel.diagnosis.candidates.scanned_constants import drop_equal_constants
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.campaign_registry import set_targets
from modelsel.mechanisms.registry import BUILTIN, build_mechanisms
from modelsel.mechanisms.terms import Mechanism
from modelsel.results.conclusions.cautions import explain_restriction, restriction_notes
from modelsel.robot.files import load_robot
from modelsel.study.models.untested_candidates import find_untested
from modelsel.study.simulation import simulate_points, simulate_study

ROBOT = load_robot("irb120")
STUDY = (
    'name = "a"\n[robot]\nname = "irb120"\nregister = true\n[measurements]\nfile = "m.csv"\n'
    '[split]\nestimation = 40\n[model]\ncandidates = ["thermal-expansion"]\n'
)


def test_a_candidate_that_is_listed_twice_is_told_once() -> None:
    asked = ["axis-wobble:1", "axis-wobble:1"]
    told = (explain_restriction(asked), restriction_notes(asked)[0].sentence)
    for sentence in told:
        assert sentence.count("axis-wobble:1") == 1


def test_candidates_say_what_they_lack(rng: np.random.Generator) -> None:
    data = build_measurements(rng.uniform(-1, 1, (10, 6)), np.zeros((10, 3)))
    problem = Problem(ROBOT, data, np.zeros((1, 3)))
    asked = ["backlash", "thermal-expansion", "backlash"]
    mechanisms = [m for name in asked for m in build_mechanisms(name, ROBOT)]
    untested = find_untested(asked, problem, mechanisms)
    assert "thermal-expansion needs the column temperature_C" in untested.note()[0].sentence
    assert untested.select_tested(asked) == ["backlash"]
    assert find_untested("all", problem, mechanisms).note() == ()


def test_a_compliance_can_be_tested_without_a_payload(rng: np.random.Generator) -> None:
    """One of its forms has the payload; a mechanism that has no other needs it."""
    data = build_measurements(rng.uniform(-1, 1, (10, 6)), np.zeros((10, 3)))
    problem = Problem(ROBOT, data, np.zeros((1, 3)))
    asked = ["joint-compliance:2", "backlash", "payload-deflection:2"]
    mechanisms = [m for name in asked for m in build_mechanisms(name, ROBOT)]
    untested = find_untested(asked, problem, mechanisms)
    assert untested.select_tested(asked) == ["joint-compliance:2", "backlash"]
    assert set(untested.missing) == {"payload-deflection:2"}


def measured_once(asked: list[str], rng: np.random.Generator) -> tuple[Problem, list[Mechanism]]:
    """A campaign in which target B is measured once, at its end, and the candidates asked for."""
    target = [*"A" * 19, "B"]
    data = build_measurements(rng.uniform(-1, 1, (20, 6)), np.zeros((20, 3)), target=target)
    registry = set_targets(BUILTIN, data.targets)
    mechanisms = [m for name in asked for m in build_mechanisms(name, ROBOT, registry)]
    return Problem(ROBOT, data, np.zeros((2, 3))), mechanisms


def test_a_target_that_is_there_on_one_side_alone_cannot_be_tested(
    rng: np.random.Generator,
) -> None:
    asked = ["target-step:B", "target-step:A"]
    problem, mechanisms = measured_once(asked, rng)
    untested = find_untested(asked, problem, mechanisms)
    (note,) = untested.note()
    assert note.sentence == (
        "Not every candidate can be tested: target-step:B needs its target both before and after a slip. "
        "Add it, or take the candidate out of the study file."
    )
    assert untested.select_tested(asked) == ["target-step:A"]


def test_a_moment_of_a_target_that_is_there_on_one_side_alone_is_told(
    rng: np.random.Generator,
) -> None:
    """Names were compared without their constants."""
    asked = ["target-step:B:0.5", "target-step:A:0.5"]
    problem, mechanisms = measured_once(asked, rng)
    untested = find_untested(asked, problem, mechanisms)
    assert untested.reason == "target-step:B:0.5 needs its target both before and after a slip."
    assert untested.select_tested(asked) == ["target-step:A:0.5"]
    kept = drop_equal_constants(problem, mechanisms)
    assert {m.name for m in kept} == {"target-step:A"}


HELD_OUT = """
name = "left"
seed = 5
[robot]
name = "irb120"
register = true
[robot.tools_mm]
A = [40, -30, 110]
B = [40, 60, 90]
C = [-40, 60, 90]
[measurements]
file = "m.csv"
[simulate]
configurations = 40
noise_mm = 0.03
"""


def hold_out(folder: Path, names: str, model: str) -> Study:
    """A study of simulated targets, of which A is only held out."""
    study = parse_study(HELD_OUT, "study.toml")
    rows = simulate_study(study, folder)
    rows = rows[rows.target.isin(list(names))]
    is_held_out = rows.configuration >= 30
    rows = rows[(rows.target != "A") | is_held_out]
    rows["role"] = np.where(rows.configuration >= 30, "held-out", "estimation")
    rows.to_csv(folder / "m.csv", index=False)
    split = '[split]\ncolumn = "role"\n'
    return parse_study(f"{HELD_OUT}{split}[model]\n{model}\n", "study.toml")


@pytest.mark.integration
@pytest.mark.parametrize(("names", "left"), [("ABC", "C"), ("AB", "B")])
def test_a_step_of_a_target_that_is_only_held_out_is_told(
    tmp_path: Path, names: str, left: str
) -> None:
    asked = ["target-step:A", f"target-step:{left}", "tool-droop:A", f"tool-droop:{left}"]
    study = hold_out(tmp_path, names, f"candidates = {json.dumps(asked)}")
    result = run_study(study, tmp_path, sampling=False)
    (said,) = [w.sentence for w in result.record.warnings if w.code == "candidates-untested"]
    assert said.startswith(
        "Not every candidate can be tested: target-step:A needs estimation rows of its target. "
        "tool-droop:A needs estimation rows of its target."
    )
    assert f":{left} needs" not in said


@pytest.mark.integration
def test_a_model_of_a_target_that_is_only_held_out_is_refused(tmp_path: Path) -> None:
    study = hold_out(tmp_path, "ABC", 'base = ["geometric", "target-step:A:0.5"]')
    with pytest.raises(StudyError, match=r"model: target-step:A:0\.5 needs estimation rows of"):
        run_study(study, tmp_path, sampling=False)


@pytest.fixture
def campaign(tmp_path: Path, rng: np.random.Generator) -> Path:
    """Sixty points without a temperature, in m.csv."""
    q = rng.uniform(-1.5, 1.5, (60, 6))
    at = build_measurements(q, np.zeros((60, 3)))
    points = simulate_points(ROBOT, np.array([[30.0, 20, 80]]), [], at=at, noise_mm=0.05, rng=rng)
    points.to_csv(tmp_path / "m.csv", index=False)
    return tmp_path


@pytest.mark.parametrize("run", [rehearse_study, run_study])
@pytest.mark.parametrize("key", ["base", "ladder"])
def test_a_model_that_lacks_a_column_is_refused(campaign: Path, run, key) -> None:
    names = ["geometric", "thermal-expansion"]
    listed = names if key == "base" else [names]
    text = STUDY.replace('candidates = ["thermal-expansion"]', f"{key} = {listed}")
    study = parse_study(text, "study.toml")
    message = r"model: thermal-expansion needs the column temperature_C, .* Add it to the"
    with pytest.raises(StudyError, match=message):
        run(study, campaign)


@pytest.mark.integration
def test_a_study_whose_only_candidate_lacks_its_column_names_it(campaign: Path) -> None:
    result = run_study(parse_study(STUDY, "study.toml"), campaign, sampling=False)
    _, named, remainder = result.record.verdict
    assert "could be named" not in named
    assert "thermal-expansion needs the column temperature_C" in remainder
    codes = [warning.code for warning in result.record.warnings]
    assert "candidates-untested" in codes
