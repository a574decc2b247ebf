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
        reduction = self.reduction.select(columns)
        try:
            return one_step(model, self.base_fit, reduction, self.weight)
        except NotEstimable:
            return None


def prepare_steps(split: Split, whole: Model, base_fit: Fit, folded: FoldedData) -> Steps:
    """Prepare steps from a base's fit; `folded` holds the terms of the whole model there."""
    training = split.training()
    whitening = training.whitening
    weight = whitening.typical_weight()
    total = folded.total
    return Steps(whole, base_fit, total, weight)


def locate_terms(whole: Model, model: Model) -> list[int]:
    """Return the positions of a model's terms among those of a larger model."""
    place = {}
    for k, term in enumerate(whole.terms):
        place[term.key] = k
    positions = []
    for term in model.terms:
        position = place[term.key]
        positions.append(position)
    return positions


def evaluate_steps(
    split: Split, models: Sequence[tuple[str, ...]], steps: Sequence[Step | None]
) -> list[Evaluation | None]:
    """Evaluate the model at the end of every step, under the given names, without its residuals.

    The entry of a step that cannot be made (None) is None."""
    folds_of = split.training_folds()
    training = split.training()
    possible = [step for step in steps if step is not None]
    points = []
    for step in possible:
        terms = step.model.terms
        at = Linearisation(terms, step.theta)
        kept = step.found.kept
        points.append((terms, at, kept))
    folded = fold_models(training, points, folds_of)
    fits = []
    validations = []
    for step, data in zip(possible, folded, strict=True):
        fitted = step.fit(data.total)
        validation = _validate(data, fitted)
        fits.append(fitted)
        validations.append(validation)
    sizes, held_out = _lengths(split, fits, validations, folds_of)
    figures = zip(fits, validations, sizes, held_out, strict=True)
    evaluations: list[Evaluation | None] = []
    for names, one in zip(models, steps, strict=True):
        evaluation = None
        if one is not None:
            figure = next(figures)
            evaluation = _evaluation(split, names, *figure)
        evaluations.append(evaluation)
    return evaluations


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
    models = len(fits)
    rows_in_all = len(split.problem)
    used_rows = int(split.used.sum())
    sizes = np.empty((models, rows_in_all))
    held_out = np.full((models, used_rows), np.nan)
    place = np.cumsum(split.used) - 1
    for rows, part in split.problem.parts():
        used = split.used[rows]
        training = part.take(used)
        places = place[rows]
        index = places[used]
        folds = folds_of[index]
        for k, fitted in enumerate(fits):
            residual = fitted.residuals(part)
            positions = residual[:, :3]
            sizes[k, rows] = np.linalg.norm(positions, axis=1)
            validation = validations[k]
            if validation is None or not len(index):
                continue
            residual = held_out_residuals(
                training, fitted.terms, folds, validation.without, fitted.at()
            )
            length = np.linalg.norm(residual, axis=1)
            held_out[k, index] = length
    return sizes, held_out


def _evaluation(
    split: Split,
    names: tuple[str, ...],
    fitted: Fit,
    validation: CrossValidation | None,
    size: Array,
    held_out: Array,
) -> Evaluation:
    inside = split.estimation
    outside = ~inside
    outlying = split.outlying
    errors = (
        summarise_lengths(size[inside], outlying[inside]),
        summarise_lengths(size[outside], outlying[outside]),
    )
    components = split.problem.components
    no_residual = np.zeros((0, components))
    return build_evaluation(split, names, fitted, errors, validation, held_out, no_residual)
