"""Significance of each mechanism of a model: the displacement it causes, the evidence for it, and the
error without it; from exact folds, nothing refitted.

All linear about the model's optimum: leaving a mechanism out is fitting the other columns to the
residual with that mechanism's part put back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .._typing import Array, Index
from ..exceptions import NotEstimable
from ..fitting.batch import Ensemble
from ..fitting.design import Model
from ..fitting.identifiability import identify, solve
from ..fitting.least_squares import Fit
from ..fitting.problem import Problem
from ..fitting.reduction import Reduction, reduce_problem
from ..fitting.splines import spline
from ..fitting.whitening import UNIT, Whitening
from ..mechanisms.geometry import SETUP
from ..mechanisms.terms import Mechanism
from ..selection.criteria import log_evidence
from ..selection.cross_validation import FoldedData, cross_validate, fold
from ..selection.evaluation import Split
from .bootstrap import Bootstrap
from .stability import MIN_DETERMINED, count_determined, measure_stability

# configurations of which halves are drawn singly; more are drawn in bundles
MAX_BUNDLES = 2000


@dataclass(frozen=True)
class Significance:
    """Significance of one mechanism. A figure is None where it is undefined, as F and p of free
    functions, which are shrunk.

    mechanism, parameters: its name and the symbols of its estimable terms.
    mean_mm, max_mm: displacement it causes over the measured configurations.
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
    judged = [
        m for m in model.mechanisms if m.name != SETUP and not kept.isdisjoint(_terms(model, m))
    ]
    terms = [_terms(model, m) for m in judged]
    unshared = [_unshared_terms(model, m, fitted) for m in judged]
    reduced = _ReducedModels(split, fitted)
    displaced = _displace(split, fitted, terms)
    stability = measure_stability(reduced.bundles(max_bundles), fitted, unshared, rng)
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
                mean_mm=displaced[k][0],
                max_mm=displaced[k][1],
                f=f,
                p=p,
                log10_evidence=evidence,
                cv_rms_mm=cv,
                cv_rms_without_mm=without[0],
                held_out_rms_mm=held_out,
                held_out_rms_without_mm=without[1],
                catalogue=check_catalogue(fitted, terms[k]),
                stability=stability[k],
            )
        )
    return tuple(sorted(assessed, key=lambda s: -s.mean_mm))


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


