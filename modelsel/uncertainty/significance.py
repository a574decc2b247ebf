"""Significance of each mechanism of a model: the displacement it causes, the evidence for it, and the
error without it; from exact folds, nothing refitted.

All linear about the model's optimum: leaving a mechanism out is fitting the other columns to the
residual with that mechanism's part put back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._typing import Array, Index
from ..exceptions import NotEstimable, number_repeated
from ..fitting.batch import Ensemble
from ..fitting.design import Model
from ..fitting.least_squares import Fit
from ..fitting.problem import Problem
from ..fitting.splines import spline
from ..mechanisms.geometry import SETUP
from ..mechanisms.terms import Mechanism
from ..selection.criteria import log_evidence
from ..selection.evaluation import Split
from ..selection.moments import (
    Coordinates,
    LinearRows,
    Moments,
    leave_out,
    measure_fit,
    measure_moments,
)
from .bootstrap import Bootstrap
from .motion_sums import Motion, MotionSum
from .stability import MIN_DETERMINED, count_determined, measure_stability

# configurations of which halves are drawn singly; more are drawn in bundles
MAX_BUNDLES = 2000


@dataclass(frozen=True)
class Significance:
    """Significance of one mechanism. A figure is None where it is undefined, as F and p of free
    functions, which are shrunk.

    mechanism, parameters: its name and the symbols of its estimable terms.
    number: which it is of several mechanisms of one name, as the ladder and the symbols have it.
    mean_mm, max_mm: displacement it causes over the measured configurations.
    mean_mrad, max_mrad: how far it turns the target there; None where no orientation was measured.
    f, p: nested F of the model against the model without it, and its p, no smaller than the posture
        bootstrap's.
    log10_evidence: Bayes factor for it, given all other mechanisms.
    cv_rms_mm, cv_rms_without_mm: cross-validated rms with and without it.
    held_out_rms_mm, held_out_rms_without_mm: held-out rms with and without it.
    catalogue: whether signs and sizes are as the catalogue expects.
    stability: share of half-samples in which it stays significant.

    p and stability take the model's names as given: the search that found them is not repeated.
    """

    mechanism: str
    parameters: tuple[str, ...]
    mean_mm: float
    max_mm: float
    f: float | None
    p: float | None
    log10_evidence: float | None
    cv_rms_mm: float | None
    cv_rms_without_mm: float | None
    held_out_rms_mm: float | None
    held_out_rms_without_mm: float | None
    catalogue: str
    stability: float | None
    number: int | None = None
    mean_mrad: float | None = None
    max_mrad: float | None = None


def assess_significance(
    split: Split,
    fitted: Fit,
    names: Sequence[str],
    boot: Bootstrap,
    rng: np.random.Generator,
    max_bundles: int = MAX_BUNDLES,
) -> tuple[Significance, ...]:
    """Assess every mechanism of a fitted model, by the displacement it causes.

    names: what the report calls the model's last mechanisms.
    max_bundles: configurations that are drawn singly into half-samples; more are drawn in bundles.
    """
    model, kept = fitted.model, set(fitted.found.kept)
    last = model.mechanisms[-len(names) :] if names else ()
    reported = dict(zip(last, names, strict=True))
    numbers = dict(zip(last, number_repeated(names), strict=True))
    judged = [
        m for m in model.mechanisms if m.name != SETUP and not kept.isdisjoint(_terms(model, m))
    ]
    terms = [_terms(model, m) for m in judged]
    unshared = [_unshared_terms(model, m, fitted) for m in judged]
    coordinates = Coordinates.of(fitted)
    reduced = _ReducedModels(split, fitted, coordinates)
    displaced = _displace(split, fitted, terms)
    training = split.training
    bundle = _bundle(training, max_bundles)
    stability = measure_stability(training, bundle, fitted, unshared, rng)
    cv, held_out = reduced.rms([])
    sigma = 1.0 if split.known_sigma else None
    assessed = []
    for k, mechanism in enumerate(judged):
        without: tuple[float | None, float | None] = (None, None)
        f, p, evidence = compare_nested(fitted, unshared[k], boot, sigma)
        if unshared[k]:
            without = reduced.rms(unshared[k])
        assessed.append(
            Significance(
                mechanism=reported.get(mechanism, mechanism.name),
                parameters=tuple(model.terms[i].symbol for i in terms[k] if i in kept),
                mean_mm=displaced[k].mean_mm,
                max_mm=displaced[k].max_mm,
                f=f,
                p=p,
                log10_evidence=evidence,
                cv_rms_mm=cv,
                cv_rms_without_mm=without[0],
                held_out_rms_mm=held_out,
                held_out_rms_without_mm=without[1],
                catalogue=check_catalogue(fitted, terms[k]),
                stability=stability[k],
                number=numbers.get(mechanism),
                mean_mrad=displaced[k].mean_mrad,
                max_mrad=displaced[k].max_mrad,
            )
        )
    return tuple(sorted(assessed, key=lambda s: -s.mean_mm))


def _bundle(problem: Problem, count: int) -> Index:
    """Number the configuration (m,) of every row; of more than `count`, the bundle of them, whose
    halves have the same answer."""
    _, configuration = np.unique(problem.data.block, return_inverse=True)
    number = configuration.reshape(-1)
    return np.asarray(number % count, dtype=np.intp)


def _terms(model: Model, mechanism: Mechanism) -> list[int]:
    """Return the indices of a mechanism's terms."""
    keys = {term.key for term in mechanism.terms}
    indices = []
    for k, term in enumerate(model.terms):
        if term.key in keys:
            indices.append(k)
    return indices


