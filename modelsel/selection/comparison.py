"""Comparison of all subsets of the candidate mechanisms on a base, with the one-standard-error
choice, from reduced data.

Every model is one linear step from the base's fit (`linear_steps`). All subsets are walked where
there are at most `MAX_EXHAUSTIVE` mechanisms; of more, branch and bound finds the best by BIC, and
its neighbours are compared with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .._typing import Array, Mask
from ..exceptions import write_rounded
from ..fitting.design import Model
from ..fitting.least_squares import Fit
from ..fitting.linear_step import Step
from ..fitting.reduction import scatter_columns
from ..mechanisms.terms import Mechanism
from .branch_and_bound import DEFAULT_SEARCH, Certified, SearchOptions, find_best_subset
from .criteria import aicc, bic, log_evidence, normalise_weights, scan_price
from .cross_validation import FoldedData, fold
from .evaluation import Evaluation, Split
from .linear_steps import Steps, evaluate_steps, locate_terms, prepare_steps
from .subsets import Subsets, evaluate_subsets, sweep_subsets

# mechanisms that enter the comparison, unless the study asks for more
MAX_CANDIDATES = 12
# models of the comparison that are listed
MAX_LISTED = 12
# mechanisms of which all subsets are walked: 65,536 models, half a second
MAX_EXHAUSTIVE = 16
# digits of a sum of squares in which subsets must differ to be told apart
DIGITS = 10
# by how much equal models may differ in a criterion
SAME_CRITERION = 1e-6


@dataclass(frozen=True, eq=False)
class SubsetComparison:
    """Result of comparing subsets of the candidates.

    compared: number of subsets compared.
    best: evaluations of the listed subsets, by cross-validation.
    choice: names of the one-standard-error choice, the base's included.
    considered, set_aside: names of the mechanisms that were compared, and that were not.
    certified: certificate of branch and bound; None where all subsets were walked.
    """

    compared: int
    best: tuple[Evaluation, ...]
    choice: tuple[str, ...]
    considered: tuple[str, ...]
    set_aside: tuple[str, ...]
    certified: Certified | None = None


@dataclass(frozen=True, eq=False)
class _Space:
    """The space of models: mechanisms that add columns to the base, and the reduced data.

    `held` is the number of parameters that the base's prior of usual sizes holds; `sigma` the
    standard deviation of whitened rows where it is known."""

    split: Split
    base: Model
    mechanisms: tuple[Mechanism, ...]
    steps: Steps
    folded: FoldedData
    held: int
    base_columns: list[int]
    columns: list[list[int]]
    sigma: float | None

    @property
    def rows(self) -> int:
        """Number of measured coordinates that fit."""
        by_fold = self.folded.rows
        count = by_fold.sum()
        return int(count)

    def select(self, members: Mask) -> tuple[Mechanism, ...]:
        """Return the mechanisms of a subset (G,)."""
        chosen = []
        for g in np.flatnonzero(members):
            mechanism = self.mechanisms[g]
            chosen.append(mechanism)
        return tuple(chosen)


@dataclass(frozen=True, eq=False)
class _Scores:
    """Scores of S subsets: cross-validated sums of squares `total` (S,), their standard deviation
    (S,) from the best's, posterior weights (S,); `listed` (S,) says which subsets are models of
    their own; `best` is the lowest total, `pick` the one-standard-error choice."""

    total: Array
    deviation: Array
    weight: Array
    listed: Mask
    best: int
    pick: int
    lowest_bic: int
    lowest_aicc: int


def compare_subsets(
    split: Split,
    base_fit: Fit,
    candidates: Sequence[Mechanism],
    base_names: Sequence[str],
    set_aside: Sequence[str] = (),
    scanned: int = 0,
    options: SearchOptions = DEFAULT_SEARCH,
) -> SubsetComparison:
    """Compare all subsets of the candidates (see `diagnosis.candidates.candidate_list.choose_strongest`) on a base, linear about the base's fit.

    Of more than MAX_EXHAUSTIVE candidates the best by BIC, certified or not, and its neighbours
    are compared. Every criterion is that of the ladder's models, of a known σ where the study
    states it. `scanned`: of how many groups the candidates are the strongest; EBIC counts these.
    `options` bound the effort of branch and bound."""
    space = _prepare(split, base_fit, candidates)
    subsets, certified = _search(space, options)
    scores = _score(space, subsets)
    rows = _rank(subsets, scores, certified)
    evaluations = _refit(space, subsets, rows, base_names)
    chosen = subsets.members.sum(1)
    choices = max(scanned, len(space.mechanisms))
    price = scan_price(chosen, choices)
    best = _annotate(space, subsets, scores, price, evaluations, certified)
    picked = subsets.members[scores.pick]
    choice = [m.name for m in space.select(picked)]
    searched = [m.name for m in space.mechanisms]
    return SubsetComparison(
        len(subsets.rss),
        tuple(best),
        (*base_names, *choice),
        tuple(searched),
        tuple(set_aside),
        certified,
    )


def _prepare(split: Split, base_fit: Fit, candidates: Sequence[Mechanism]) -> _Space:
    """Reduce the data at the base's fit and group the columns that the candidates add."""
    base = base_fit.model
    everything = base + tuple(candidates)
    terms = everything.terms
    first = len(base.terms)
    kept = list(base_fit.found.kept)
    new = range(first, len(terms))
    used = sorted({*kept, *new})
    training = split.training
    folds_of = split.training_folds
    folded = fold(training, terms, folds_of, base_fit.at(), used)
    steps = prepare_steps(split, everything, base_fit, folded)
    step = steps.to(everything) or steps.to(base)
    folded, held = _add_prior(folded, everything, step)
    place = {t.key: k for k, t in enumerate(terms)}
    mechanisms = []
    added = []
    for candidate in candidates:
        # a column that two mechanisms share enters with each: the sweep finds the second copy
        # dependent and skips it
        positions = dict.fromkeys(place[t.key] for t in candidate.terms)
        columns = [k for k in positions if k >= first]
        if columns:
            mechanisms.append(candidate)
            added.append(columns)
    return _Space(
        split,
        base,
        tuple(mechanisms),
        steps,
        folded,
        held,
        kept,
        added,
        1.0 if split.known_sigma else None,
    )


