"""Evaluation of one model on a split data set: errors, cross-validation, criteria.

Lengths of residual vectors are in mm. The comparison of many models is in `comparison`, the gain of
one over another in `gain`."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from .._typing import Array, Index, Mask
from ..exceptions import NotEstimable, count_words, write_rounded
from ..fitting.design import Model
from ..fitting.folded_rows import FoldedProblem, Point, walk_along
from ..fitting.least_squares import Fit
from ..fitting.problem import Problem
from ..fitting.shrinkage import fit_shrunk
from ..fitting.state_variables import MAX_ROWS_KEPT
from .criteria import aic, aicc, bic, gcv
from .cross_validation import CrossValidation, cross_validate_fit
from .moments import LinearRows


@dataclass(frozen=True, eq=False)
class Split:
    """A problem split into estimation and held-out rows.

    problem: all m rows.
    estimation: mask (m,) of the rows that models are fitted to; the others are held out.
    outlying: mask (m,) of rows that are left out of fits and errors.
    folds: fold (m,) of every estimation row; −1 where a row is not used to fit.
    known_sigma: whether the standard deviation of whitened rows is known to be one.
    undecided: those of the outlying rows (m,) that are no outliers, where there are any: held-out
        rows of which no estimation row tells on which side of a step they are.
    """

    problem: Problem
    estimation: Mask
    outlying: Mask
    folds: Index
    known_sigma: bool
    undecided: Mask | None = None

    def __repr__(self) -> str:
        count = len(self.estimation)
        rows = count_words(count, "row")
        inside = int(self.estimation.sum())
        outside = int(self.outlying.sum())
        estimate = f"{inside:,} estimate"
        return f"Split of {rows}: {estimate}, {outside:,} left out"

    @property
    def outliers(self) -> Mask:
        """Mask (m,) of the outlying rows that are bad shots."""
        if self.undecided is None:
            return self.outlying
        return self.outlying & ~self.undecided

    @property
    def used(self) -> Mask:
        """Mask (m,) of the rows that models are fitted to: estimation rows without outliers."""
        inside = self.estimation
        good = ~self.outlying
        return inside & good

    @cached_property
    def training(self) -> Problem:
        """The problem of the rows that models are fitted to."""
        return self.problem.take(self.used)

    @cached_property
    def others(self) -> Problem:
        """The problem of all other rows."""
        return self.problem.take(~self.used)

    @cached_property
    def folded(self) -> FoldedProblem:
        """The training rows, fold after fold."""
        return FoldedProblem.of(self.training, self.training_folds)

    @cached_property
    def training_folds(self) -> Index:
        """The folds of the training rows, numbered without gaps."""
        _, number = np.unique(self.folds[self.used], return_inverse=True)
        return np.asarray(number.reshape(-1), dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Evaluation of one model: exact fit, errors on both sides of the split, cross-validation,
    criteria. A figure is None where it is undefined.

    names: names of the model's mechanisms.
    parameters, rank: number of coefficients, and of those that are estimable.
    estimation, held_out: errors on either side of the split.
    cv_rms_mm, cv_mean_mm: length of the residual vectors under the fits without each row's fold.
    aicc, bic: information criteria of the estimation rows.
    fit: the fitted model.
    residual: residuals (m, c) of all rows; no rows where the model was evaluated from reduced data.
    weight: posterior weight among the models it was compared with.
    note: remarks, separated by semicolons.
    aic, gcv, ebic: further criteria; EBIC only for a model chosen among scanned candidates.
    log_density: log predictive density of every fold given the others, in closed form.
    crossed: cross-validated lengths [mm] (k,) of the k training rows.
    """

    names: tuple[str, ...]
    parameters: int
    rank: int
    estimation: Errors
    held_out: Errors
    cv_rms_mm: float | None
    cv_mean_mm: float | None
    aicc: float | None
    bic: float | None
    fit: Fit = field(repr=False)
    residual: Array = field(repr=False)
    weight: float | None = None
    note: str = ""
    aic: float | None = None
    gcv: float | None = None
    ebic: float | None = None
    log_density: float | None = None
    crossed: Array | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        errors = self.held_out if self.held_out.rms_mm is not None else self.estimation
        left = "" if errors.rms_mm is None else f", {write_rounded(errors.rms_mm)} mm rms"
        where = " held out" if left and errors is self.held_out else ""
        return f"Evaluation of {', '.join(self.names)}: rank {self.rank}{left}{where}"


def evaluate(
    split: Split,
    model: Model,
    names: Sequence[str],
    fitted: Fit | None = None,
    start: Fit | None = None,
) -> Evaluation:
    """Fit a model to the training rows and evaluate it on all rows.

    `fitted`: a fit to evaluate instead; `start`: the fit of a similar model to start from."""
    training = split.training
    if len(training) > MAX_ROWS_KEPT:
        training.keep_values(model.terms)
    folds = split.training_folds
    if fitted is None:
        fitted = fit_shrunk(training, model, start, held="all", fold_of=folds)
    point = fitted.at()
    rows = LinearRows(training, fitted.terms, point)
    validation = None
    if fitted.theta.size:
        with suppress(NotEstimable):
            validation = cross_validate_fit(rows, fitted, folds)
    residual, left = _measure(split, rows, fitted, folds, validation)
    position_left = left[:, :3]
    length = np.linalg.norm(position_left, axis=1)
    inside = split.estimation
    outside = ~inside
    outlying = split.outlying
    errors = (
        summarise_errors(residual[inside], outlying[inside]),
        summarise_errors(residual[outside], outlying[outside]),
    )
    labels = tuple(names)
    return build_evaluation(split, labels, fitted, errors, validation, length, residual)


