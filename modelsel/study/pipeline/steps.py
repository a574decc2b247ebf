"""The steps of a study as progress tells of them, in order."""

from __future__ import annotations

from ...config.study_file import Study

READING = "reading"
SPLITTING = "splitting"
REGISTERING = "registering and splitting"
OUTLIERS = "looking for outliers"
NAMING = "naming"
LADDER = "evaluating the ladder"
SUBSETS = "comparing all subsets of the candidates"
GAIN = "measuring the gain"
FOLDS = "the whole procedure again"
WEIGHING = "weighing every mechanism of the chosen model"
SAMPLING = "sampling"


def list_steps(study: Study, sampling: bool) -> tuple[str, ...]:
    """List how the lines begin that a study's steps tell."""
    split = REGISTERING if study.robot.register_ else SPLITTING
    folds = (FOLDS,) if study.split.nested_folds else ()
    last = (SAMPLING,) if sampling else ()
    return READING, split, OUTLIERS, NAMING, LADDER, SUBSETS, GAIN, *folds, WEIGHING, *last