def _add_prior(folded: FoldedData, everything: Model, step: Step | None) -> tuple[FoldedData, int]:
    """Add a step's prior of usual sizes to the folds, and count the parameters it holds.

    The step is that of the model of most parameters, whose noise is least and prior weakest."""
    if step is None:
        return folded, 0
    count = len(everything.terms)
    places = locate_terms(everything, step.model)
    columns = [*places, count]
    width = count + 1
    prior = scatter_columns(step.prior, columns, width)
    with_prior = replace(folded, prior=prior)
    return with_prior, step.weak.held


def _search(space: _Space, options: SearchOptions) -> tuple[Subsets, Certified | None]:
    """Search all subsets of up to MAX_EXHAUSTIVE groups.

    Of more groups: the base alone, the best by BIC, each group alone, and the best's neighbours by
    one group, with the best's certificate."""
    folded = space.folded
    base = space.base_columns
    groups = space.columns
    count = len(groups)
    certified = None
    if count <= MAX_EXHAUSTIVE:
        subsets = sweep_subsets(folded, base, groups)
    else:
        certified = find_best_subset(folded.total, base, groups, options, sigma=space.sigma)
        best = certified.members
        single = np.eye(count, dtype=bool)
        none = np.zeros(count, bool)
        neighbours = best ^ single
        every = np.concatenate([[none, best], single, neighbours])
        distinct = dict.fromkeys(map(tuple, every.tolist()))
        members = np.array(list(distinct), dtype=bool)
        subsets = evaluate_subsets(folded, base, groups, members)
    rank = subsets.rank - space.held
    subsets = replace(subsets, rank=rank)
    return subsets, certified


def _score(space: _Space, subsets: Subsets) -> _Scores:
    """Score subsets by cross-validation and criteria; pick the one-standard-error choice.

    The choice is the best by cross-validation of the subsets of least rank that are within one
    standard error of the lowest total (Breiman et al. 1984)."""
    rss = _even_out(subsets.rss)
    rank = subsets.rank
    held_out = subsets.held_out
    total = _even_out(held_out.sum(1))
    listed = _find_distinct(space, subsets)
    candidates = np.where(listed, total, np.inf)
    best = int(np.argmin(candidates))
    excess = held_out - held_out[best]
    folds = excess.shape[1]
    deviation = np.sqrt(folds * excess.var(1, ddof=1))
    within = total - total[best] <= deviation
    within = within & listed
    least = rank[within].min()
    smallest = np.flatnonzero(within & (rank == least))
    place = np.argmin(total[smallest])
    lowest = {}
    for criterion in (bic, aicc):
        value = criterion(rss, space.rows, rank, space.sigma)
        value = np.where(listed, value, np.inf)
        lowest[criterion] = int(np.argmin(value))
    weight = _weigh(space, subsets, listed)
    return _Scores(
        total, deviation, weight, listed, best, int(smallest[place]), lowest[bic], lowest[aicc]
    )


def _even_out(values: Array) -> Array:
    """Make values (S,) equal that rounding alone tells apart: of twins the earlier comes first."""
    finite = np.isfinite(values) & (values > 0)
    size = np.floor(np.log10(values[finite]))
    unit = np.power(10.0, size - DIGITS)
    out = values.copy()
    out[finite] = np.round(values[finite] / unit) * unit
    return out


def _find_distinct(space: _Space, subsets: Subsets) -> Mask:
    """Mask (S,) of subsets that are models of their own: not saturated, and no group's columns
    depend on those of the others, for then the subset repeats another."""
    gained = subsets.rank - (len(space.base_columns) - space.held)
    count = subsets.members.sum(1)
    alone = np.zeros(len(space.columns), dtype=np.intp)
    for g in range(len(alone)):
        alone[g] = gained[(count == 1) & subsets.members[:, g]][0]
    saturated = space.rows - subsets.rank < 2
    return np.asarray(~saturated & (gained == subsets.members @ alone))


