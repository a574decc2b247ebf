"""A slip of one target of several, planted by a study file and found again."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from modelsel._choices import EXPORT_FORMS
from modelsel.calibration.constant_part import compute_points, split_parts
from modelsel.calibration.loading import load_calibration
from modelsel.cli.main import run_command_line
from modelsel.exceptions import StudyError
from modelsel.results.reading import read_records
from modelsel.results.sentences.finding_advice import advise
from modelsel.study.pipeline.result import Result
from modelsel.study.pipeline.runner import run_study
from modelsel.study.simulation import simulate_study

SIZE = 0.3
STUDY = """
name = "slip"
seed = {seed}
[robot]
name = "irb120"
register = true
[robot.tools_mm]
near = [40, -30, 110]
"2" = [40, 60, 90]
far = [-50, 10, 120]
[measurements]
file = "m.csv"
[split]
estimation = 60
[model]
{model}
[simulate]
configurations = 80
noise_mm = {noise}
[[simulate.effect]]
frame = 7
axis = "tx"
cause = "{cause}"
size = {size}
"""
CAUSE = "(sign(progress-0.6)+1)/2*target_2"


def write(folder: Path, **changed: object) -> Path:
    """Write a study with its simulated measurements."""
    usual = {"seed": 4, "model": 'candidates = "all"', "noise": 0.03, "cause": CAUSE, "size": SIZE}
    path = folder / "study.toml"
    path.write_text(STUDY.format(**(usual | changed)))
    simulate_study(path).to_csv(folder / "m.csv", index=False)
    return path


@pytest.fixture(scope="module")
def found(tmp_path_factory) -> tuple[Path, Result]:
    """A study that searches everything, in its folder with its results."""
    folder = tmp_path_factory.mktemp("slip")
    result = run_study(write(folder), sampling=False)
    result.save(folder / "out")
    return folder, result


def simulated(folder: Path, **changed: object) -> pd.DataFrame:
    folder.mkdir()
    return pd.read_csv(write(folder, **changed).with_name("m.csv"))


def test_what_is_planted_moves_its_target_alone(tmp_path) -> None:
    still = simulated(tmp_path / "still", size=0.0)
    moved = simulated(tmp_path / "moved")
    shift = moved[["x_mm", "y_mm", "z_mm"]] - still[["x_mm", "y_mm", "z_mm"]]
    distance = np.linalg.norm(shift, axis=1)
    after = moved.configuration > 0.6 * (moved.configuration.max())
    slipped = after & (moved.target.astype(str) == "2")
    np.testing.assert_allclose(distance[slipped], SIZE, atol=1e-6)
    assert distance[~slipped].max() < 1e-6
    assert slipped.sum() > 20


def test_a_target_that_there_is_not_cannot_be_moved(tmp_path) -> None:
    with pytest.raises(StudyError, match="The targets are target_1 to target_3"):
        write(tmp_path, cause="target_4")


@pytest.mark.slow
def test_it_is_found_again(found: tuple[Path, Result]) -> None:
    folder, _ = found
    record, details = read_records(folder / "out")
    (finding,) = record.findings
    assert finding.first.mechanism == "target-step:2"
    assert finding.first.probability > 0.95
    assert finding.first.screws[0].cause.endswith("*target_2")
    assert finding.sentence.startswith("Target 2 stands elsewhere on the flange from about line ")
    estimate = {one.symbol: one for one in finding.estimate}
    assert abs(estimate["stx"].value - SIZE) < 4 * estimate["stx"].standard_error
    (shift,) = finding.usable
    assert abs(shift.value - SIZE) < shift.high - shift.low  # four standard errors
    assert "target 2 fixed" in advise(record, finding).sentence
    panel = details.findings[0].panels[0]
    assert (panel.against, panel.kind) == ("course of the campaign, target 2", "curve")
    meanings = {one.symbol: one.meaning for one in details.parameters}
    assert meanings["stx"].startswith("target along the flange's x, target 2 × (sign(progress-")


@pytest.mark.slow
def test_the_slip_is_no_noise_of_the_pairs_of_targets(found: tuple[Path, Result]) -> None:
    """The distances from the target that slipped scattered by the slip, and their noise was twice
    what the measurements have."""
    record, _ = read_records(found[0] / "out")
    assert record.noise_floor.source == "target pairs"
    assert record.noise_floor.coordinate_mm == pytest.approx(0.03, rel=0.15)


@pytest.mark.slow
def test_a_stored_calibration_knows_which_target_slipped(found: tuple[Path, Result]) -> None:
    folder, result = found
    stored = load_calibration(folder / "out")
    problem = result.split.problem
    for t in range(3):
        constant, varying = split_parts(stored, t)
        assert {part.mechanism for part in varying} == ({"target-step:2"} if t == 1 else set())
        own = problem.take(problem.data.target == t)
        moved = compute_points(own, constant + varying) - compute_points(own, constant)
        size = np.linalg.norm(moved, axis=1)
        assert size.max() == pytest.approx(SIZE if t == 1 else 0.0, abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("form", [one for one in EXPORT_FORMS if one != "ur-calibration"])
def test_every_form_carries_it_or_says_that_it_does_not(
    found: tuple[Path, Result], form: str, tmp_path
) -> None:
    out = tmp_path / "file"
    arguments = ["export", str(found[0] / "out"), "--format", form, "--out", str(out)]
    told = CliRunner().invoke(run_command_line, arguments)
    assert told.exit_code == 0, told.output
    said = " ".join(told.output.split())
    if form in ("urdf", "dh", "mdh", "hayati"):
        assert "It cannot carry target-step:2 (frame 7 tx, frame 7 ty, frame 7 tz)" in said
    elif form == "table":
        assert 'the corrections are those of target "near"' in said
    elif form == "grid":
        assert 'error of target "near"' in said
    else:
        assert "cannot carry" not in said
    if form == "json":
        effects = json.loads(out.read_text())["effects"]
        assert {one["target"] for one in effects if "progress" in one["prints"]} == {"2"}
    if form == "csv":
        rows = list(csv.DictReader(out.read_text().splitlines()))
        assert {row["target"] for row in rows if "progress" in row["cause"]} == {"2"}


@pytest.mark.slow
def test_it_may_be_asked_for_by_name(tmp_path) -> None:
    path = write(tmp_path, model='candidates = ["target-step:2"]')
    (finding,) = run_study(path, sampling=False).diagnosis.findings
    assert finding.effect.label == "target-step:2"
    path = write(tmp_path, model='candidates = ["target-step:near", "backlash"]')
    assert not run_study(path, sampling=False).diagnosis.findings


def test_a_target_without_rows_cannot_be_asked_for(tmp_path) -> None:
    path = write(tmp_path, model='candidates = ["target-step:4"]')
    with pytest.raises(StudyError, match=r"model\.candidates: .* targets are near, 2 and far"):
        run_study(path)


@pytest.mark.slow
def test_it_may_stand_in_the_base_and_is_sampled(tmp_path) -> None:
    model = 'base = ["geometric", "target-step:2:0.6"]\ncandidates = []'
    result = run_study(write(tmp_path, model=model), sampling=False)
    assert result.models.chosen.names == ("geometric", "target-step:2:0.6")
    chosen = result.models.chosen.fit.model.mechanisms[-1]
    assert chosen.name == "target-step:2"
