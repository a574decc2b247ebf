"""Rows that cannot be held out are left out, and counted."""

from __future__ import annotations

import numpy as np
import pytest

from modelsel.measurements.measurements import build_measurements
from modelsel.study.preparation.row_selection import drop_unknown_targets


@pytest.mark.parametrize(
    ("targets", "said"),
    [
        ("aaaab", '1 held-out row is left out: no estimation row measures target "b", and'),
        ("aaabb", '2 held-out rows are left out: no estimation row measures target "b", and'),
    ],
)
def test_rows_of_a_target_that_no_estimation_row_measures(targets: str, said: str) -> None:
    readings = np.arange(30.0).reshape(5, 6)
    data = build_measurements(readings, readings[:, :3], target=list(targets))
    kept, estimation, (note,) = drop_unknown_targets(data, np.arange(5) < 3)
    assert note.sentence.startswith(said)
    assert len(kept) == len(estimation) == targets.count("a")
    assert kept.targets == ("a",)