def _displace(
    split: Split, fitted: Fit, groups: Sequence[Sequence[int]]
) -> list[tuple[float, float]]:
    """Compute the (mean, largest) displacement [mm] of the target that each group of terms causes
    on the exact chain, over all measured configurations."""
    good = ~split.outlying
    problem = split.problem.take(good)
    problem = problem.unweighted()
    count = len(groups)
    without = np.tile(fitted.theta, (count, 1))
    for row, group in zip(without, groups, strict=True):
        row[list(group)] = 0.0
    total = np.zeros(count)
    largest = np.zeros(count)
    model_theta = fitted.theta[None]
    for _, part in problem.parts():
        ensemble = Ensemble(part, fitted.terms)
        residual = ensemble.residuals(model_theta)
        full = residual[0, :3]
        for g, theta in enumerate(without):
            residual = ensemble.residuals(theta[None])
            change = residual[0, :3] - full
            size = np.linalg.norm(change, axis=0)
            total[g] += size.sum()
            largest[g] = max(largest[g], size.max())
    mean = total / len(problem)
    return list(zip(mean.tolist(), largest.tolist(), strict=True))


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
    """Cross-validated and held-out errors of the model without some terms, from triangles made once:
    no row is evaluated twice.

    Linear about the optimum: a model without a mechanism is the other columns fitted to the
    residual with that mechanism's part put back."""

    def __init__(self, split: Split, fitted: Fit):
        self.fitted = fitted
        self.training = split.training()
        self.folds = split.training_folds()
        self.folded = self._fold(self.training, self.folds)
        self.plain = self._unweighted()
        outside = ~split.estimation
        good = ~split.outlying
        rows = outside & good
        held = split.problem.take(rows)
        self.held_rows = len(held)
        self.held_triangle = None
        if self.held_rows:
            self.held_triangle = self._reduce_held(held)

    def _fold(self, problem: Problem, folds: Index) -> FoldedData:
        fitted = self.fitted
        terms = fitted.terms
        kept = fitted.found.kept
        at = fitted.at()
        return fold(problem, terms, folds, at, kept)

    def _unweighted(self) -> FoldedData:
        """Return the folds in mm."""
        folded = self.folded
        whitening = self.training.whitening
        if whitening.uniform:
            blocks = folded.blocks / whitening.weight
            return FoldedData(blocks, folded.rows)
        plain = self.training.unweighted()
        return self._fold(plain, self.folds)

    def _reduce_held(self, held: Problem) -> Array:
        """Reduce the held-out positions in mm to a triangle."""
        whitening = UNIT
        if held.components == 6:
            rows = len(held)
            select = np.diag([1.0, 1, 1, 0, 0, 0])
            matrices = np.broadcast_to(select, (rows, 6, 6))
            whitening = Whitening(matrices=matrices)
        fitted = self.fitted
        kept = fitted.found.kept
        plain = replace(held, whitening=whitening)
        reduction = reduce_problem(plain, fitted.terms, fitted.at(), kept)
        return reduction.R

    def bundles(self, count: int) -> FoldedData:
        """Return a fold per configuration; of more than `count`, per bundle of them, whose halves
        have the same answer."""
        data = self.training.data
        _, configuration = np.unique(data.block, return_inverse=True)
        number = configuration.reshape(-1)
        bundle = number % count
        return self._fold(self.training, bundle)

    def rms(self, terms: Sequence[int]) -> tuple[float | None, float | None]:
        """Compute the (cross-validated, held-out) rms [mm] of the lengths of the residual vectors
        without some terms."""
        theta = self.fitted.theta
        estimable = self.fitted.found.kept
        removed = list(terms)
        kept = [k for k in estimable if k not in removed]
        folded = self.folded
        blocks = self._put_back(folded.blocks, removed)
        data = FoldedData(blocks, folded.rows)
        total = data.total
        prior = self._prior_without(removed, kept)
        if prior is not None:
            joined = total.add(prior)
            total = Reduction(joined.R, total.rows)
        selected = total.select(kept)
        found = identify(selected).kept
        kept = [kept[i] for i in found]
        crossed = self._cross_validate(data, removed, kept, prior)
        triangle = self.held_triangle
        if triangle is None:
            return crossed, None
        # the fit without the terms, as a step from the model's coefficients
        beta, _, _ = solve(total, kept)
        step = np.zeros(len(theta))
        step[kept] = beta
        step[removed] = -theta[removed]
        response = triangle[:, -1]
        columns = triangle[:, :-1]
        predicted = columns @ step
        residual = response - predicted
        squares = np.square(residual)
        square_sum = squares.sum()
        mean_square = square_sum / self.held_rows
        rms = np.sqrt(mean_square)
        return crossed, float(rms)

    def _put_back(self, rows: Array, removed: Sequence[int]) -> Array:
        """Put the part of the removed terms into the response of rows (..., p+1)."""
        columns = list(removed)
        theta = self.fitted.theta
        theta = theta[columns]
        changed = rows.copy()
        part = changed[..., columns]
        changed[..., -1] += part @ theta
        return changed

    def _prior_without(self, removed: Sequence[int], kept: Sequence[int]) -> Array | None:
        """Select the prior's rows that say something of the kept terms."""
        prior = self.fitted.prior
        if prior is None:
            return None
        prior = self._put_back(prior, removed)
        if not kept:
            return prior[:0]
        size = np.abs(prior[:, list(kept)])
        informative = size.any(1)
        return prior[informative]

    def _cross_validate(
        self, data: FoldedData, removed: Sequence[int], kept: Sequence[int], prior: Array | None
    ) -> float | None:
        """Compute the cross-validated rms [mm]; None where the model is not estimable without some
        fold."""
        columns = list(removed)
        try:
            validation = cross_validate(data, kept, prior)
        except NotEstimable:
            return None
        without = validation.without.copy()
        without[:, columns] -= self.fitted.theta[columns]
        blocks = self.plain.blocks
        design = blocks[:, :, :-1]
        response = blocks[:, :, -1]
        predicted = np.einsum("khp,kp->kh", design, without)
        squares = np.square(response - predicted)
        square_sum = squares.sum()
        rows = len(self.training)
        mean_square = square_sum / rows
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
