"""A study's data, split, and one candidate model measured on them: the rungs of a ladder. The table
is in table.py."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .._typing import Array, Index
from ..exceptions import NotEstimable
from ..fitting.design import Model
from ..fitting.least_squares import Fit
from ..fitting.problem import Problem
from ..fitting.shrinkage import fit_shrunk
from .criteria import aic, aicc, bic, gcv
from .cross_validation import CrossValidation, cross_validate, fold, held_out_residuals


@dataclass(frozen=True, eq=False)
class Split:
    """One problem, split: `estimation` and `held_out` row masks, `outlying` rows, folds of the
    estimation rows."""

    problem: Problem
    estimation: NDArray[np.bool_]
    outlying: NDArray[np.bool_]
    folds: Index  # (m,) −1 where a row is not used to fit
    known_sigma: bool

    @property
    def used(self) -> NDArray[np.bool_]:
        """Rows that fit: estimation without outliers."""
        return self.estimation & ~self.outlying

    def training(self) -> Problem:
        """The problem of the rows that fit."""
        return self.problem.take(self.used)

    def training_folds(self) -> Index:
        """Folds of the rows that fit, numbered without gaps."""
        return np.asarray(
            np.unique(self.folds[self.used], return_inverse=True)[1].reshape(-1), dtype=np.intp
        )


@dataclass(frozen=True, eq=False)
class Evaluation:
    """One model, measured: exact fit, errors on both sides of the split, cross-validation,
    criteria."""

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
    residual: Array = field(repr=False)  # (m, c) of every row; none in the table of subsets
    weight: float | None = None
    note: str = ""
    aic: float | None = None
    gcv: float | None = None
    ebic: float | None = None
    log_density: float | None = None  # closed-form, of every fold given the others (methods.md A.4)
    crossed: Array | None = field(
        default=None, repr=False
    )  # (k,) lengths [mm] of the used rows, cross-validated


def evaluate(
    split: Split,
    model: Model,
    names: Sequence[str],
    fitted: Fit | None = None,
    start: Fit | None = None,
) -> Evaluation:
    """Fit a model on the estimation rows, exactly (from the `start` of a similar one), and measure
    it everywhere; or take its fit."""
    training, folds_of = split.training(), split.training_folds()
    if fitted is None:
        fitted = fit_shrunk(training, model, start, held="all")
    residual = fitted.residuals(split.problem)
    held, left, cv = ~split.estimation, np.linalg.norm(residual[split.used][:, :3], axis=1), None
    if fitted.theta.size:
        try:
            folded = fold(training, model.terms, folds_of, fitted.at(), fitted.found.kept)
            cv = cross_validate(folded, fitted.found.kept, fitted.prior)
            left = np.linalg.norm(
                held_out_residuals(training, model.terms, folds_of, cv.without, fitted.at()), axis=1
            )
        except NotEstimable:
            pass
    both = (
        errors(residual[split.estimation], split.outlying[split.estimation]),
        errors(residual[held], split.outlying[held]),
    )
    return described(split, tuple(names), fitted, both, cv, left, residual)


def described(
    split: Split,
    names: tuple[str, ...],
    fitted: Fit,
    both: tuple[Errors, Errors],
    cv: CrossValidation | None,
    left: Array,
    residual: Array,
) -> Evaluation:
    """A rung in figures: errors on either side of the split, cross-validation (None: not estimable
    without some fold) with the lengths `left` [mm] under the fits without each row's fold,
    criteria."""
    n, note, density = fitted.rows, "", None
    if cv is not None:
        density = finite(float(cv.density.sum())) if fitted.precision is None else None
    elif fitted.theta.size:
        left, note = np.full(1, np.nan), "not estimable without one of the folds"
    mean, rms = float(left.mean()), float(np.sqrt(np.square(left).mean()))
    sigma, rank = 1.0 if split.known_sigma else None, n - fitted.freedom
    return Evaluation(
        names,
        len(fitted.theta),
        fitted.rank,
        *both,
        rms,
        mean,
        finite(float(aicc(fitted.rss, n, rank, sigma))),
        float(bic(fitted.rss, n, rank, sigma)),
        fitted,
        residual,
        note=note,
        aic=finite(float(aic(fitted.rss, n, rank, sigma))),
        gcv=finite(float(gcv(fitted.rss, n, rank))),
        log_density=density,
        crossed=left if len(left) == split.used.sum() else None,
    )


def finite(value: float) -> float | None:
    """The value, None where it is not a finite number."""
    return value if np.isfinite(value) else None


def turned(split: Split, nominal: Evaluation, chosen: Evaluation) -> tuple[float, float] | None:
    """Root mean square angles [rad] of orientation that the nominal and the chosen model leave: on
    held-out rows, without any on those that estimate, outliers left out; None where no orientation
    was measured."""
    if chosen.residual.shape[1] < 6:
        return None
    rows = ~split.outlying & split.problem.components_measured[:, 3]
    rows = rows & ~split.estimation if (rows & ~split.estimation).any() else rows
    before, after = (
        float(np.sqrt(np.square(r.residual[rows][:, 3:]).sum(1).mean())) if rows.any() else 0.0
        for r in (nominal, chosen)
    )
    return before, after


# Errors in mm on estimation and held-out rows, and the paired gain between two models with its
# interval.

DRAWS = 2000
DRAWN = 5000  # configurations, or bundles of them, that the bootstrap draws from


@dataclass(frozen=True)
class Errors:
    """Lengths of the residual vectors [mm] over rows; `left_out` outlying rows, `mean_all_mm` with
    them in."""

    mean_mm: float | None
    rms_mm: float | None
    p95_mm: float | None
    max_mm: float | None
    rows: int
    left_out: int
    mean_all_mm: float | None


def errors(residual: Array, outlying: NDArray[np.bool_] | None = None) -> Errors:
    """Of residuals (m, 3) [mm]; None where there are no rows."""
    return errors_of(np.linalg.norm(residual[:, :3], axis=1), outlying)


def errors_of(size: Array, outlying: NDArray[np.bool_] | None = None) -> Errors:
    """Of lengths (m,) [mm]."""
    good = size if outlying is None else size[~outlying]
    left = len(size) - len(good)
    if not len(good):
        return Errors(None, None, None, None, 0, left, float(size.mean()) if len(size) else None)
    return Errors(
        float(good.mean()),
        float(np.sqrt(np.square(good).mean())),
        float(np.percentile(good, 95)),
        float(good.max()),
        len(good),
        left,
        float(size.mean()),
    )


@dataclass(frozen=True)
class Gain:
    """Held-out rms before and after, and the 95 % interval [low, high] of their difference, by
    configurations."""

    held_out_rms_before_mm: float | None
    held_out_rms_after_mm: float | None
    interval_mm: tuple[float, float] | None


@dataclass(frozen=True, eq=False)
class Resampled:
    """Rows drawn anew by whole configurations: the configuration, or bundle of them, of every row
    (m,), and how often each is in every draw (DRAWS, K); None with fewer than three."""

    index: Index
    draw: NDArray[np.int64] | None

    @staticmethod
    def of(block: Index, rng: np.random.Generator) -> Resampled:
        """By configurations (m,); one drawing serves every pair of models on the same rows."""
        blocks, index = np.unique(block, return_inverse=True)
        if (
            len(blocks) > DRAWN
        ):  # many configurations are drawn in bundles: the interval is the same
            blocks, index = np.arange(DRAWN), index % DRAWN
        some = (
            rng.multinomial(len(blocks), np.full(len(blocks), 1 / len(blocks)), DRAWS)
            if len(blocks) >= 3
            else None
        )
        return Resampled(index, some)


def gain(before: Array, after: Array, block: Index, rng: np.random.Generator) -> Gain:
    """Paired: both residuals (m, 3) on the same rows; the bootstrap draws whole configurations."""
    return paired(before, after, Resampled.of(block, rng))


def paired(before: Array, after: Array, rows: Resampled) -> Gain:
    """The gain on rows already drawn."""
    if not len(before):
        return Gain(None, None, None)
    squares = np.stack(
        [np.bincount(rows.index, np.square(r[:, :3]).sum(1)) for r in (before, after)]
    )
    whole = np.sqrt(squares.sum(1) / len(before))
    if rows.draw is None:
        return Gain(float(whole[0]), float(whole[1]), None)
    first, second = np.sqrt(squares @ rows.draw.T / (rows.draw @ np.bincount(rows.index)))
    low, high = np.percentile(first - second, [2.5, 97.5])
    return Gain(float(whole[0]), float(whole[1]), (float(low), float(high)))


def surprise(expected: Array, own: Index, seen: Array, block: Index) -> tuple[float, float]:
    """(how many times as large, rms, p): are held-out lengths `seen` [mm] larger than the
    cross-validated ones `expected`, of configurations `block` and `own`? Wilcoxon's rank sum of
    mean squares per configuration, so that tails do not matter; (1, 1) with fewer than five
    configurations on a side."""
    from scipy.special import ndtr

    first, second = (
        _per_block(np.square(size), unit) for size, unit in ((expected, own), (seen, block))
    )
    a, b = len(first), len(second)
    if min(a, b) < 5 or not first.mean() > 0:
        return 1.0, 1.0
    rank = np.empty(a + b)
    rank[np.argsort(np.concatenate([first, second]), kind="stable")] = np.arange(1, a + b + 1)
    z = (rank[a:].sum() - b * (a + b + 1) / 2) / np.sqrt(a * b * (a + b + 1) / 12)
    return float(np.sqrt(second.mean() / first.mean())), float(ndtr(-z))


def _per_block(values: Array, block: Index) -> Array:
    which = np.unique(block, return_inverse=True)[1]
    return np.asarray(np.bincount(which, values) / np.bincount(which))
