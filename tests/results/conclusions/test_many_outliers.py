"""So many outliers that they may be what the arm does in some configurations are told before everything else."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from builders import drawn, seeds

from modelsel.notices import list_alarms
from modelsel.results.conclusions.finding_notes import many_outlier_notes
from modelsel.selection.evaluation import Split

ROWS = 100


def build_split(rng: np.random.Generator, outlying: int) -> Split:
    """Build a split of which the last rows are left out."""
    problem = drawn("puma760", rng, ROWS)
    marked = np.arange(ROWS) >= ROWS - outlying
    folds = np.arange(ROWS) % 5
    return Split(problem, np.arange(ROWS) % 3 > 0, marked, folds, known_sigma=False)


def build_chosen(split: Split) -> object:
    residual = np.full((ROWS, 3), 0.1 / np.sqrt(3))
    residual[split.outlying] = 2 / np.sqrt(3)
    return SimpleNamespace(residual=residual)


@seeds(1)
def test_many_outliers_are_told_first(rng: np.random.Generator) -> None:
    """Of a clearance that switched in 21 of 174 postures nothing was said but that these rows are left out."""
    split = build_split(rng, 12)
    (note,) = many_outlier_notes(split, build_chosen(split))
    assert note.sentence.startswith("12 of 100 positions (12 %) are left out as outliers: ")
    assert (
        "Half of them are 2.00 mm or more off the model, which errs by 0.100 mm rms"
        in note.sentence
    )
    assert note.rows == tuple(range(88, 100))
    assert list_alarms([note]) == [f"Check the outliers: {note.sentence}"]


@pytest.mark.parametrize("outlying", [0, 4, 5])
@seeds(1)
def test_a_few_bad_shots_are_no_alarm(rng: np.random.Generator, outlying: int) -> None:
    split = build_split(rng, outlying)
    assert not many_outlier_notes(split, build_chosen(split))


@seeds(1)
def test_rows_whose_side_of_a_step_is_open_are_no_outliers(rng: np.random.Generator) -> None:
    split = build_split(rng, 12)
    undecided = split.outlying & ~split.estimation
    assert 12 - undecided.sum() > 6
    some = replace(split, undecided=undecided)
    (note,) = many_outlier_notes(some, build_chosen(some))
    assert note.sentence.startswith(f"{12 - undecided.sum()} of 100 positions")
    none = replace(split, undecided=split.outlying)
    assert not many_outlier_notes(none, build_chosen(none))
