"""What a study tells while it runs: the steps that were announced, in their order; quiet unless asked."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from modelsel import Study, StudyError, run_study
from modelsel._progress import News
from modelsel.diagnosis import procedure
from modelsel.study.pipeline.steps import list_steps

FILE = Path(__file__).parents[3] / "studies" / "puma760" / "measurements.csv"


@pytest.fixture
def study() -> Study:
    """A part of the PUMA's data, with folds."""
    return Study(
        name="steps",
        measurements=pd.read_csv(FILE).head(60),
        split={"estimation": 50, "nested_folds": 2},
        robot={"name": "puma760", "tool_mm": [0, 0, 100]},
        model={"candidates": ["gravity-twist"]},
    )


@pytest.mark.slow
def test_every_step_is_told_in_order(study) -> None:
    said: list[str] = []
    run_study(study, say=said.append, sampling=False)
    stages = [line for line in said if not isinstance(line, News)]
    steps = list_steps(study, sampling=False)
    assert len(stages) >= len(steps)
    reached = [k for line in stages for k, step in enumerate(steps) if line.startswith(step)]
    assert len(reached) == len(stages)
    assert list(dict.fromkeys(reached)) == list(range(len(steps)))
    folds = [line.done for line in said if isinstance(line, News) and "folds" in line]
    assert folds == [0, 0.5, 1]
    assert any(
        line == "added gravity-twist" and line.kept for line in said if isinstance(line, News)
    )
    phases = [line for line in said if isinstance(line, News) and not line.kept]
    assert phases[:2] == ["what does not repeat", "searching"]
    assert "weighing what is proven" in phases


def die(*given: object, **rest: object) -> None:
    os._exit(1)


@pytest.mark.slow
def test_processes_that_die_are_told(study, monkeypatch) -> None:
    monkeypatch.setattr(procedure, "_run_fold", die)
    with pytest.raises(StudyError, match=r"split.nested_folds: .* `if __name__ == \"__main__\":`"):
        run_study(study, sampling=False)


@pytest.mark.slow
def test_what_was_added_and_did_not_stay_is_told(study) -> None:
    """Every line on an effect is true of the findings in the end."""
    said: list[str] = []
    result = run_study(study, say=said.append, sampling=False)
    kept = {effect.candidate.label for effect in result.diagnosis.search.effects}
    path = ("+ a", "+ b", "- b", "- a", "a -> b")
    left = replace(result.diagnosis.search, path=path)
    assert left.dropped == ("b", "a")
    assert set(result.diagnosis.search.dropped).isdisjoint(kept)
    dropped = [line for line in said if line.startswith("dropped ")]
    assert bool(dropped) == bool(result.diagnosis.search.dropped)


@pytest.mark.slow
def test_progress_is_shown_when_asked(study, capsys) -> None:
    run_study(study, sampling=False)
    assert capsys.readouterr().err == ""
    run_study(study, sampling=False, progress=True)
    assert "added gravity-twist" in capsys.readouterr().err
