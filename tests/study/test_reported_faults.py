"""A fault of the data is not told again where an alarm reports its rows, and only there."""

from __future__ import annotations

import numpy as np
import pytest

from modelsel.diagnosis.candidates.fault_kinds import FaultKind
from modelsel.diagnosis.faults.data_faults import Fault
from modelsel.notices import Note
from modelsel.study.preparation.checks import drop_known_faults

SWAPPED = Fault(FaultKind.SWAPPED_REFLECTORS, np.array([40, 41]), "swapped.", 0.001, 0.99)


@pytest.mark.parametrize(
    ("code", "rows", "is_told"),
    [
        ("labels-swapped", (3, 40, 41), False),
        ("labels-swapped", (3, 4), True),
        ("labels-swapped", (40,), True),
        ("labels-swapped", None, False),
        ("rows-shifted", None, True),
    ],
)
def test_faults_that_no_alarm_reports_are_told(code, rows, is_told) -> None:
    kept = drop_known_faults([SWAPPED], [Note(code, "an alarm.", rows)])
    assert kept == ((SWAPPED,) if is_told else ())
