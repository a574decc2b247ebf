"""Evaluations of models that are one linear step from a base's fit, from reduced data.

A block of rows evaluates its causes once for all models, in three passes; what is solved is solved
on triangles. Beyond the data this takes one residual length per row and model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._typing import Array, Index
from ..exceptions import NotEstimable
from ..fitting.design import Model
from ..fitting.least_squares import Fit
from ..fitting.linear_step import Step, one_step
from ..fitting.linearisation import Linearisation
from ..fitting.reduction import Reduction
from .cross_validation import (
    CrossValidation,
    FoldedData,
    cross_validate,
    fold_models,
    held_out_residuals,
)
from .evaluation import Evaluation, Split, build_evaluation, summarise_lengths


@dataclass(frozen=True, eq=False)
class Steps:
    """Linear steps from a base's fit to any model whose terms are among those of a larger one.

    `reduction` is the triangle of the terms of the `whole` model at the base's fit, `weight`
    [1/mm] that of one coordinate."""

    whole: Model
    base_fit: Fit
    reduction: Reduction
    weight: float

    def to(self, model: Model) -> Step | None:
        """Compute the step to a model; None where the data do not determine it."""
        columns = locate_terms(self.whole, model)
        try:
            return one_step(model, self.base_fit, self.reduction.select(columns), self.weight)
        except NotEstimable:
            return None


def prepare_steps(split: Split, whole: Model, base_fit: Fit, folded: FoldedData) -> Steps:
    """Prepare steps from a base's fit; `folded` holds the terms of the whole model there."""
    return Steps(whole, base_fit, folded.total, split.training().whitening.typical_weight())


def locate_terms(whole: Model, model: Model) -> list[int]:
    """Return the positions of a model's terms among those of a larger model."""
    place = {t.key: k for k, t in enumerate(whole.terms)}
    return [place[t.key] for t in model.terms]


def evaluate_steps(
    split: Split, models: Sequence[tuple[str, ...]], steps: Sequence[Step | None]
) -> list[Evaluation | None]:
    """Evaluate the model at the end of every step, under the given names, without its residuals.

    The entry of a step that cannot be made (None) is None."""
    folds_of = split.training_folds()
    possible = [step for step in steps if step is not None]
    points = [
        (s.model.terms, Linearisation(s.model.terms, s.theta), s.found.kept) for s in possible
    ]
    folded = fold_models(split.training(), points, folds_of)
    fits = [step.fit(data.total) for step, data in zip(possible, folded, strict=True)]
    validations = [_validate(data, fitted) for data, fitted in zip(folded, fits, strict=True)]
    sizes, held_out = _lengths(split, fits, validations, folds_of)
    figures = iter(zip(fits, validations, sizes, held_out, strict=True))
    return [
        None if step is None else _evaluation(split, names, *next(figures))
        for names, step in zip(models, steps, strict=True)
    ]


def _validate(folded: FoldedData, fitted: Fit) -> CrossValidation | None:
    try:
        return cross_validate(folded, fitted.found.kept, fitted.prior)
    except NotEstimable:
        return None


def _lengths(
    split: Split,
    fits: Sequence[Fit],
    validations: Sequence[CrossValidation | None],
    folds_of: Index,
) -> tuple[Array, Array]:
    """Compute the lengths [mm] of residual vectors: (models, m) under every fit, and (models,
    training rows) under the fits without each row's fold (NaN without cross-validation)."""
    sizes = np.empty((len(fits), len(split.problem)))
    held_out = np.full((len(fits), int(split.used.sum())), np.nan)
    place = np.cumsum(split.used) - 1
    for rows, part in split.problem.parts():
        used = split.used[rows]
        training = part.take(used)
        index = place[rows][used]
        for k, (fitted, validation) in enumerate(zip(fits, validations, strict=True)):
            sizes[k, rows] = np.linalg.norm(fitted.residuals(part)[:, :3], axis=1)
            if validation is None or not len(index):
                continue
            residual = held_out_residuals(
                training, fitted.terms, folds_of[index], validation.without, fitted.at()
            )
            held_out[k, index] = np.linalg.norm(residual, axis=1)
    return sizes, held_out


def _evaluation(
    split: Split,
    names: tuple[str, ...],
    fitted: Fit,
    validation: CrossValidation | None,
    size: Array,
    held_out: Array,
) -> Evaluation:
    inside, outside = split.estimation, ~split.estimation
    errors = (
        summarise_lengths(size[inside], split.outlying[inside]),
        summarise_lengths(size[outside], split.outlying[outside]),
    )
    no_residual = np.zeros((0, split.problem.components))
    return build_evaluation(split, names, fitted, errors, validation, held_out, no_residual)
