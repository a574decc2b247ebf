"""A study's data, split, and one candidate model measured on them: the rungs of a ladder. The table is in table.py."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .._typing import Array, Index
from ..exceptions import NotEstimable
from ..fitting.design import Model
from ..fitting.least_squares import Fit
from ..fitting.problem import Scene
from ..fitting.shrinkage import fit_shrunk
from .criteria import aic, aicc, bic, gcv
from .folds import CrossValidation, cross_validate, fold, held_out_residuals
from .validate import Errors, errors


@dataclass(frozen=True, eq=False)
class Data:
    """One scene, split: `estimation` and `held_out` row masks, `outlying` rows, folds of the estimation rows."""

    scene: Scene
    estimation: NDArray[np.bool_]
    outlying: NDArray[np.bool_]
    folds: Index                                    # (m,) −1 where a row is not used to fit
    known_sigma: bool

    @property
    def used(self) -> NDArray[np.bool_]:
        """Rows that fit: estimation without outliers."""
        return self.estimation & ~self.outlying

    def training(self) -> Scene:
        """The scene of the rows that fit."""
        return self.scene.take(self.used)

    def training_folds(self) -> Index:
        """Folds of the rows that fit, numbered without gaps."""
        return np.asarray(np.unique(self.folds[self.used], return_inverse=True)[1].reshape(-1), dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Rung:
    """One model, measured: exact fit, errors on both sides of the split, cross-validation, criteria."""

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
    residual: Array = field(repr=False)             # (m, c) of every row; none in the table of subsets
    weight: float | None = None
    note: str = ""
    aic: float | None = None
    gcv: float | None = None
    ebic: float | None = None
    log_density: float | None = None                # closed-form, of every fold given the others (methods.md A.4)
    crossed: Array | None = field(default=None, repr=False)     # (k,) lengths [mm] of the used rows, cross-validated


def rung(data: Data, model: Model, names: Sequence[str], fitted: Fit | None = None, start: Fit | None = None) -> Rung:
    """Fit a model on the estimation rows, exactly (from the `start` of a similar one), and measure it everywhere; or take its
    fit."""
    training, folds_of = data.training(), data.training_folds()
    if fitted is None:
        fitted = fit_shrunk(training, model, start, held="all")
    residual = fitted.residuals(data.scene)
    held, left, cv = ~data.estimation, np.linalg.norm(residual[data.used][:, :3], axis=1), None
    if fitted.theta.size:
        try:
            folded = fold(training, model.terms, folds_of, fitted.at(), fitted.found.kept)
            cv = cross_validate(folded, fitted.found.kept, fitted.prior)
            left = np.linalg.norm(held_out_residuals(training, model.terms, folds_of, cv.without, fitted.at()), axis=1)
        except NotEstimable:
            pass
    both = (errors(residual[data.estimation], data.outlying[data.estimation]), errors(residual[held], data.outlying[held]))
    return described(data, tuple(names), fitted, both, cv, left, residual)


def described(data: Data, names: tuple[str, ...], fitted: Fit, both: tuple[Errors, Errors], cv: CrossValidation | None,
              left: Array, residual: Array) -> Rung:
    """A rung in figures: errors on either side of the split, cross-validation (None: not estimable without some fold) with the
    lengths `left` [mm] under the fits without each row's fold, criteria."""
    n, note, density = fitted.rows, "", None
    if cv is not None:
        density = finite(float(cv.density.sum())) if fitted.precision is None else None
    elif fitted.theta.size:
        left, note = np.full(1, np.nan), "not estimable without one of the folds"
    mean, rms = float(left.mean()), float(np.sqrt(np.square(left).mean()))
    sigma, rank = 1.0 if data.known_sigma else None, n - fitted.freedom
    return Rung(names, len(fitted.theta), fitted.rank, *both, rms, mean, finite(float(aicc(fitted.rss, n, rank, sigma))),
                float(bic(fitted.rss, n, rank, sigma)), fitted, residual, note=note,
                aic=finite(float(aic(fitted.rss, n, rank, sigma))), gcv=finite(float(gcv(fitted.rss, n, rank))),
                log_density=density, crossed=left if len(left) == data.used.sum() else None)


def finite(value: float) -> float | None:
    """The value, None where it is not a finite number."""
    return value if np.isfinite(value) else None