def _unshared_terms(model: Model, mechanism: Mechanism, fitted: Fit) -> list[int]:
    """Return the indices of the estimable terms that this mechanism alone brings."""
    kept = fitted.found.kept
    mechanisms = [m for m in model.mechanisms if m != mechanism]
    others = {term.key for m in mechanisms for term in m.terms}
    own = _terms(model, mechanism)
    unshared = []
    for k in own:
        term = model.terms[k]
        alone = term.key not in others
        if k not in kept:
            continue
        if alone:
            unshared.append(k)
    return unshared


def _displace(split: Split, fitted: Fit, groups: Sequence[Sequence[int]]) -> list[Motion]:
    """Compute how each group of terms moves and turns the target on the exact chain, over all
    measured configurations."""
    good = ~split.outlying
    problem = split.problem.take(good)
    problem = problem.unweighted()
    count = len(groups)
    without = np.tile(fitted.theta, (count, 1))
    for row, group in zip(without, groups, strict=True):
        row[list(group)] = 0.0
    motions = [MotionSum() for _ in groups]
    model_theta = fitted.theta[None]
    for _, part in problem.parts():
        ensemble = Ensemble(part, fitted.terms)
        residual = ensemble.residuals(model_theta)
        full = residual[0]
        for motion, theta in zip(motions, without, strict=True):
            residual = ensemble.residuals(theta[None])
            change = residual[0] - full
            motion.add(change)
    return [motion.summarise(problem) for motion in motions]


