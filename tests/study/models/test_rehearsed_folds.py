"""Nested folds are rehearsed: a study that could not fit its base without one of them is refused before
anything is computed, and `check` says how often all is repeated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from exact import flanges_of

from modelsel.config.study_file import read_study
from modelsel.exceptions import NotEstimable
from modelsel.robot.files import load_robot
from modelsel.study.inspection.inspection_text import format_inspection
from modelsel.study.inspection.study_inspection import inspect_study
from modelsel.study.pipeline.runner import rehearse_study, run_study

STUDY = """
name = "folds"
[robot]
name = "ur5"
tool_mm = [40, -30, 110]
[measurements]
file = "m.csv"
[split]
estimation = 12
nested_folds = {folds}
[model]
candidates = ["backlash:2"]
"""


def write(folder: Path, rng: np.random.Generator, folds: int) -> Path:
    """Twelve configurations: half of them measure fewer numbers than the geometry has."""
    arm = load_robot("ur5")
    q = arm.draw(rng, 16)
    flange = flanges_of(arm, q)
    x = flange[:, :3, 3] + flange[:, :3, :3] @ np.array([40.0, -30.0, 110.0])
    x = x + rng.normal(0, 0.03, x.shape)
    columns = {f"q{j + 1}_rad": readings for j, readings in enumerate(q.T)}
    columns |= dict(zip(("x_mm", "y_mm", "z_mm"), x.T, strict=True))
    pd.DataFrame(columns).to_csv(folder / "m.csv", index=False)
    path = folder / "study.toml"
    path.write_text(STUDY.format(folds=folds))
    return path


def test_folds_that_leave_too_little_are_refused_before_the_search(rng, tmp_path) -> None:
    """`check` said nothing of them, and the study only after its search."""
    path = write(tmp_path, rng, 2)
    with pytest.raises(NotEstimable, match="without one of 2 folds") as refusal:
        rehearse_study(path)
    said: list[str] = []
    with pytest.raises(NotEstimable) as later:
        run_study(path, sampling=False, say=lambda step: said.append(str(step)))
    assert str(later.value) == str(refusal.value)
    assert not any("naming" in one for one in said)
    described = inspect_study(read_study(path), tmp_path)["study"]
    assert described["refused"] == str(refusal.value).splitlines()
    assert described["exit"] == NotEstimable.exit_code


@pytest.mark.integration
def test_more_folds_are_carried_and_counted(rng, tmp_path) -> None:
    path = write(tmp_path, rng, 6)
    assert rehearse_study(path)["nested_folds"] == 6
    found = inspect_study(read_study(path), tmp_path)
    assert found["study"]["nested_folds"] == 6
    assert any("are repeated 6 times" in line for line in format_inspection(found))
