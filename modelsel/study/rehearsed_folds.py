"""Nested folds, tried as far as nothing is computed for long: whether the base can be fitted without
each of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..config.study_file import Study
from ..diagnosis.procedure import assign_nested_folds
from ..exceptions import NotEstimable
from ..fitting.design import Model
from ..fitting.least_squares import fit
from ..selection.evaluation import Split


def rehearse_folds(study: Study, split: Split, base: Model) -> int:
    """Count the folds in which a study repeats the whole procedure, 0 where it does not. Raises
    NotEstimable where the rows without one of them do not carry the base."""
    folds = study.split.nested_folds
    if not folds:
        return 0
    fold = assign_nested_folds(split, folds, study.seed)
    count = int(fold.max()) + 1
    none = np.zeros(len(fold), bool)
    for k in range(count):
        is_inside = split.estimation & (fold != k)
        rest = replace(split, estimation=is_inside, outlying=none)
        training = rest.training
        # every row has one coordinate or more: where they are many, there are enough
        if len(training) > len(base.terms):
            continue
        try:
            fit(training, base)
        except NotEstimable as error:
            raise NotEstimable(
                f"split.nested_folds: without one of {count} folds, {error} More folds leave out "
                "fewer configurations each."
            ) from None
    return count
