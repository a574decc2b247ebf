"""Values of covariates that are the same for all planned commands: a payload, a temperature."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..exceptions import DataError, StudyError
from ..measurements.campaign.state_names import is_state_name
from ..measurements.formats.table import Table
from ..measurements.measurements import Measurements
from ..measurements.recognition.covariates import COVARIATE_LIMITS, MAX_COVARIATE
from .assumed_values import find_assumed
from .calibration import Calibration
from .known_names import LABEL_NAMES, refuse_without


def read_held_values(pairs: Sequence[str]) -> dict[str, float]:
    """Read NAME=NUMBER pairs. Raises StudyError for what is not written so, and a name that stands
    twice."""
    held: dict[str, float] = {}
    for pair in pairs:
        name, _, text = pair.partition("=")
        try:
            value = float(text)
        except ValueError:
            value = np.nan
        if not name or not np.isfinite(value):
            raise StudyError(f"--at {pair}: expected NAME=NUMBER, as payload_kg=3.")
        if name in held:
            raise StudyError(f"--at {name} is given twice. Keep one of them.")
        held[name] = value
    return held


def hold_values(c: Calibration, table: Table, held: Mapping[str, float]) -> Table:
    """Add a column of one value for each covariate that is held. Raises DataError for a name that
    the calibrated model does not look at, and one that the table has already."""
    needs = c.needs()
    known = sorted(name for name in needs if not is_state_name(name))
    columns = dict(table.columns)
    for name, value in held.items():
        if name not in known:
            listed = ", ".join(known) or "none"
            raise DataError(
                f"--at {name}: the calibrated model does not look at it.",
                remedy=f"Values of a file that it looks at: {listed}.",
            )
        if name in columns:
            raise table.where.refuse(
                f"--at {name} is given, and the file has it, too.",
                column=name,
                remedy="Leave one of them out.",
            )
        _check_value(name, value)
        columns[name] = np.full(len(table), value)
    return replace(table, columns=columns)


def check_values(c: Calibration, data: Measurements) -> None:
    """Check that planned commands have every value that the calibrated model looks at and does not
    assume. Raises DataError that says how one value is given for all of them."""
    needed = {name for name in c.needs() if not is_state_name(name)}
    missing = sorted(needed - LABEL_NAMES - data.covariates.keys())
    if set(missing) <= find_assumed(c).keys():
        return
    raise refuse_without(
        data, missing, f", or give one value for all rows: --at {missing[0]}=NUMBER"
    )


def _check_value(name: str, value: float) -> None:
    """Refuse a value that no row of a file may have. Raises StudyError."""
    least, most = COVARIATE_LIMITS.get(name, (-MAX_COVARIATE, MAX_COVARIATE))
    if not least <= value <= most:
        raise StudyError(
            f"--at {name}={value:g}: expected a number between {least:g} and {most:g}. Correct the value."
        )