def compare_nested(
    fitted: Fit, terms: Sequence[int], boot: Bootstrap, known: float | None = None
) -> tuple[float | None, float | None, float | None]:
    """Compare the model with itself without some terms: (F, its p, log10 of the Bayes factor with a
    unit-information prior).

    RSS grows by θᵀ C⁻¹ θ, C the terms' unscaled covariance. The p is no smaller than the
    bootstrap's, to which the rows of a posture are one. Shrunk terms have no F. `known`: the
    standard deviation of whitened rows, where it is known."""
    from scipy.special import fdtrc

    freedom = fitted.freedom
    shrunk = any(spline(fitted.terms[k]) is not None for k in terms)
    if not terms or freedom <= 0 or shrunk:
        return None, None, None
    count = count_determined(fitted, terms)
    if count < MIN_DETERMINED:
        return None, None, None
    columns = list(terms)
    factor = fitted.factor[columns]
    theta = fitted.theta[columns]
    covariance = factor @ factor.T
    scaled = np.linalg.solve(covariance, theta)
    increase = float(theta @ scaled)
    mean = increase / count
    f = mean / fitted.sigma**2
    by_rows = float(fdtrc(count, freedom, f))
    p = max(by_rows, boot.p_value(fitted, terms))
    if fitted.precision is not None:
        return f, p, None
    rank = round(fitted.rows - freedom - count)
    rss = fitted.rss + increase
    evidence = log_evidence(fitted.rss, rss, fitted.rows, rank, round(count), known)
    log10_evidence = evidence / np.log(10)
    return f, p, float(log10_evidence)


class _ReducedModels:
    """Cross-validated and held-out errors of the model without some terms, from moments made once:
    no row is evaluated twice.

    Linear about the optimum: a model without a mechanism is the other columns fitted to the
    residual with that mechanism's part put back."""

    def __init__(self, split: Split, fitted: Fit, coordinates: Coordinates):
        self.fitted = fitted
        self.coordinates = coordinates
        training = split.training
        folds = split.training_folds
        at = fitted.at()
        rows = LinearRows(training, fitted.terms, at)
        self.rows = len(training)
        self.whitening = training.whitening
        self.moments = measure_fit(rows, fitted, coordinates, folds)
        self.plain = None
        if not self.whitening.uniform:
            self.plain = measure_moments(rows, coordinates, folds, weighted=False, components=3)
        is_held = ~split.estimation & ~split.outlying
        held = split.problem.take(is_held)
        self.held_rows = len(held)
        self.held = None
        if self.held_rows:
            self.held = self._measure_held(held)

    def _measure_held(self, held: Problem) -> Moments:
        """Sum the moments of the held-out positions in mm."""
        every = np.zeros(len(held), dtype=np.intp)
        rows = LinearRows(held, self.fitted.terms, self.fitted.at())
        return measure_moments(rows, self.coordinates, every, weighted=False, components=3)

    def rms(self, terms: Sequence[int]) -> tuple[float | None, float | None]:
        """Compute the (cross-validated, held-out) rms [mm] of the lengths of the residual vectors
        without some terms."""
        directions, change = leave_out(self.coordinates, self.fitted.theta, terms)
        crossed = self._cross_validate(directions, change)
        if self.held is None:
            return crossed, None
        square_sum = float(self.held.moved(change).sum())
        return crossed, float(np.sqrt(square_sum / self.held_rows))

    def _cross_validate(self, directions: Array, change: Array) -> float | None:
        """Compute the cross-validated rms [mm]; None where the model is not estimable without some
        fold."""
        reduced = self.moments.reduced(directions, change)
        try:
            shift = reduced.shift()
        except NotEstimable:
            return None
        if self.plain is None:
            squares = reduced.moved(shift) / self.whitening.weight**2
        else:
            squares = self.plain.moved(change + shift)
        mean_square = float(squares.sum()) / self.rows
        return float(np.sqrt(mean_square))


def check_catalogue(fitted: Fit, terms: Sequence[int]) -> str:
    """Check signs and sizes against the catalogue; two standard errors are allowed.

    Returns "as expected", or which terms depart from it and how."""
    errors = 2 * fitted.standard_errors
    departures = []
    for k in terms:
        term = fitted.terms[k]
        error = errors[k]
        value = float(fitted.theta[k])
        in_sign = value * term.sign
        if term.sign and in_sign < -error:
            departures.append(f"{term.symbol} has the other sign")
        if term.size is None:
            continue
        least_size = abs(value) - error
        if least_size > term.size[1]:
            departures.append(f"{term.symbol} is larger than usual")
    if not departures:
        return "as expected"
    return "; ".join(departures)
