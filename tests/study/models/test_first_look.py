"""What a study tells of the nominal arm and of the base, before it looks for causes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from modelsel import Study, run_study
from modelsel.exceptions import write_rounded

FILE = Path(__file__).parents[3] / "studies" / "puma760" / "measurements.csv"
ESTIMATION, HELD_OUT = 50, 15


def build_study(measurements: pd.DataFrame) -> Study:
    """A study whose first rows estimate."""
    roles = np.where(np.arange(len(measurements)) < ESTIMATION, "estimation", "held-out")
    return Study(
        name="look",
        measurements=measurements.assign(role=roles),
        split={"column": "role"},
        robot={"name": "puma760", "tool_mm": [0, 0, 100]},
        model={"candidates": ["wrist-coupling"]},
        # what rows share would give them other weights in the end
        noise={"parts": []},
    )


def look(study: Study) -> tuple[list[str], list[str]]:
    """Return what is told before effects are looked for, and the errors of the ladder [mm]."""
    said: list[str] = []
    result = run_study(study, say=lambda line: said.append(str(line)), sampling=False)
    before = said[: said.index("searching")]
    ladder = result.models.ladder
    base = next(one for one in ladder if one.names == ("geometric",))
    of_both = [one.held_out.rms_mm for one in (ladder[0], base)]
    return before, [write_rounded(each) for each in of_both if each is not None]


@pytest.mark.integration
@pytest.mark.parametrize(
    "is_bad",
    [pytest.param(False, id="good", marks=pytest.mark.slow), pytest.param(True, id="bad shot")],
)
def test_the_errors_that_the_ladder_has_are_told_first(is_bad: bool) -> None:
    """A bad shot among what is held out counts as little as in the end."""
    measurements = pd.read_csv(FILE).head(ESTIMATION + HELD_OUT)
    if is_bad:
        row = ESTIMATION + int(np.random.default_rng(52).integers(HELD_OUT))
        measurements.loc[row, "x_mm"] += 60.0
    told, (nominal, base) = look(build_study(measurements))
    words = f"nominal arm {nominal} mm rms, base {base} mm, on held-out configurations"
    assert told.count(words) == 1
    assert not any(words[:12] in line and line != words for line in told)


@pytest.mark.slow
def test_nothing_is_told_first_where_nothing_is_held_out() -> None:
    told, _ = look(build_study(pd.read_csv(FILE).head(ESTIMATION)))
    assert not any(line.startswith("nominal arm") for line in told)
