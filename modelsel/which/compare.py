"""Candidate models side by side: rungs of a ladder, and the table of all subsets with the one-standard-error choice."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..data.measurements import Index
from ..fitting.fit import Fit, fit
from ..fitting.shrink import fit_shrunk
from ..matrix.design import Model
from ..matrix.scene import Scene
from ..words.errors import NotEstimable
from ..words.rigid import Array
from ..wrong.screws import Mechanism
from .candidates import Candidate
from .criteria import aic, aicc, bic, ebic, gcv, log_evidence, weights
from .folds import cross_validate, fold, held_out_residuals
from .search import all_subsets
from .validate import Errors, errors

MOST = 12      # mechanisms in the table of all subsets
SHOWN = 12     # rows of it that are listed


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
    fit: Fit | None = field(repr=False)
    residual: Array = field(repr=False)             # (m, c) of every row
    weight: float | None = None
    note: str = ""
    aic: float | None = None
    gcv: float | None = None
    ebic: float | None = None
    log_density: float | None = None                # closed-form, of every fold given the others (methods.md A.4)
    crossed: Array | None = field(default=None, repr=False)     # (k,) lengths [mm] of the used rows, cross-validated


def rung(data: Data, model: Model, names: Sequence[str], fitted: Fit | None = None, linear: Fit | None = None,
         start: Fit | None = None) -> Rung:
    """Fit a model on the estimation rows, exactly (from the `start` of a similar one), and measure it everywhere; or take
    its fit, or one linear step from that of a smaller model."""
    training, folds_of = data.training(), data.training_folds()
    if linear is not None:
        known = dict(zip((t.screws for t in linear.terms), linear.theta, strict=True))
        fitted = fit(training, model, start=np.array([known.get(t.screws, 0.0) for t in model.terms]), iterations=1)
    elif fitted is None:
        fitted = fit_shrunk(training, model, start)
    residual = fitted.residuals(data.scene)
    held, n = ~data.estimation, fitted.rows
    left, note, density = np.linalg.norm(residual[data.used][:, :3], axis=1), "", None
    if fitted.theta.size:
        prior = fitted.prior
        try:
            cv = cross_validate(fold(training, model.terms, folds_of, fitted.at()), fitted.found.kept, prior)
            density = _finite(float(cv.density.sum())) if prior is None else None
            left = np.linalg.norm(held_out_residuals(training, model.terms, folds_of, cv.without, fitted.at()), axis=1)
        except NotEstimable:
            left, note = np.full(1, np.nan), "not estimable without one of the folds"
    mean, rms = float(left.mean()), float(np.sqrt(np.square(left).mean()))
    sigma, rank = 1.0 if data.known_sigma else None, n - fitted.freedom
    return Rung(tuple(names), len(fitted.theta), fitted.rank, errors(residual[data.estimation], data.outlying[data.estimation]),
                errors(residual[held], data.outlying[held]), rms, mean, _finite(float(aicc(fitted.rss, n, rank, sigma))),
                float(bic(fitted.rss, n, rank, sigma)), fitted, residual, note=note,
                aic=_finite(float(aic(fitted.rss, n, rank, sigma))), gcv=_finite(float(gcv(fitted.rss, n, rank))),
                log_density=density, crossed=left if len(left) == data.used.sum() else None)


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


@dataclass(frozen=True, eq=False)
class Comparison:
    """The table of subsets: how many were compared, the best by cross-validation, the one-standard-error choice."""

    compared: int
    best: tuple[Rung, ...]
    choice: tuple[str, ...]
    considered: tuple[str, ...]
    set_aside: tuple[str, ...]


def strongest(found: Sequence[Candidate], single_f: Array, named: Sequence[Candidate] = ()
              ) -> tuple[tuple[Mechanism, ...], tuple[str, ...]]:
    """(at most twelve registered mechanisms: the `named`, then those of largest single F, in the registry's order; names of
    the others). Of a scanned mechanism the best constant, or the named one, stands for it."""
    best: dict[str, tuple[float, int]] = {}
    for g, candidate in enumerate(found):
        f = np.inf if any(candidate is n for n in named) else float(single_f[g])
        if candidate.registered and f > best.get(candidate.mechanism.name, (0.0, -1))[0]:
            best[candidate.mechanism.name] = (f, g)
    ranked = [g for _, g in sorted(best.values(), key=lambda pair: -pair[0])]
    screws = {g: {t.screws for t in found[g].mechanism.terms} for g in ranked}
    first = {g for f, g in best.values() if f == np.inf}
    parts = {g for g in ranked if g not in first and any(screws[g] < screws[h] for h in first)}
    unions = {g for g in ranked if g not in first
              and screws[g] == set().union(*(screws[h] for h in ranked if screws[h] < screws[g]))}
    single = [g for g in ranked if g not in unions | parts]  # gravity-twist is joint2-twist and joint3-twist, no third thing
    aside = tuple(found[g].mechanism.name for g in ranked if g not in single[:MOST])
    return tuple(found[g].mechanism for g in sorted(single[:MOST])), aside


def compare(data: Data, base: Model, base_fit: Fit, candidates: Sequence[Mechanism], base_names: Sequence[str],
            set_aside: Sequence[str] = ()) -> Comparison:
    """All subsets of the candidates (at most twelve, see `strongest`) on the base, linear about the base's fit."""
    training, folds_of = data.training(), data.training_folds()
    everything = base + tuple(candidates)
    terms = everything.terms
    folded = fold(training, terms, folds_of, base_fit.at())
    place = {t.screws: k for k, t in enumerate(terms)}
    kept_base = list(base_fit.found.kept)
    groups = [[place[t.screws] for t in c.terms if place[t.screws] >= len(base.terms)] for c in candidates]
    chosen = [g for g, columns in enumerate(groups) if columns]
    subsets = all_subsets(folded, kept_base, _disjoint([groups[g] for g in chosen]))
    total, n = subsets.held_out.sum(1), int(folded.rows.sum())
    saturated = n - subsets.rank < 2
    alone = np.array([subsets.rank[(subsets.members.sum(1) == 1) & subsets.members[:, g]][0] for g in range(len(chosen))],
                     dtype=np.intp) - len(kept_base)
    listed = ~saturated & (subsets.rank - len(kept_base) == subsets.members @ alone)   # dependent columns: it repeats another
    best = int(np.argmin(np.where(listed, total, np.inf)))
    spread = np.sqrt(subsets.held_out.shape[1] * (subsets.held_out - subsets.held_out[best]).var(1, ddof=1))
    within = (total - total[best] <= spread) & listed
    least = np.flatnonzero(within & (subsets.rank == subsets.rank[within].min()))
    pick = int(least[np.argmin(total[least])])
    evidence = log_evidence(subsets.rss, float(subsets.rss[0]), n, int(subsets.rank[0]), subsets.rank - subsets.rank[0])
    weight = weights(np.where(listed, -2 * (evidence + _multiplicity(subsets.members)), np.inf))
    by_bic, by_aicc = (int(np.argmin(np.where(listed, c(subsets.rss, n, subsets.rank), np.inf))) for c in (bic, aicc))
    ranking = np.argsort(np.where(listed, total, np.inf), kind="stable")[:min(SHOWN, int(listed.sum()))]
    rows = list(dict.fromkeys([pick, by_bic, by_aicc, *ranking.tolist()]))[:SHOWN]
    rows.sort(key=lambda s: float(total[s]))
    out = []
    for s in rows:
        some = [candidates[chosen[g]] for g in np.flatnonzero(subsets.members[s])]
        notes = [text for text, true in (
            ("one-standard-error choice", s == pick), ("lowest CV", s == best),
            ("not distinguishable from the lowest CV", s != best and total[s] - total[best] < 2 * spread[s]),
            ("lowest BIC: criteria disagree", s == by_bic != best), ("lowest AICc: criteria disagree", s == by_aicc != best),
            ("saturated: AICc undefined", n - subsets.rank[s] < 3)) if true]
        try:
            one = rung(data, base + tuple(some), (*base_names, *(m.name for m in some)), linear=base_fit)
        except NotEstimable:
            continue
        extended = float(ebic(subsets.rss[s], n, subsets.rank[s], len(some), len(chosen)))
        out.append(replace(one, ebic=_finite(extended), weight=float(weight[s]),
                           note="; ".join([*notes, *([one.note] if one.note else [])])))
    choice = tuple(candidates[chosen[g]].name for g in np.flatnonzero(subsets.members[pick]))
    considered = tuple(candidates[g].name for g in chosen)
    return Comparison(len(subsets.rss), tuple(out), (*base_names, *choice), considered, tuple(set_aside))


def _disjoint(groups: list[list[int]]) -> list[list[int]]:
    """A column that two mechanisms share enters with each: the sweep finds the second copy dependent and skips it."""
    return [list(dict.fromkeys(columns)) for columns in groups]


def _multiplicity(members: NDArray[np.bool_]) -> Array:
    """ln of the Beta-binomial(1, 1) model prior: 1 / [(G+1) C(G, s)] (Scott & Berger 2010)."""
    from scipy.special import gammaln
    G, s = members.shape[1], members.sum(1)
    return np.asarray(gammaln(s + 1) + gammaln(G - s + 1) - gammaln(G + 2))
