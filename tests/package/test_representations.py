"""What a Python session shows of an object: one line that says what it is."""

from __future__ import annotations

import numpy as np
import pytest
from builders import drawn

from modelsel.config.study_file import parse_study
from modelsel.fitting.design import Model
from modelsel.mechanisms.registry import mechanism
from modelsel.results.schemas.finding_schema import EntryRecord
from modelsel.results.schemas.schema import ProvenanceRecord, WarningRecord
from modelsel.robot.files import builtin_names, load_robot
from modelsel.selection.evaluation import Split, evaluate

MOST = 300
STUDY = """
name = "cell 3"
[robot]
name = "ur5"
tool_mm = [0, 0, 100]
[measurements]
file = "day 1.csv"
"""


def show(value: object) -> str:
    shown = repr(value)
    assert "\n" not in shown
    assert len(shown) < MOST
    return shown


@pytest.mark.parametrize("name", builtin_names())
def test_a_robot_is_its_name_and_its_joints(name: str) -> None:
    robot = load_robot(name)
    assert show(robot).startswith(f"Robot {name!r}: {robot.n} joint")
    assert ("slide" in show(robot)) == any(robot.prismatic)


def test_a_study_is_its_robot_and_its_file() -> None:
    study = parse_study(STUDY, "study.toml")
    assert show(study) == "Study 'cell 3': ur5, day 1.csv, base geometric"


def test_a_record_is_its_sentence_or_its_name() -> None:
    warning = WarningRecord(code="far", sentence="It is far.")
    assert show(warning) == "Warning: It is far."
    entry = EntryRecord(mechanism="backlash:2", probability=0.914, screws=[], alike=True)
    assert show(entry) == "Entry: backlash:2, probability 0.91"
    long = "a" * 1000
    versions = ProvenanceRecord(
        modelsel=long, numpy="2", scipy="1", data_sha256=long, study_sha256=long
    )
    assert show(versions).startswith("ProvenanceRecord(modelsel='aaaa")


def test_models_of_rows_are_told_in_one_line(rng: np.random.Generator) -> None:
    at = drawn("ur5", rng, 60)
    inside = np.arange(60) < 45
    split = Split(at, inside, np.zeros(60, bool), np.arange(60) % 5, True)
    assert show(split) == "Split of 60 rows: 45 estimate, 0 left out"
    model = Model((mechanism("geometric", at.robot),))
    assert show(evaluate(split, model, ("geometric",))).startswith("Evaluation of geometric: rank ")
