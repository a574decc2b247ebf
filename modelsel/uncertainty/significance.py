"""What each mechanism of a model matters, in mm, in evidence, and in what is lost without it; by
exact folds, nothing refitted.

All linear about the model's optimum: leaving a mechanism out is fitting the other columns to the
residual with that mechanism's part put back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .._typing import Index
from ..exceptions import NotEstimable
from ..fitting.batch import Ensemble
from ..fitting.design import Model
from ..fitting.identifiability import identify, solve
from ..fitting.least_squares import Fit, with_prior
from ..fitting.reduction import Reduction, reduce_problem
from ..fitting.splines import spline
from ..fitting.whitening import UNIT, Whitening
from ..mechanisms.geometry import SETUP
from ..mechanisms.terms import Mechanism
from ..selection.criteria import log_evidence
from ..selection.cross_validation import Folded, cross_validate, fold
from ..selection.evaluation import Split
from .bootstrap import Bootstrap, halves

HALVES = 100
LEVEL = 0.05
BUNDLES = 2000  # of configurations, of which halves are drawn; fewer configurations are one each


@dataclass(frozen=True)
class Significance:
    """One mechanism: displacement it causes over the measured configurations; nested F, its nominal
    p (no smaller than the posture bootstrap's) and the evidence for it given all others;
    cross-validated and held-out rms with and without it; what the catalogue says of sign and size;
    the share of half-samples in which it stays significant. The p and the share take the model's
    names as given: the search that found them is not repeated. None where undefined, as F and p of
    free functions, which are shrunk."""

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


def significance(
    split: Split, fitted: Fit, names: Sequence[str], boot: Bootstrap, rng: np.random.Generator
) -> tuple[Significance, ...]:
    """Of every mechanism of a fitted model, by what matters in mm. `names`: what the report calls
    the model's last mechanisms."""
    model = fitted.model
    called = dict(zip(model.mechanisms[-len(names) :], names, strict=True)) if names else {}
    judged = [
        m
        for m in model.mechanisms
        if m.name != SETUP and set(_terms(model, m)) & set(fitted.found.kept)
    ]
    without = _Without(split, fitted)
    moved = _displaced(split, fitted, [_terms(model, m) for m in judged])
    stable = stability(without.bundled(), fitted, [_own(model, m, fitted) for m in judged], rng)
    cv, held = without.rms([])
    out = []
    for m, (mean, worst), share in zip(judged, moved, stable, strict=True):
        own = _own(model, m, fitted)
        f, p, evidence = nested(fitted, own, boot, 1.0 if split.known_sigma else None)
        cv_without, held_without = without.rms(own) if own else (None, None)
        terms = _terms(model, m)
        symbols = tuple(model.terms[k].symbol for k in terms if k in fitted.found.kept)
        out.append(
            Significance(
                called.get(m, m.name),
                symbols,
                mean,
                worst,
                f,
                p,
                evidence,
                cv,
                cv_without,
                held,
                held_without,
                catalogue(fitted, terms),
                share,
            )
        )
    return tuple(sorted(out, key=lambda s: -s.mean_mm))


def _terms(model: Model, m: Mechanism) -> list[int]:
    """Indices of a mechanism's terms."""
    mine = {t.key for t in m.terms}
    return [k for k, t in enumerate(model.terms) if t.key in mine]


def _own(model: Model, m: Mechanism, fitted: Fit) -> list[int]:
    """Estimable terms that this mechanism alone brings."""
    others = {t.key for o in model.mechanisms if o != m for t in o.terms}
    return [
        k for k in _terms(model, m) if model.terms[k].key not in others and k in fitted.found.kept
    ]


def _displaced(
    split: Split, fitted: Fit, groups: Sequence[Sequence[int]]
) -> list[tuple[float, float]]:
    """(mean, worst) displacement [mm] of the target that each group of terms causes on the exact
    chain, over all measured configurations."""
    problem = split.problem.take(~split.outlying).unweighted()
    theta = np.tile(fitted.theta, (1 + len(groups), 1))
    for row, group in zip(theta[1:], groups, strict=True):
        row[list(group)] = 0.0
    total, worst = np.zeros(len(groups)), np.zeros(len(groups))
    for _, part in problem.parts():
        ensemble = Ensemble(part, fitted.terms)
        full = ensemble.residuals(theta[:1])[0, :3]
        for g, row in enumerate(theta[1:]):
            size = np.linalg.norm(ensemble.residuals(row[None])[0, :3] - full, axis=0)
            total[g], worst[g] = total[g] + size.sum(), max(worst[g], size.max())
    return [(float(t / len(problem)), float(w)) for t, w in zip(total, worst, strict=True)]


def nested(
    fitted: Fit, own: Sequence[int], boot: Bootstrap, known: float | None = None
) -> tuple[float | None, float | None, float | None]:
    """(F, its p, log10 of the Bayes factor with a unit-information prior) of the model against
    itself without some terms: RSS grows by θᵀ C⁻¹ θ, C their unscaled covariance. The p is no
    smaller than the bootstrap's, to which the rows of a posture are one. Shrunk terms have no F.
    `known`: the standard deviation of whitened rows, where it is known."""
    from scipy.special import fdtrc

    if not own or fitted.freedom <= 0 or any(spline(fitted.terms[k]) is not None for k in own):
        return None, None, None
    factor, theta, count = (
        fitted.factor[list(own)],
        fitted.theta[list(own)],
        determined(fitted, own),
    )
    if count < 0.5:  # the prior of usual sizes says all there is to say
        return None, None, None
    more = float(theta @ np.linalg.solve(factor @ factor.T, theta))
    f = more / count / fitted.sigma**2
    rank = fitted.rows - fitted.freedom
    evidence = log_evidence(
        fitted.rss, fitted.rss + more, fitted.rows, round(rank - count), round(count), known
    )
    p = float(fdtrc(count, fitted.freedom, f))
    p = max(p, boot.p_value(fitted, own))
    return f, p, float(evidence / np.log(10)) if fitted.precision is None else None


def determined(fitted: Fit, own: Sequence[int]) -> float:
    """How many parameters some fitted terms add to the others, those that a prior holds counted by
    what the data say of them: the trace of the hat matrix that goes with them."""
    rest = [k for k in fitted.found.kept if k not in own]
    full = with_prior(fitted.reduction, fitted.root, fitted.theta)
    spent = np.square(fitted.reduction.R[:-1, rest] @ solve(full, rest)[1]).sum() if rest else 0.0
    return float(fitted.rows - fitted.freedom - spent)


class _Without:
    """Cross-validated and held-out errors of the model without some terms, from triangles made
    once: no row is seen twice."""

    def __init__(self, split: Split, fitted: Fit):
        self.fitted, self.training = fitted, split.training()
        kept, folds = fitted.found.kept, split.training_folds()
        self.folded = fold(self.training, fitted.terms, folds, fitted.at(), kept)
        whitening = self.training.whitening
        self.plain = (
            Folded(self.folded.blocks / whitening.weight, self.folded.rows)
            if whitening.uniform
            else fold(self.training.unweighted(), fitted.terms, folds, fitted.at(), kept)
        )
        held = split.problem.take(~split.estimation & ~split.outlying)
        self.held = len(held)
        position = np.broadcast_to(np.diag([1.0, 1, 1, 0, 0, 0]), (len(held), 6, 6))
        whitening = UNIT if held.components == 3 else Whitening(matrices=position)
        self.held_R = (
            reduce_problem(replace(held, whitening=whitening), fitted.terms, fitted.at(), kept).R
            if self.held
            else None
        )

    def bundled(self) -> Folded:
        """A fold per configuration; of very many, per bundle of them, whose halves tell the
        same."""
        own = np.unique(self.training.data.block, return_inverse=True)[1].reshape(-1) % BUNDLES
        return fold(self.training, self.fitted.terms, own, self.fitted.at(), self.fitted.found.kept)

    def rms(self, out: Sequence[int]) -> tuple[float | None, float | None]:
        """(cross-validated, held-out) rms [mm] of the lengths of the residual vectors."""
        fitted, gone = self.fitted, list(out)
        kept = [k for k in fitted.found.kept if k not in gone]
        changed = self.folded.blocks.copy()
        changed[:, :, -1] += changed[:, :, gone] @ fitted.theta[gone]
        total = Reduction.empty(changed.shape[2] - 1).add(changed.reshape(-1, changed.shape[2]))
        prior = None if fitted.prior is None else fitted.prior.copy()
        if prior is not None:
            prior[:, -1] += prior[:, gone] @ fitted.theta[gone]
            prior = prior[np.abs(prior[:, kept]).any(1)] if kept else prior[:0]
            total = Reduction(total.add(prior).R, total.rows)
        kept = [kept[i] for i in identify(total.select(kept)).kept]
        try:
            cv = cross_validate(Folded(changed, self.folded.rows), kept, prior)
            per_fold = cv.without.copy()
            per_fold[:, gone] -= fitted.theta[gone]
            left = self.plain.blocks[:, :, -1] - np.einsum(
                "khp,kp->kh", self.plain.blocks[:, :, :-1], per_fold
            )
            crossed: float | None = float(np.sqrt(np.square(left).sum() / len(self.training)))
        except NotEstimable:
            crossed = None
        delta = np.zeros(len(fitted.theta))
        delta[kept] = solve(total, kept)[0]
        delta[gone] = -fitted.theta[gone]
        if self.held_R is None:
            return crossed, None
        left = self.held_R[:, -1] - self.held_R[:, :-1] @ delta
        return crossed, float(np.sqrt(np.square(left).sum() / self.held))


def stability(
    folded: Folded,
    fitted: Fit,
    groups: Sequence[Sequence[int]],
    rng: np.random.Generator,
    count: int = HALVES,
) -> list[float | None]:
    """Share of half-samples of the postures in which each group of terms stays significant (nested
    F, p below 0.05); None for shrunk terms. The names are taken as given: the search is not
    repeated in the halves."""
    from scipy.special import fdtrc

    kept = list(fitted.found.kept)
    where = {k: i for i, k in enumerate(kept)}
    plain = [all(spline(fitted.terms[k]) is None for k in g) for g in groups]
    inside: list[Index] = [
        np.array([where[k] for k in g if fine], dtype=np.intp)
        for g, fine in zip(groups, plain, strict=True)
    ]
    X = folded.blocks[:, :, kept]
    y = folded.blocks[:, :, -1] + X @ fitted.theta[kept]
    scale = np.hypot(np.linalg.norm(X, axis=(0, 1)), np.linalg.norm(fitted.root[:, kept], axis=0))
    root = fitted.root[:, kept] / scale
    hits, judged = np.zeros(len(groups)), 0
    sizes = [max(determined(fitted, g), 0.5) for g in groups]
    for half in halves(rng, count, len(X)):
        A, b = X[half].reshape(-1, len(kept)) / scale, y[half].ravel()
        gram = A.T @ A + root.T @ root
        rows = int(folded.rows[half].sum())
        try:
            C = np.linalg.inv(gram)
        except np.linalg.LinAlgError:
            continue
        beta = C @ (A.T @ b)
        freedom = rows - np.einsum("ij,ji->", C, A.T @ A)
        if freedom < 1 or np.abs(C @ gram - np.eye(len(kept))).max() > 1e-6:
            continue
        judged += 1
        variance = float(np.square(b - A @ beta).sum()) / freedom
        for g, i in enumerate(inside):
            if len(i):
                f = beta[i] @ np.linalg.solve(C[np.ix_(i, i)], beta[i]) / sizes[g] / variance
                hits[g] += fdtrc(sizes[g], freedom, f) < LEVEL
    return [
        float(h / judged) if judged and len(i) else None for h, i in zip(hits, inside, strict=True)
    ]


def catalogue(fitted: Fit, terms: Sequence[int]) -> str:
    """Whether signs and sizes are what the catalogue expects, else which are not; two standard
    errors are allowed."""
    off, error = [], fitted.standard_errors
    for k in terms:
        term, value = fitted.terms[k], float(fitted.theta[k])
        if term.sign and value * term.sign < -2 * error[k]:
            off.append(f"{term.symbol} has the other sign")
        if term.size is not None and abs(value) - 2 * error[k] > term.size[1]:
            off.append(f"{term.symbol} is larger than usual")
    return "; ".join(off) if off else "as expected"
