"""Evaluations of models that are one linear step from a base's fit, from reduced data.

Each block of rows evaluates its causes once for all models, in two passes; all solving is done on
triangles and products. Besides the data, memory holds one residual length per row and model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._typing import Array, Index
from ..exceptions import NotEstimable
from ..fitting.design import Model, assemble
from ..fitting.folded_rows import FoldedProblem, Point, measure_slopes, walk_along
from ..fitting.least_squares import Fit
from ..fitting.linear_step import Step, one_step
from ..fitting.linearisation import Linearisation
from ..fitting.problem import Problem
from ..fitting.reduction import Reduction, scatter_columns, sort_by_fold
from ..fitting.sampled import respond, takes_sample
from .cross_validation import CrossValidation, FoldedData, validate_moments
from .evaluation import Evaluation, Split, build_evaluation, summarise_lengths
from .moments import Coordinates, Moments, add_products, hold_out, transform


@dataclass(frozen=True, eq=False)
class Steps:
    """Linear steps from a base's fit to any model whose terms are among those of a larger one.

    `folded` holds the terms of the `whole` model at the base's fit, `weight` [1/mm] is that of one
    coordinate."""

    whole: Model
    base_fit: Fit
    folded: FoldedData
    weight: float

    def to(self, model: Model) -> Step | None:
        """Compute the step to a model; None where the data do not determine it."""
        columns = locate_terms(self.whole, model)
        reduction = self.folded.total.select(columns)
        try:
            return one_step(model, self.base_fit, reduction, self.weight)
        except NotEstimable:
            return None


def prepare_steps(split: Split, whole: Model, base_fit: Fit, folded: FoldedData) -> Steps:
    """Prepare steps from a base's fit; `folded` holds the terms of the whole model there."""
    training = split.training
    whitening = training.whitening
    weight = whitening.typical_weight()
    return Steps(whole, base_fit, folded, weight)


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
    split: Split, start: Steps, models: Sequence[tuple[str, ...]], steps: Sequence[Step | None]
) -> list[Evaluation | None]:
    """Evaluate the model at the end of every step, under the given names, without its residuals.

    The entry of a step that cannot be made (None) is None."""
    folds_of = split.training_folds
    training = split.training
    by_slopes = takes_sample(training, start.whole, "all")
    ends = [_End.of(step) for step in steps if step is not None]
    if by_slopes:
        _measure_slopes(split.folded, start, ends)
    else:
        _measure_ends(training, ends, folds_of)
    fits = [end.fit(training.coordinates) for end in ends]
    counts = training.counted(folds_of, int(folds_of.max()) + 1)
    validations = [end.validate(fitted, counts) for end, fitted in zip(ends, fits, strict=True)]
    if by_slopes:
        sizes, held_out = _lengths_by_fold(split, fits, validations)
    else:
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


@dataclass(eq=False)
class _End:
    """Where a step ends.

    The rows there are measured in coordinates that are orthonormal where the step starts, and
    nearly so where it ends: X = Q triangle (r, r). `products` (K, r+1, r+1) of [Q | residual] of
    the folds are empty at first."""

    step: Step
    triangle: Array
    columns: Array
    products: Array

    @staticmethod
    def of(step: Step) -> _End:
        """Choose the coordinates."""
        from scipy.linalg import solve_triangular

        kept = list(step.found.kept)
        p = len(step.theta)
        rank = len(kept)
        rows = np.vstack([step.found.triangle[:, kept], step.prior[:, kept]])
        triangle = np.asarray(np.linalg.qr(rows, mode="r"))
        columns = np.zeros((p + 1, rank + 1))
        columns[kept, :-1] = solve_triangular(triangle, np.eye(rank))
        columns[-1, -1] = 1.0
        return _End(step, triangle, columns, np.zeros((0, rank + 1, rank + 1)))

    def at(self) -> Linearisation:
        """Return the point where the step ends."""
        return Linearisation(self.step.model.terms, self.step.theta)

    def fit(self, coordinates: int) -> Fit:
        """Return the fit, of so many measured coordinates."""
        kept = self.step.found.kept
        p = len(self.step.theta)
        value, vector = np.linalg.eigh(self.products.sum(0))
        # rounding may make an eigenvalue negative
        root = np.sqrt(np.maximum(value, 0.0))[:, None] * vector.T
        root[:, :-1] = root[:, :-1] @ self.triangle
        rows = scatter_columns(root, [*kept, p], p + 1)
        reduction = Reduction.empty(p).add(rows)
        return self.step.fit(Reduction(reduction.R, coordinates))

    def validate(self, fitted: Fit, counts: Index) -> CrossValidation | None:
        """Cross-validate the fit; `counts` (K,) are the folds' measured coordinates. None where it
        is not estimable without some fold."""
        own = Coordinates.of(fitted)
        turn = self.triangle @ own.factor
        columns = np.zeros(self.products.shape[1:])
        columns[:-1, :-1] = turn
        columns[:-1, -1] = -turn @ own.projection
        columns[-1, -1] = 1.0
        moments = Moments.of(columns.T @ self.products @ columns)
        try:
            return validate_moments(moments, own, counts)
        except NotEstimable:
            return None


