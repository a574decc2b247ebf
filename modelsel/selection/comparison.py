"""The table of all subsets of the candidates on a base, with the one-standard-error choice,
measured on reduced data.

Every row is one linear step from the base's fit. A block of rows evaluates its causes once for all
models, in three passes; what is solved is solved on triangles. Any number of configurations costs
memory for a length a row and model, for nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .._typing import Array, Index
from ..exceptions import NotEstimable
from ..fitting.design import Model
from ..fitting.least_squares import Fit
from ..fitting.linear_step import Step, one_step
from ..fitting.linearisation import Linearisation
from ..fitting.reduction import Reduction, scatter_columns
from ..mechanisms.terms import Mechanism
from .branch_and_bound import Certified, best_subset
from .criteria import aicc, bic, log_evidence, scan_price, weights
from .cross_validation import (
    CrossValidation,
    Folded,
    cross_validate,
    fold,
    folds,
    held_out_residuals,
)
from .evaluation import Evaluation, Split, described, errors_of
from .subsets import Subsets, all_subsets, some_subsets

MOST = 12  # mechanisms in the table of all subsets, unless the study asks for more
SHOWN = 12  # rows of it that are listed
WALKED = 16  # mechanisms whose subsets are all walked: 65,536 models, half a second


@dataclass(frozen=True, eq=False)
class Comparison:
    """The table of subsets: how many were compared, the best by cross-validation, the
    one-standard-error choice."""

    compared: int
    best: tuple[Evaluation, ...]
    choice: tuple[str, ...]
    considered: tuple[str, ...]
    set_aside: tuple[str, ...]
    certified: Certified | None = None  # of more mechanisms than all subsets of which can be walked


def compare(
    split: Split,
    base: Model,
    base_fit: Fit,
    candidates: Sequence[Mechanism],
    base_names: Sequence[str],
    set_aside: Sequence[str] = (),
    scanned: int = 0,
) -> Comparison:
    """All subsets of the candidates (see `strongest`) on the base, linear about the base's fit; of
    more than WALKED the best by BIC, certified or not, and what stands round it. Every criterion is
    that of the rungs, of a known σ where the study states it. `scanned`: of how many groups the
    candidates are the strongest; EBIC counts these."""
    sigma = 1.0 if split.known_sigma else None
    training, folds_of = split.training(), split.training_folds()
    everything = base + tuple(candidates)
    terms = everything.terms
    used = sorted({*base_fit.found.kept, *range(len(base.terms), len(terms))})
    folded = fold(training, terms, folds_of, base_fit.at(), used)
    steps = steps_from(split, everything, base_fit, folded)
    folded, held = _with_prior(folded, everything, steps.to(everything) or steps.to(base))
    place = {t.key: k for k, t in enumerate(terms)}
    kept_base = list(base_fit.found.kept)
    groups = [
        [place[t.key] for t in c.terms if place[t.key] >= len(base.terms)] for c in candidates
    ]
    chosen = [g for g, columns in enumerate(groups) if columns]
    subsets, certified = _searched(folded, kept_base, _disjoint([groups[g] for g in chosen]), sigma)
    subsets = replace(subsets, rank=subsets.rank - held)
    total, n = subsets.held_out.sum(1), int(folded.rows.sum())
    saturated = n - subsets.rank < 2
    alone = (
        np.array(
            [
                subsets.rank[(subsets.members.sum(1) == 1) & subsets.members[:, g]][0]
                for g in range(len(chosen))
            ],
            dtype=np.intp,
        )
        - len(kept_base)
        + held
    )
    listed = ~saturated & (
        subsets.rank - len(kept_base) + held == subsets.members @ alone
    )  # dependent: it repeats another
    best = int(np.argmin(np.where(listed, total, np.inf)))
    deviation = np.sqrt(
        subsets.held_out.shape[1] * (subsets.held_out - subsets.held_out[best]).var(1, ddof=1)
    )
    within = (total - total[best] <= deviation) & listed
    least = np.flatnonzero(within & (subsets.rank == subsets.rank[within].min()))
    pick = int(least[np.argmin(total[least])])
    evidence = log_evidence(
        subsets.rss,
        float(subsets.rss[0]),
        n,
        int(subsets.rank[0]),
        subsets.rank - subsets.rank[0],
        sigma,
    )
    weight = weights(np.where(listed, -2 * (evidence + _multiplicity(subsets.members)), np.inf))
    by_bic, by_aicc = (
        int(np.argmin(np.where(listed, c(subsets.rss, n, subsets.rank, sigma), np.inf)))
        for c in (bic, aicc)
    )
    ranking = np.argsort(np.where(listed, total, np.inf), kind="stable")[
        : min(SHOWN, int(listed.sum()))
    ]
    searched = (
        []
        if certified is None
        else np.flatnonzero((subsets.members == certified.members).all(1)).tolist()
    )
    rows = list(dict.fromkeys([pick, by_bic, by_aicc, *searched, *ranking.tolist()]))[:SHOWN]
    rows.sort(key=lambda s: float(total[s]))
    some = [tuple(candidates[chosen[g]] for g in np.flatnonzero(subsets.members[s])) for s in rows]
    rungs = measured(
        split,
        [(*base_names, *(m.name for m in each)) for each in some],
        [steps.to(base + each) for each in some],
    )
    out, there = [], [(s, one) for s, one in zip(rows, rungs, strict=True) if one is not None]
    least_bic = min(
        ((np.inf if one.bic is None else one.bic, s) for s, one in there), default=(np.inf, -1)
    )[1]
    least_aicc = min(
        ((np.inf if one.aicc is None else one.aicc, s) for s, one in there), default=(np.inf, -1)
    )[1]
    for s, one in there:
        notes = [
            text
            for text, true in (
                ("one-standard-error choice", s == pick),
                ("lowest CV", s == best),
                (
                    "not distinguishable from the lowest CV",
                    s != best and total[s] - total[best] < 2 * deviation[s],
                ),
                ("lowest BIC: criteria disagree", s == least_bic and s != best),
                ("lowest AICc: criteria disagree", s == least_aicc and s != best),
                ("saturated: AICc undefined", sigma is None and n - subsets.rank[s] < 3),
                (_proof(certified), s in searched),
            )
            if true
        ]
        price = float(scan_price(int(subsets.members[s].sum()), max(scanned, len(chosen))))
        extended = None if one.bic is None else one.bic + price
        out.append(
            replace(
                one,
                ebic=extended,
                weight=float(weight[s]) if certified is None else None,
                note="; ".join([*notes, *([one.note] if one.note else [])]),
            )
        )
    choice = tuple(candidates[chosen[g]].name for g in np.flatnonzero(subsets.members[pick]))
    considered = tuple(candidates[g].name for g in chosen)
    return Comparison(
        len(subsets.rss),
        tuple(out),
        (*base_names, *choice),
        considered,
        tuple(set_aside),
        certified,
    )


def _with_prior(folded: Folded, everything: Model, step: Step | None) -> tuple[Folded, int]:
    """(the folds with a step's prior of usual sizes, how many parameters it holds): the prior of
    the model of most parameters, whose noise is least and prior weakest."""
    if step is None:
        return folded, 0
    columns = [*columns_of(everything, step.model), len(everything.terms)]
    return replace(
        folded, prior=scatter_columns(step.prior, columns, len(everything.terms) + 1)
    ), step.weak.held


def _searched(
    folded: Folded, base: Sequence[int], groups: Sequence[Sequence[int]], sigma: float | None
) -> tuple[Subsets, Certified | None]:
    """All subsets of up to WALKED groups; of more, none, the best by BIC, each group alone, and the
    best's neighbours by a group, with the best's certificate."""
    if len(groups) <= WALKED:
        return all_subsets(folded, base, groups), None
    found = best_subset(folded.total, base, groups, sigma=sigma)
    single = np.eye(len(groups), dtype=bool)
    every = np.concatenate([[single[0] & False, found.members], single, found.members ^ single])
    members = np.array(list(dict.fromkeys(map(tuple, every.tolist()))), dtype=bool)
    return some_subsets(folded, base, groups, members), found


def _proof(certified: Certified | None) -> str:
    """What is known of the best."""
    if certified is None or certified.proven:
        return "lowest BIC of all subsets, proven"
    return f"lowest BIC found; another may have up to {certified.gap:.3g} less"


def _disjoint(groups: list[list[int]]) -> list[list[int]]:
    """A column that two mechanisms share enters with each: the sweep finds the second copy
    dependent and skips it."""
    return [list(dict.fromkeys(columns)) for columns in groups]


def _multiplicity(members: NDArray[np.bool_]) -> Array:
    """ln of the Beta-binomial(1, 1) model prior: 1 / [(G+1) C(G, s)] (Scott & Berger 2010)."""
    from scipy.special import gammaln

    G, s = members.shape[1], members.sum(1)
    return np.asarray(gammaln(s + 1) + gammaln(G - s + 1) - gammaln(G + 2))


def columns_of(terms: Model, model: Model) -> list[int]:
    """Where a model's terms stand among those of a larger one."""
    place = {t.key: k for k, t in enumerate(terms.terms)}
    return [place[t.key] for t in model.terms]


def measured(
    split: Split, models: Sequence[tuple[str, ...]], steps: Sequence[Step | None]
) -> list[Evaluation | None]:
    """A rung (without its residuals) of every step, in the given names; None for a step that cannot
    be made."""
    training, folds_of = split.training(), split.training_folds()
    some = [step for step in steps if step is not None]
    folded = folds(
        training,
        [(s.model.terms, Linearisation(s.model.terms, s.theta), s.found.kept) for s in some],
        folds_of,
    )
    fits = [step.fit(block.total) for step, block in zip(some, folded, strict=True)]
    crossed = [_crossed(block, fitted) for block, fitted in zip(folded, fits, strict=True)]
    sizes, left = _lengths(split, fits, crossed, folds_of)
    out = iter(zip(fits, crossed, sizes, left, strict=True))
    return [
        None if step is None else _rung(split, names, *next(out))
        for names, step in zip(models, steps, strict=True)
    ]


@dataclass(frozen=True, eq=False)
class Steps:
    """Makes linear steps from a base's fit for any model of the terms of a larger one, on reduced
    data: `here` is the triangle of the `whole` model's terms at the fit."""

    whole: Model
    base_fit: Fit
    here: Reduction
    weight: float

    def to(self, model: Model) -> Step | None:
        """None where the data do not determine the model."""
        index = columns_of(self.whole, model)
        try:
            return one_step(model, self.base_fit, self.here.select(index), self.weight)
        except NotEstimable:
            return None


def steps_from(split: Split, whole: Model, base_fit: Fit, folded: Folded) -> Steps:
    """From a base's fit; `folded`: the whole model's terms there."""
    return Steps(whole, base_fit, folded.total, split.training().whitening.typical_weight())


def _crossed(folded: Folded, fitted: Fit) -> CrossValidation | None:
    try:
        return cross_validate(folded, fitted.found.kept, fitted.prior)
    except NotEstimable:
        return None


def _lengths(
    split: Split, fits: Sequence[Fit], crossed: Sequence[CrossValidation | None], folds_of: Index
) -> tuple[Array, Array]:
    """Lengths [mm] of every model's residuals (models, m), and of those that fits without the row's
    fold leave (models, rows that fit)."""
    sizes, left = (
        np.empty((len(fits), len(split.problem))),
        np.full((len(fits), int(split.used.sum())), np.nan),
    )
    place = np.cumsum(split.used) - 1
    for rows, part in split.problem.parts():
        used = split.used[rows]
        seen, at = part.take(used), place[rows][used]
        for fitted, cv, size, mine in zip(fits, crossed, sizes, left, strict=True):
            size[rows] = np.linalg.norm(fitted.residuals(part)[:, :3], axis=1)
            if cv is not None and len(at):
                mine[at] = np.linalg.norm(
                    held_out_residuals(seen, fitted.terms, folds_of[at], cv.without, fitted.at()),
                    axis=1,
                )
    return sizes, left


def _rung(
    split: Split,
    names: tuple[str, ...],
    fitted: Fit,
    cv: CrossValidation | None,
    size: Array,
    left: Array,
) -> Evaluation:
    ours, held = split.estimation, ~split.estimation
    both = errors_of(size[ours], split.outlying[ours]), errors_of(size[held], split.outlying[held])
    return described(split, names, fitted, both, cv, left, np.zeros((0, split.problem.components)))
