"""Missed shots: rows without any position are left out and said; a row that lacks one coordinate
is no missed shot."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from modelsel.measurements.missed_rows import leave_out_missed
from modelsel.measurements.table import Table, load_table

XYZ = ("X", "Y", "Z")


def table_of(**columns: list) -> Table:
    return load_table(pd.DataFrame(columns))


def test_rows_without_a_position_are_left_out_and_said() -> None:
    table = table_of(
        J1=[1.0, 2.0, 3.0, 4.0],
        X=["1,5", None, "2,5", " "],
        Y=[1.0, np.nan, 2.0, np.nan],
        Z=["1", "", "3", None],
        Note=[None, "beam broken", None, "12"],
    )
    kept, said = leave_out_missed(table, XYZ)
    assert kept.columns["J1"].tolist() == [1.0, 3.0]
    assert [kept.where.number(row) for row in range(2)] == [0, 2]
    assert said == (
        "Left out, because there is no position: rows 1, 3, counted from 0 (beam broken).",
    )


@pytest.mark.parametrize("mark", ["-", "–", "—", " - ", "n/a", "N/A", "fehlt", "#NV", "#N/A", ""])
def test_a_mark_in_place_of_a_position_is_a_missed_shot(mark) -> None:
    table = table_of(
        X=[1.0, mark, 2.0], Y=["1", mark, "2"], Z=[3.0, mark, 4.0], Note=["", "broken", ""]
    )
    kept, said = leave_out_missed(table, XYZ)
    assert kept.columns["X"].tolist() == [1.0, 2.0]
    assert said == ("Left out, because there is no position: row 1, counted from 0 (broken).",)


@pytest.mark.parametrize("text", ["-1", "0", "-?", "1018.673"])
def test_anything_else_is_no_missed_shot(text) -> None:
    table = table_of(X=[1.0, text], Y=[1.0, text], Z=[1.0, text])
    assert leave_out_missed(table, XYZ) == (table, ())


def test_a_row_that_lacks_one_coordinate_stays() -> None:
    table = table_of(X=[1.0, np.nan], Y=[1.0, 2.0], Z=[1.0, 2.0])
    assert leave_out_missed(table, XYZ) == (table, ())


def test_a_table_without_any_position_stays() -> None:
    table = table_of(X=[None, None], Y=[None, None], Z=[None, None])
    assert leave_out_missed(table, XYZ) == (table, ())
    assert leave_out_missed(table, ()) == (table, ())