def _measure_slopes(folded: FoldedProblem, start: Steps, ends: Sequence[_End]) -> None:
    """Measure the products of every end on very many rows: the columns' are those where the steps
    start, the residual's exact."""
    points = [Point(end.step.model.terms, end.step.theta) for end in ends]
    for end, slopes in zip(ends, measure_slopes(folded, points), strict=True):
        model = end.step.model
        columns = [*locate_terms(start.whole, model), -1]
        nothing = Reduction.empty(len(model.terms))
        turned = []
        for block, slope in zip(start.folded.blocks, slopes, strict=True):
            here = respond(nothing.add(block[:, columns]), slope)
            turned.append(here.R @ end.columns)
        rows = np.stack(turned)
        end.products = rows.transpose(0, 2, 1) @ rows


def _measure_ends(training: Problem, ends: Sequence[_End], folds_of: Index) -> None:
    """Measure the products of every end, in one pass over the rows."""
    folds = int(folds_of.max()) + 1
    for end in ends:
        end.products = np.zeros((folds, *end.products.shape[1:]))
    training, folds_of = sort_by_fold(training, folds_of)
    for rows, part in training.parts():
        for end in ends:
            block = assemble(part, end.step.model.terms, end.at())
            values = part.whitening.apply(transform(block, end.columns))
            add_products(end.products, values, folds_of[rows])


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
    for rows, part in split.problem.parts():
        for k, fitted in enumerate(fits):
            residual = fitted.residuals(part)
            sizes[k, rows] = np.linalg.norm(residual[:, :3], axis=1)
    for rows, part in split.training.parts():
        for k, (fitted, validation) in enumerate(zip(fits, validations, strict=True)):
            if validation is None:
                continue
            block = assemble(part, fitted.terms, fitted.at())
            residual = hold_out(block, folds_of[rows], validation.without)
            held_out[k, rows] = np.linalg.norm(residual, axis=1)
    return sizes, held_out


def _lengths_by_fold(
    split: Split, fits: Sequence[Fit], validations: Sequence[CrossValidation | None]
) -> tuple[Array, Array]:
    """`_lengths` of very many rows: no column is made."""
    inside, outside = np.flatnonzero(split.used), np.flatnonzero(~split.used)
    sizes = np.empty((len(fits), len(split.problem)))
    held_out = np.empty((len(fits), len(inside)))
    points = [Point(fitted.terms, fitted.theta) for fitted in fits]
    unknown = np.full((split.folded.count, 1), np.nan)
    without = [
        unknown * fitted.theta if validation is None else validation.without
        for fitted, validation in zip(fits, validations, strict=True)
    ]
    for k, rows, residual, moved in walk_along(split.folded, points, without):
        sizes[k, inside[rows]] = np.linalg.norm(residual[:3], axis=0)
        held_out[k, rows] = np.linalg.norm((residual - moved)[:3], axis=0)
    for part, problem in split.others.parts() if len(outside) else ():
        for k, fitted in enumerate(fits):
            residual = fitted.residuals(problem)
            sizes[k, outside[part]] = np.linalg.norm(residual[:, :3], axis=1)
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