def _weigh(space: _Space, subsets: Subsets, listed: Mask) -> Array:
    """Compute the posterior weights (S,) of the listed subsets."""
    rank = int(subsets.rank[0])
    evidence = log_evidence(
        subsets.rss, float(subsets.rss[0]), space.rows, rank, subsets.rank - rank, space.sigma
    )
    score = -2 * (evidence + _log_prior(subsets.members))
    return normalise_weights(np.where(listed, score, np.inf))


def _log_prior(members: Mask) -> Array:
    """Compute the log (S,) of the Beta-binomial(1, 1) model prior: 1 / [(G+1) C(G, s)] (Scott &
    Berger 2010)."""
    from scipy.special import gammaln

    G, s = members.shape[1], members.sum(1)
    return np.asarray(gammaln(s + 1) + gammaln(G - s + 1) - gammaln(G + 2))


def _rank(subsets: Subsets, scores: _Scores, certified: Certified | None) -> list[int]:
    """Choose the subsets to list, by cross-validation: the choice, the best of each criterion, and
    the lowest totals."""
    order = np.argsort(np.where(scores.listed, scores.total, np.inf), kind="stable")
    lowest = order[: min(MAX_LISTED, int(scores.listed.sum()))].tolist()
    named = [scores.pick, scores.lowest_bic, scores.lowest_aicc]
    if certified is not None:
        named += np.flatnonzero((subsets.members == certified.members).all(1)).tolist()
    rows = list(dict.fromkeys([*named, *lowest]))[:MAX_LISTED]
    return sorted(rows, key=lambda s: float(scores.total[s]))


def _refit(
    space: _Space, subsets: Subsets, rows: Sequence[int], base_names: Sequence[str]
) -> list[tuple[int, Evaluation]]:
    """Refit the listed subsets by one linear step each; those the data determine, evaluated."""
    names = []
    steps = []
    for s in rows:
        members = subsets.members[s]
        mechanisms = space.select(members)
        added = [m.name for m in mechanisms]
        step = space.steps.to(space.base + mechanisms)
        own = (*base_names, *added)
        names.append(own)
        steps.append(step)
    evaluations = evaluate_steps(space.split, space.steps, names, steps)
    refitted = []
    for s, one in zip(rows, evaluations, strict=True):
        if one is not None:
            refitted.append((s, one))
    return refitted


def _annotate(
    space: _Space,
    subsets: Subsets,
    scores: _Scores,
    price: Array,
    evaluations: Sequence[tuple[int, Evaluation]],
    certified: Certified | None,
) -> list[Evaluation]:
    """Add EBIC, posterior weight (where all subsets were walked) and notes to every evaluation."""
    lowest_bic = _find_lowest([(one.bic, s) for s, one in evaluations], scores.best)
    lowest_aicc = _find_lowest([(one.aicc, s) for s, one in evaluations], scores.best)
    annotated = []
    for s, one in evaluations:
        best = s == scores.best
        excess = scores.total[s] - scores.total[scores.best]
        proof = certified is not None and bool((subsets.members[s] == certified.members).all())
        undefined = space.sigma is None and space.rows - subsets.rank[s] < 3
        remarks = {
            "one-standard-error choice": s == scores.pick,
            "lowest weighted CV": best,
            "not distinguishable from the lowest weighted CV": (
                not best and excess < 2 * scores.deviation[s]
            ),
            "lowest BIC and AICc: criteria disagree": s == lowest_bic == lowest_aicc and not best,
            "lowest BIC: criteria disagree": s == lowest_bic != lowest_aicc and not best,
            "lowest AICc: criteria disagree": s == lowest_aicc != lowest_bic and not best,
            "saturated: AICc undefined": undefined,
            _describe_proof(certified): proof,
        }
        notes = [text for text, holds in remarks.items() if holds]
        if one.note:
            notes.append(one.note)
        annotated.append(
            replace(
                one,
                ebic=None if one.bic is None else one.bic + float(price[s]),
                weight=float(scores.weight[s]) if certified is None else None,
                note="; ".join(notes),
            )
        )
    return annotated


def _find_lowest(values: Sequence[tuple[float | None, int]], preferred: int) -> int:
    """Find the subset of the lowest value, of equal ones the preferred, None counted as infinite; −1
    where there is no subset."""
    finite = {s: np.inf if value is None else value for value, s in values}
    lowest = min(finite, key=finite.__getitem__, default=-1)
    is_equal = preferred in finite and finite[preferred] <= finite[lowest] + SAME_CRITERION
    return preferred if is_equal else lowest


def _describe_proof(certified: Certified | None) -> str:
    """Describe what is known of the best subset by BIC."""
    if certified is None or certified.proven:
        return "lowest BIC of all subsets, proven"
    return f"lowest BIC found; another may have up to {write_rounded(certified.gap)} less"
