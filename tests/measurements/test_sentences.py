"""Sentences about columns: each names what is there, and nothing that has another use."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from modelsel.exceptions import DataError, StudyError
from modelsel.measurements.formats.table import load_table
from modelsel.measurements.reader import read_measurements
from modelsel.measurements.recognition.uncausal_columns import describe_uncausal
from modelsel.robot.files import load_robot
from modelsel.robot.urdf import read_urdf_text

TWO_ROOTS = (
    '<robot name="a"><link name="a"/><link name="b"/><link name="c"/><link name="d"/>'
    '<joint name="one" type="revolute"><parent link="a"/><child link="b"/></joint>'
    '<joint name="two" type="revolute"><parent link="c"/><child link="d"/></joint></robot>'
)
TWO_TIPS = TWO_ROOTS.replace('<parent link="c"/>', '<parent link="a"/>').replace(
    '<child link="d"/>', '<child link="d"/><origin xyz="0 0 1"/>'
)


def test_a_column_without_a_name_is_told() -> None:
    (note,) = describe_uncausal({"counters-ignored": [""]})
    assert note.sentence == "Columns that only count the rows are ignored: one without a name."


def test_a_column_in_use_is_not_proposed_for_another() -> None:
    frame = pd.DataFrame({f"q{j}_deg": [10.0, 20.0] for j in range(1, 7)})
    frame["x_mm"] = frame["y_mm"] = [1.0, 2.0]
    with pytest.raises(DataError, match="column z_mm or z_m or z_in") as caught:
        read_measurements(frame, load_robot("irb120"))
    assert "Did you mean" not in str(caught.value)
    with pytest.raises(DataError, match='Did you mean "z_mmm"'):
        read_measurements(frame.assign(z_mmm=[1.0, 2.0]), load_robot("irb120"))


def test_a_name_that_appears_twice(tmp_path: Path) -> None:
    file = tmp_path / "m.csv"
    file.write_text("q1_rad,q1_rad\n1,2\n")
    with pytest.raises(DataError, match="appears twice in the header"):
        load_table(file)


def test_another_spelling_is_told_in_words_that_people_know() -> None:
    frame = pd.DataFrame({f"q{j}_deg": [10.0, 20.0] for j in range(1, 7)})
    frame[["x_mm", "y_mm", "z_mm", "temperature_c"]] = [[1.0, 2, 3, 20], [4, 5, 6, 21]]
    with pytest.raises(DataError, match='calls this column "temperature_C"') as caught:
        read_measurements(frame, load_robot("irb120"))
    assert "contract" not in str(caught.value)


@pytest.mark.parametrize(("text", "option"), [(TWO_ROOTS, "--base"), (TWO_TIPS, "--tip")])
def test_every_command_has_the_option_that_chooses_a_chain(text: str, option: str) -> None:
    with pytest.raises(StudyError, match=f"{option} of a command"):
        read_urdf_text(text, "arm.urdf")