def _measure(
    split: Split, rows: LinearRows, fitted: Fit, folds_of: Index, validation: CrossValidation | None
) -> tuple[Array, Array]:
    """Compute the residuals (m, c) of all rows, and those (k, c) of the training `rows`: under the
    fits without each row's fold, where the fit was cross-validated."""
    if validation is not None and fitted.reduction.parts:
        return _measure_by_fold(split, fitted, validation.without)
    residual = fitted.residuals(split.problem)
    if validation is None:
        return residual, residual[split.used]
    return residual, rows.held_out(folds_of, validation.without)


def _measure_by_fold(split: Split, fitted: Fit, without: Array) -> tuple[Array, Array]:
    """Compute the residuals (m, c) of all rows, and those (k, 3) of the training rows under the fit
    without their fold, linear about it [mm, rad]; no column is made.

    `without` (K, p): the change of the coefficients without each fold."""
    inside, outside = np.flatnonzero(split.used), np.flatnonzero(~split.used)
    residual = np.empty((len(split.problem), split.problem.components))
    held_out = np.empty((len(inside), 3))
    point = Point(fitted.terms, fitted.theta)
    for _, rows, left, moved in walk_along(split.folded, [point], [without]):
        residual[inside[rows]] = left.T
        held_out[rows] = (left - moved)[:3].T
    if len(outside):
        residual[outside] = fitted.residuals(split.others)
    return residual, held_out


def build_evaluation(
    split: Split,
    names: tuple[str, ...],
    fitted: Fit,
    errors: tuple[Errors, Errors],
    validation: CrossValidation | None,
    length: Array,
    residual: Array,
) -> Evaluation:
    """Build an evaluation from errors on either side of the split and the cross-validation.

    `validation` is None where the model is not estimable without some fold; `length` (k,) [mm]
    are the training rows' under the fits without their fold."""
    note = ""
    density = None
    if validation is not None and fitted.precision is None:
        density = drop_infinite(float(validation.density.sum()))
    elif validation is None and fitted.theta.size:
        length = np.full(1, np.nan)
        note = "not estimable without one of the folds"
    n = fitted.rows
    rank = n - fitted.freedom
    sigma = 1.0 if split.known_sigma else None
    return Evaluation(
        names,
        len(fitted.theta),
        fitted.rank,
        *errors,
        float(np.sqrt(np.square(length).mean())),
        float(length.mean()),
        drop_infinite(float(aicc(fitted.rss, n, rank, sigma))),
        float(bic(fitted.rss, n, rank, sigma)),
        fitted,
        residual,
        note=note,
        aic=drop_infinite(float(aic(fitted.rss, n, rank, sigma))),
        gcv=drop_infinite(float(gcv(fitted.rss, n, rank))),
        log_density=density,
        crossed=length if len(length) == split.used.sum() else None,
    )


def drop_infinite(value: float) -> float | None:
    """Return the value, or None where it is not a finite number."""
    if not np.isfinite(value):
        return None
    return value


def measure_orientation(
    split: Split, nominal: Evaluation, chosen: Evaluation
) -> tuple[float, float] | None:
    """Compute the rms angles [rad] of orientation that the nominal and the chosen model leave.

    Over held-out rows without outliers; where none of these has an orientation, over estimation
    rows. None where no orientation was measured."""
    if chosen.residual.shape[1] < 6:
        return None
    rows = mark_oriented(split)
    held_out = rows & ~split.estimation
    if held_out.any():
        rows = held_out
    before = _rms_angle(nominal.residual[rows])
    after = _rms_angle(chosen.residual[rows])
    return before, after


def mark_oriented(split: Split) -> Mask:
    """Mark the rows (m,) with a measured orientation, outliers left out, where some have one."""
    rows = ~split.outlying
    measured = split.problem.measured
    if measured is not None:
        rows &= measured[:, 3]
    return rows


def _rms_angle(residual: Array) -> float:
    """Compute the rms length of the orientation part of residuals (m, 6); zero where there are no
    rows."""
    if not len(residual):
        return 0.0
    angles = residual[:, 3:]
    squares = np.square(angles)
    squares = squares.sum(1)
    rms = np.sqrt(squares.mean())
    return float(rms)


@dataclass(frozen=True)
class Errors:
    """Lengths of residual vectors [mm]: mean, rms, 95 % quantile and maximum over `rows` rows.

    `left_out` outlying rows are not among these; `mean_all_mm` is the mean with them. Figures are
    None where there are no rows."""

    mean_mm: float | None
    rms_mm: float | None
    p95_mm: float | None
    max_mm: float | None
    rows: int
    left_out: int
    mean_all_mm: float | None


def summarise_errors(residual: Array, outlying: Mask | None = None) -> Errors:
    """Summarise the lengths of residual vectors (m, 3) [mm]."""
    return summarise_lengths(np.linalg.norm(residual[:, :3], axis=1), outlying)


def summarise_lengths(length: Array, outlying: Mask | None = None) -> Errors:
    """Summarise lengths (m,) [mm] of residual vectors."""
    good = length if outlying is None else length[~outlying]
    left_out = len(length) - len(good)
    mean_all = float(length.mean()) if len(length) else None
    if not len(good):
        return Errors(None, None, None, None, 0, left_out, mean_all)
    return Errors(
        float(good.mean()),
        float(np.sqrt(np.square(good).mean())),
        float(np.percentile(good, 95)),
        float(good.max()),
        len(good),
        left_out,
        mean_all,
    )
