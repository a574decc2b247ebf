"""Comparison of named models on one problem, for users of the Python API.

Every model is fitted exactly and cross-validated by configuration on the same folds, so that
differences between models are paired. (`comparison` compares all subsets of candidates instead.)"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np

from .._arguments import check_rows, check_type, check_whole_number
from .._linalg import TINY
from .._random import generator
from .._typing import Array, Index, Mask
from .._workers import steady_arithmetic
from ..exceptions import ArgumentError, count_words, write_rounded
from ..fitting.design import MODEL_EXPECTED, Model
from ..fitting.problem import PROBLEM_EXPECTED, Problem
from .criteria import normalise_weights
from .evaluation import Evaluation, Split, evaluate
from .splits import assign_folds

if TYPE_CHECKING:
    import pandas as pd


MAX_LISTED = 8  # models that a comparison shows


@dataclass(frozen=True)
class ComparedModel:
    """One row of a comparison; a figure is None where it is undefined.

    model: the name it was given.
    parameters: number of coefficients; rank: how many of them are estimable.
    estimation_rms_mm: rms residual of the rows the model was fitted to.
    held_out_rms_mm: rms residual of the other rows.
    cv_rms_mm: rms residual under the fits without each row's fold.
    difference_mm: cv_rms_mm minus that of the best model.
    standard_error_mm: standard error of that difference, paired by configuration. Where the
        difference is less than twice as large, the models cannot be distinguished.
    aicc, bic: information criteria of the estimation rows.
    aicc_weight, bic_weight: exp(−Δ/2) of the criterion, normalised over the models.
    note: remarks, separated by semicolons.
    """

    model: str
    parameters: int
    rank: int
    estimation_rms_mm: float | None
    held_out_rms_mm: float | None
    cv_rms_mm: float | None
    difference_mm: float | None
    standard_error_mm: float | None
    aicc: float | None
    bic: float | None
    aicc_weight: float
    bic_weight: float
    note: str


@dataclass(frozen=True, eq=False, repr=False)
class ModelComparison:
    """Result of `compare`: rows from the lowest cross-validated error to the highest, and the
    evaluation behind each name."""

    rows: tuple[ComparedModel, ...]
    evaluations: Mapping[str, Evaluation]

    @property
    def best(self) -> str:
        """Name of the model with the lowest cross-validated error."""
        return self.rows[0].model

    def __repr__(self) -> str:
        count = count_words(len(self.rows), "model")
        lines = [f"Comparison of {count}, by the cross-validated error:"]
        for row in self.rows[:MAX_LISTED]:
            error = "undefined"
            if row.cv_rms_mm is not None:
                error = f"{write_rounded(row.cv_rms_mm)} mm rms"
            parameters = count_words(row.parameters, "parameter")
            words = [f"{row.model}: {error}, {parameters}", row.note]
            lines.append(f"  {'; '.join(filter(None, words))}")
        if len(self.rows) > MAX_LISTED:
            lines.append("  …")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """Show the table in a notebook."""
        table = self.to_frame()
        return str(table.to_html(float_format="%.4g", na_rep=""))

    def to_frame(self) -> pd.DataFrame:
        """Return the rows as a table indexed by the models' names.

        The columns are the fields of `ComparedModel`; undefined figures are NaN."""
        import pandas as pd

        rows = [asdict(row) for row in self.rows]
        table = pd.DataFrame(rows)
        table = table.set_index("model")
        figures = [name for name in table.columns if name != "note"]
        real = figures[2:]
        types = dict.fromkeys(real, float)
        return table.astype(types)


@steady_arithmetic()
def compare(
    problem: Problem,
    models: Mapping[str, Model],
    *,
    folds: int = 10,
    seed: int = 0,
    estimation: Mask | None = None,
) -> ModelComparison:
    """Fit models to the same rows and compare them by cross-validation, AICc and BIC.

    problem: robot, measurements and set-up.
    models: the models by name.
    folds: number of folds; configurations are never split. 0 leaves one configuration out.
    seed: of the assignment of configurations to folds.
    estimation: mask (m,) of the rows to fit; the others are held out. Default: all rows.

    Raises ValueError where there is no model, where the mask has another shape or chooses no row,
    and for other arguments of another kind; NotEstimable where the rows cannot determine a
    model."""
    check_type("problem", problem, Problem, PROBLEM_EXPECTED)
    _check_models(models)
    split = _split(problem, folds, seed, estimation)
    evaluations = {name: evaluate(split, model, model.names) for name, model in models.items()}
    order = sorted(evaluations, key=lambda name: _cv_rms(evaluations[name]))
    best = evaluations[order[0]]
    configuration = problem.data.block[split.used]
    aicc_weights = normalise_weights([_or_infinite(evaluations[name].aicc) for name in order])
    bic_weights = normalise_weights([_or_infinite(evaluations[name].bic) for name in order])
    rows = []
    for k, name in enumerate(order):
        evaluation = evaluations[name]
        difference, standard_error = _compare_to_best(evaluation, best, configuration)
        rows.append(
            ComparedModel(
                model=name,
                parameters=evaluation.parameters,
                rank=evaluation.rank,
                estimation_rms_mm=evaluation.estimation.rms_mm,
                held_out_rms_mm=evaluation.held_out.rms_mm,
                cv_rms_mm=_or_none(evaluation.cv_rms_mm),
                difference_mm=difference,
                standard_error_mm=standard_error,
                aicc=evaluation.aicc,
                bic=evaluation.bic,
                aicc_weight=float(aicc_weights[k]),
                bic_weight=float(bic_weights[k]),
                note=_note(evaluation, difference, standard_error, best=evaluation is best),
            )
        )
    return ModelComparison(tuple(rows), evaluations)


def _check_models(models: Mapping[str, Model]) -> None:
    """Refuse what is no mapping of names to models, and none of them. Raises ArgumentError."""
    check_type("models", models, Mapping, "models by name, as {name: model}")
    if not models:
        raise ArgumentError("there is no model to compare: pass at least one, as {name: model}.")
    for name, model in models.items():
        check_type(f"models[{name!r}]", model, Model, MODEL_EXPECTED)


def _split(problem: Problem, folds: int, seed: int, estimation: Mask | None) -> Split:
    """Split a problem: folds of the estimation rows, no outliers, unknown noise."""
    rows = len(problem)
    inside = np.ones(rows, bool)
    if estimation is not None:
        inside = check_rows("estimation", estimation, rows)
    folds = check_whole_number("folds", folds, 0)
    seed = check_whole_number("seed", seed, 0)
    data = problem.data.take(inside)
    rng = generator(seed, "folds")
    outlying = np.zeros(rows, bool)
    fold = np.full(rows, -1, dtype=np.intp)
    estimation_fold = assign_folds(data, folds, rng)
    fold[inside] = estimation_fold
    return Split(problem, inside, outlying, fold, known_sigma=False)


def _compare_to_best(
    evaluation: Evaluation, best: Evaluation, configuration: Index
) -> tuple[float | None, float | None]:
    """Compare cross-validated rms [mm] with the best model's: difference and its standard error.

    By the delta method over G configurations of n_g rows: with S_g the sum of squared lengths of a
    configuration and r the rms of all m rows, z_g = (S_g − n_g r²) / (2 m r) is its influence on
    r; the standard error is √(G/(G−1) Σ (z_g − z_g of the best)²)."""
    if evaluation.crossed is None or best.crossed is None:
        return None, None
    difference = _cv_rms(evaluation) - _cv_rms(best)
    influence = _influence(evaluation.crossed, configuration)
    reference = _influence(best.crossed, configuration)
    influence = influence - reference
    count = len(influence)
    if count < 2:
        return difference, None
    squares = np.square(influence)
    square_sum = squares.sum()
    square_sum = float(square_sum)
    correction = count / (count - 1)
    variance = correction * square_sum
    standard_error = np.sqrt(variance)
    return difference, float(standard_error)


def _influence(length: Array, configuration: Index) -> Array:
    """Compute the influence (G,) of every configuration on the rms of the lengths (m,) [mm]."""
    _, unit = np.unique(configuration, return_inverse=True)
    rows = len(length)
    square = np.square(length)
    mean_square = square.mean()
    root = np.sqrt(mean_square)
    rms = float(root)
    square_sum = np.bincount(unit, square)
    count = np.bincount(unit)
    expected_square = rms**2
    expected = count * expected_square
    excess = square_sum - expected
    size = max(rms, TINY)
    divisor = 2 * rows * size
    influence = excess / divisor
    return np.asarray(influence)


def _note(
    evaluation: Evaluation, difference: float | None, standard_error: float | None, *, best: bool
) -> str:
    remarks = [evaluation.note] if evaluation.note else []
    if best:
        remarks.append("lowest cross-validated error")
    elif difference is not None and standard_error is not None and difference < 2 * standard_error:
        remarks.append("not distinguishable from the best")
    if evaluation.aicc is None:
        remarks.append("saturated: AICc undefined")
    return "; ".join(remarks)


def _cv_rms(evaluation: Evaluation) -> float:
    """Return the cross-validated rms [mm]; infinite where it is undefined."""
    rms = evaluation.cv_rms_mm
    finite = _or_none(rms)
    return _or_infinite(finite)


def _or_none(value: float | None) -> float | None:
    if value is None:
        return None
    if not np.isfinite(value):
        return None
    return value


def _or_infinite(value: float | None) -> float:
    if value is None:
        return np.inf
    return value
