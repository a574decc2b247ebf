"""Rows by the names that their file gives them: outliers are told by them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from modelsel.measurements.formats.row_places import where_from_record
from modelsel.measurements.formats.table import load_table
from modelsel.measurements.quantities.row_names import find_row_names

POINTS = [f"P{k:03d}" for k in range(20)]


def test_the_column_that_differs_most_names_the_rows() -> None:
    shots = [*POINTS[:19], "P018_2"]
    frame = pd.DataFrame({"group": ["robot"] * 20, "point": [*POINTS[:19], "P018"], "Name": shots})
    names = find_row_names(load_table(frame.assign(x_mm=1.0)))
    assert names is not None
    assert names.tolist() == shots


@pytest.mark.parametrize(
    "cells",
    [
        ["robot"] * 20,
        [f"{k}" for k in range(20)],
        [f"2025-06-17T09:{k:02d}:00" for k in range(20)],
        [*POINTS[:19], None],
    ],
)
def test_other_columns_name_no_rows(cells) -> None:
    assert find_row_names(load_table(pd.DataFrame({"Name": cells, "x_mm": 1.0}))) is None


def test_names_are_stored_for_the_rows_that_are_told() -> None:
    table = load_table(pd.DataFrame({"Name": POINTS, "x_mm": 1.0}))
    where = replace(table.where, labels=find_row_names(table))
    record = where.record(np.arange(20), [3, 7])
    assert record["labels"] == {"3": "P003", "7": "P007"}
    assert where_from_record(record).label([3, 7], 5) == "P003, P007"
    assert where_from_record(record).label([3, 7], 1) == "P003 …"
    assert where_from_record({**record, "labels": None}).label([3], 5) == ""
