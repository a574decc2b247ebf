"""A mistake of the set-up that the base leaves open: no cause is looked for, and the verdict says so."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from builders import seeds

from modelsel._typing import Array
from modelsel.mechanisms.registry import BUILTIN
from modelsel.results.sentences.study_sentences import opening_sentences
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward
from modelsel.study.pipeline.pipeline import sample_posterior
from modelsel.study.pipeline.result import Result, load_result
from modelsel.study.pipeline.runner import rehearse_study, run_study

pytestmark = pytest.mark.integration  # whole studies
ROBOT = "ur5"
TOOL = np.array([40.0, -25.0, 100.0])
NOISE = 0.03  # mm
ECCENTRIC = 5e-4  # rad, of joint 2's encoder with an oval ring: two waves a turn
ROWS = 60
STEPS = ("naming", "again")


@dataclass(frozen=True)
class Campaign:
    """Readings (m, n) [rad] as the file has them, and the positions (m, 3) [mm]."""

    readings: Array
    positions: Array


def _measure(readings_of_arm: Array, rng: np.random.Generator) -> Array:
    """Measure an arm whose joint 2 has an oval encoder ring."""
    arm = load_robot(ROBOT)
    turned = readings_of_arm.copy()
    angle = readings_of_arm[:, 1]
    turned[:, 1] += ECCENTRIC * np.cos(2 * (angle - rng.uniform(0, np.pi)))
    noise = rng.normal(0, NOISE, (ROWS, 3))
    return np.asarray(forward(arm, turned, TOOL) + noise)


def _exchange(rng: np.random.Generator) -> Campaign:
    """Columns of joints 5 and 6 are exchanged, which no geometry makes up for."""
    readings = load_robot(ROBOT).draw(rng, ROWS)
    exchanged = readings.copy()
    exchanged[:, [4, 5]] = readings[:, [5, 4]]
    return Campaign(exchanged, _measure(readings, rng))


def _offset(rng: np.random.Generator) -> Campaign:
    """Joint 3 is 5° off its zero, which the geometric base makes up for."""
    readings = load_robot(ROBOT).draw(rng, ROWS)
    off = readings.copy()
    off[:, 2] += np.radians(5.0)
    return Campaign(off, _measure(readings, rng))


def _write(folder: Path, campaign: Campaign) -> Path:
    """Write a study of the campaign, whose verdict may name errors of encoders."""
    columns = {f"q{j}_rad": each for j, each in enumerate(campaign.readings.T, 1)}
    columns |= dict(zip(("x_mm", "y_mm", "z_mm"), campaign.positions.T, strict=True))
    pd.DataFrame(columns).to_csv(folder / "measurements.csv", index=False)
    (folder / "study.toml").write_text(
        f'name = "s"\n[robot]\nname = "{ROBOT}"\nregister = true\ngravity = [0, 0, -1]\n'
        '[measurements]\nfile = "measurements.csv"\n'
        '[model]\ncandidates = ["encoder-eccentricity", "encoder-scale"]\n'
        "[split]\nestimation = 40\nnested_folds = 2\n"
    )
    return folder


@pytest.fixture(scope="module")
def mistaken(tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, list[str]]:
    """The study of exchanged columns, and the steps that it told."""
    folder = tmp_path_factory.mktemp("exchanged")
    _write(folder, _exchange(np.random.default_rng(83)))
    told: list[str] = []
    return run_study(folder, sampling=False, say=lambda line: told.append(str(line))), told


def test_no_cause_is_sought_beside_an_open_mistake(mistaken: tuple[Result, list[str]]) -> None:
    result, told = mistaken
    record = result.record
    assert record.findings == []
    assert record.error_map.places == []
    assert record.nested_cv is None
    assert record.nothing_else.predictable is None
    assert record.nothing_else.sentence.startswith("Nothing was searched: ")
    assert not any(line.startswith(STEPS) for line in told), told


def test_the_verdict_says_what_fits_and_what_to_do(mistaken: tuple[Result, list[str]]) -> None:
    result, _ = mistaken
    record = result.record
    notes = [one.sentence for one in record.warnings if one.code == "setup-mistake"]
    assert len(notes) == 1
    assert "times better" in notes[0]
    hopeless, _, last = record.verdict
    assert hopeless.startswith("This fit explains the data poorly")
    assert last.startswith("No cause was looked for")
    assert notes[0] in last
    assert last.endswith("Correct that and run the study again.")
    assert last in opening_sentences(record)


def test_it_is_not_sampled_and_is_read_back(
    mistaken: tuple[Result, list[str]], tmp_path: Path
) -> None:
    result, _ = mistaken
    sampled = sample_posterior(result, BUILTIN)
    assert sampled.record.sampling is None
    sampled.save(tmp_path)
    assert load_result(tmp_path).record == result.record


@pytest.mark.slow
def test_a_rehearsal_says_the_same_of_it(tmp_path: Path) -> None:
    _write(tmp_path, _exchange(np.random.default_rng(125)))
    rehearsed = rehearse_study(tmp_path)
    assert rehearsed["mechanisms"] > 0
    assert any(one["code"] == "setup-mistake" for one in rehearsed["warnings"])


@pytest.mark.slow
@seeds(1, 2)
def test_what_the_base_makes_up_for_is_searched(tmp_path: Path, rng: np.random.Generator) -> None:
    _write(tmp_path, _offset(rng))
    record = run_study(tmp_path, sampling=False).record
    assert any(one.code == "setup-mistake" for one in record.warnings)
    assert [one.credible_set[0].name for one in record.findings] == ["encoder-eccentricity:2"]
    assert "encoder-eccentricity:2" in " ".join(record.verdict)
