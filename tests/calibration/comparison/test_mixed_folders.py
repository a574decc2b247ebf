"""A calibration beside the result of another run is taken only where its own file is given."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from builders import drawn
from click.testing import CliRunner

from modelsel.calibration.calibration import calibrate
from modelsel.calibration.calibration_file import save_calibration
from modelsel.calibration.loading import load_calibration
from modelsel.cli.main import run_command_line
from modelsel.exceptions import StudyError
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.noise import Floor
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.files import load_robot
from modelsel.selection.evaluation import Split

RUN = {"data_sha256": "a" * 64, "study_sha256": "b" * 64}
OTHER = (
    "belongs to another run than result.json. Run the study again. For the calibration alone, give"
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the calibration of a run."""
    robot = load_robot("puma760")
    at = drawn(robot, np.random.default_rng(5), 40)
    model = Model((mechanism("geometric", robot),))
    rows = np.ones(40, bool)
    split = Split(at, rows, ~rows, np.zeros(40, np.intp), True)
    c = calibrate("own", split, fit(at, model), Floor(0.03, "stated"), None, False, RUN)
    save_calibration(c, tmp_path)
    return tmp_path


def write_result(folder: Path, **changed: str) -> Path:
    path = folder / "result.json"
    path.write_text(json.dumps({"study": "own", "provenance": RUN | changed}))
    return path


@pytest.mark.parametrize("key", RUN)
def test_the_result_of_another_run_is_refused(folder: Path, key: str) -> None:
    result = write_result(folder, **{key: "c" * 64})
    for path in (folder, result):
        with pytest.raises(StudyError, match=OTHER):
            load_calibration(path)
    assert load_calibration(folder / "calibration.json").study == "own"


@pytest.mark.parametrize(
    ("text", "said"),
    [('{"study": "own", "prov', "cannot be read"), ("[]", "not the result of a study")],
)
def test_a_damaged_result_is_refused(folder: Path, text: str, said: str) -> None:
    result = folder / "result.json"
    result.write_text(text)
    for path in (folder, result):
        with pytest.raises(StudyError, match=said):
            load_calibration(path)
    assert load_calibration(folder / "calibration.json").study == "own"


def test_a_calibration_alone_is_read(folder: Path) -> None:
    assert load_calibration(folder).study == "own"
    write_result(folder)
    assert load_calibration(folder).study == "own"


def test_no_command_is_corrected_by_another_robots_calibration(folder: Path) -> None:
    result = write_result(folder, data_sha256="c" * 64)
    targets, out = folder / "targets.csv", folder / "out.csv"
    targets.write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n1,2,3,4,5,6\n")
    words = ["compensate", str(result), str(targets), "--out", str(out)]
    ran = CliRunner().invoke(run_command_line, words)
    assert ran.exit_code == 2
    assert OTHER in ran.stderr
    assert not out.exists()
