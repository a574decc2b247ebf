"""Missed shots: rows without any position are no measurements, but the arm went there: the next row
was approached from their readings. A row that lacks one coordinate is no missed shot."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from modelsel.exceptions import DataError
from modelsel.measurements.measurements import Measurements
from modelsel.measurements.reader import read_measurements

PRISMATIC = (False, False, False)
MISSED = [3, 4, 9, 15]


def campaign(rows: int = 16) -> pd.DataFrame:
    rng = np.random.default_rng(7)
    names = ["q1_deg", "q2_deg", "q3_deg", "x_mm", "y_mm", "z_mm"]
    frame = pd.DataFrame(rng.uniform(-90, 90, (rows, 6)).round(3), columns=names)
    frame["temperature_C"] = 20.0
    frame["group"] = ["a"] * 8 + ["b"] * (rows - 8)
    frame["remark"] = ""
    return frame


def lose(frame: pd.DataFrame, rows: list[int]) -> pd.DataFrame:
    """The same campaign, some of its shots lost: everything of the instrument is empty."""
    lost = frame.copy()
    lost.loc[rows, ["x_mm", "y_mm", "z_mm", "temperature_C"]] = np.nan
    lost.loc[rows[0], "remark"] = "beam broken"
    return lost


def read(frame: pd.DataFrame, tmp_path=None, **options) -> Measurements:
    if tmp_path is None:
        return read_measurements(frame, PRISMATIC, **options)
    frame.to_csv(tmp_path / "m.csv", index=False)
    return read_measurements(tmp_path / "m.csv", PRISMATIC, **options)


@pytest.mark.parametrize("form", ["file", "frame"])
def test_the_row_after_a_missed_one_is_approached_from_it(form, tmp_path) -> None:
    """Readings, approach and size of the last move are those of the campaign without a loss."""
    folder = tmp_path if form == "file" else None
    whole, lost = read(campaign(), folder), read(lose(campaign(), MISSED), folder)
    kept = np.setdiff1d(np.arange(16), MISSED)
    np.testing.assert_array_equal(lost.row, kept)
    for name in ("q", "position", "approach", "move"):
        np.testing.assert_array_equal(getattr(lost, name), getattr(whole, name)[kept])
    without = read(campaign().drop(index=MISSED).reset_index(drop=True), folder)
    assert (without.approach != lost.approach).any()
    (note,) = [note.sentence for note in lost.notes if note.code == "missed-rows"]
    lines = "lines 5, 6, 11, 17" if form == "file" else "rows 3, 4, 9, 15, counted from 0"
    assert note == (
        f"Left out, because there is no position: {lines} (beam broken); their joint readings count "
        "as places that the arm went to, from which the next row was approached."
    )
    assert lost.where.number(int(lost.row[3])) == (7 if form == "file" else 5)


def test_a_group_begins_anew_whatever_was_missed() -> None:
    """A missed row that has no group is of the group of the next measured row."""
    frame = lose(campaign(), [7, 8])
    frame.loc[[7, 8], "group"] = None
    data = read(frame)
    first = int(np.flatnonzero(data.group == 1)[0])
    assert data.row[first] == 9
    expected = np.sign(campaign().iloc[9, :3] - campaign().iloc[8, :3])
    np.testing.assert_array_equal(data.approach[first], expected)


def test_the_order_column_places_missed_rows() -> None:
    frame = campaign().assign(order=np.arange(16.0))
    shuffled = lose(frame, MISSED).sample(frac=1, random_state=3).reset_index(drop=True)
    by_order, in_order = read(shuffled), read(lose(frame, MISSED))
    sequence = np.lexsort((by_order.order, by_order.group))
    groups = [by_order.groups[k] for k in by_order.group[sequence]]
    if groups[0] != "a":
        sequence = np.roll(sequence, groups.count("b"))
    sequence = sequence[np.argsort(by_order.order[sequence], kind="stable")]
    np.testing.assert_array_equal(by_order.approach[sequence], in_order.approach)
    np.testing.assert_array_equal(by_order.move[sequence], in_order.move)


def test_equal_readings_on_either_side_of_a_missed_row_are_two_visits() -> None:
    frame = campaign()
    frame.loc[5, ["q1_deg", "q2_deg", "q3_deg"]] = frame.loc[3, ["q1_deg", "q2_deg", "q3_deg"]]
    data = read(lose(frame, [4]))
    at = np.flatnonzero(np.isin(data.row, [3, 5]))
    assert data.configuration[at[0]] != data.configuration[at[1]]
    assert data.block[at[0]] == data.block[at[1]]
    assert data.configurations == 15


def test_rows_without_readings_say_nothing_of_the_motion() -> None:
    frame = lose(campaign(), MISSED)
    frame.loc[[4, 9], ["q1_deg"]] = np.nan
    data = read(frame)
    (note,) = [note.sentence for note in data.notes if note.code == "missed-rows"]
    assert "the readings of rows 3, 15, counted from 0 count as places" in note
    after_three = np.sign(campaign().iloc[5, :3] - campaign().iloc[3, :3])
    np.testing.assert_array_equal(data.approach[data.row == 5][0], after_three)


def test_a_target_that_was_never_measured_is_none() -> None:
    frame = lose(campaign(), [3]).assign(target="T1")
    frame.loc[3, "target"] = "T2"
    assert read(frame).targets == ("T1",)


@pytest.mark.parametrize("lost", [["y_mm"], ["x_mm", "z_mm"]])
def test_a_row_that_lacks_some_coordinates_is_refused(lost) -> None:
    frame = campaign()
    frame.loc[2, lost] = np.nan
    with pytest.raises(DataError, match="found an empty cell"):
        read(frame)


def test_a_table_without_any_position_is_refused() -> None:
    with pytest.raises(DataError, match=r"an empty cell \(16 such cells\)"):
        read(lose(campaign(), list(range(16))))


@pytest.mark.parametrize("mark", ["-", "–", "—", " - ", "n/a", "N/A", "fehlt", "#NV", "#N/A", ""])
def test_a_mark_in_place_of_a_position_is_a_missed_shot(mark, tmp_path) -> None:
    frame = campaign().astype(dict.fromkeys(("x_mm", "y_mm", "z_mm"), object))
    frame.loc[3, ["x_mm", "y_mm", "z_mm"]] = mark
    for data in (read(frame), read(frame, tmp_path)):
        assert 3 not in data.row
        assert len(data) == 15


@pytest.mark.parametrize("text", ["-?", "1018.673x"])
def test_anything_else_is_no_missed_shot(text) -> None:
    frame = campaign().astype(dict.fromkeys(("x_mm", "y_mm", "z_mm"), object))
    frame.loc[3, ["x_mm", "y_mm", "z_mm"]] = text
    with pytest.raises(DataError, match="expected a finite number"):
        read(frame)
