"""Nested folds, tried as far as nothing is computed for long: whether the base can be fitted without
each of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..._typing import Mask
from ...config.study_file import Study
from ...diagnosis.procedure import assign_nested_folds
from ...exceptions import NotEstimable
from ...fitting.design import Model
from ...fitting.least_squares import fit
from ...mechanisms.registry import Registry
from ...notices import Note
from ...selection.evaluation import Split
from ..preparation.checks import add_alarms_to_errors
from .model_ladder import rehearse_base


def rehearse_folds(
    study: Study, split: Split, notes: Sequence[Note], registry: Registry
) -> tuple[Model, int]:
    """Return the model that a study extends, and the number of folds in which it repeats the whole
    procedure, 0 where it does not. Raises StudyError or NotEstimable where its rows, or those without
    one of the folds, do not carry the model; `notes` are those of the preparation."""
    base = rehearse_base(study, split, notes, registry)
    folds = study.split.nested_folds
    if not folds:
        return base, 0
    fold = assign_nested_folds(split, folds, study.seed)
    last = int(fold.max())
    count = last + 1
    with add_alarms_to_errors(notes):
        for k in range(count):
            rest = split.estimation & (fold != k)
            _require_base(split, rest, base, count)
    return base, count


def _require_base(split: Split, rest: Mask, base: Model, count: int) -> None:
    """Raise NotEstimable where the rows that one of so many folds leaves do not carry the base."""
    none = np.zeros(len(rest), bool)
    inside = replace(split, estimation=rest, outlying=none)
    training = inside.training
    # every row has one coordinate or more: where they are many, there are enough
    if len(training) > len(base.terms):
        return
    try:
        fit(training, base)
    except NotEstimable as error:
        raise NotEstimable(
            f"split.nested_folds: without one of {count} folds, {error} More folds leave out "
            "fewer configurations each."
        ) from None
