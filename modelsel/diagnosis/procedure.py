"""The whole diagnosis: outliers and names in turn, and the same repeated in folds.

`diagnose` is the entry for users of the package; `diagnose_split` is the same for a study's split,
and `run_nested_folds` repeats it without each fold, for a gain that no part of the procedure has
seen."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from .._random import generator
from .._typing import Array, Index, Mask, Say
from ..fitting.design import Model, whitened
from ..fitting.least_squares import fit
from ..fitting.problem import Problem
from ..mechanisms.registry import (
    BUILTIN,
    Registry,
    build_faults,
    build_mechanisms,
    every,
    mechanism,
)
from ..mechanisms.terms import Mechanism
from ..selection.evaluation import Errors, Split, summarise_errors
from ..selection.splits import assign_folds
from .candidates import Candidate, build_candidates
from .options import DEFAULT_OPTIONS, DiagnosisOptions
from .outcome import Diagnosis
from .outliers import (
    GROSS_THRESHOLD,
    MAX_OUTLIER_SHARE,
    REFINED_THRESHOLD,
    find_far_rows,
    find_gross_outliers,
)
from .stepwise import run_stepwise_search

# rounds of outliers and names in turn
MAX_ROUNDS = 3
# configurations that are scanned at least, of many rows
MIN_CONFIGURATIONS = 20
ALL = "all"


def diagnose(
    problem: Problem,
    *,
    base: Sequence[str] = ("geometric",),
    candidates: Sequence[str] | str = ALL,
    seed: int = 0,
    registry: Registry = BUILTIN,
    estimation: Mask | None = None,
    options: DiagnosisOptions = DEFAULT_OPTIONS,
) -> Diagnosis:
    """Name what is wrong with a model of a robot.

    `base`: registered names of the model to extend; `candidates`: registered names that may extend
    it, or "all" for every mechanism of the registry, data faults and unregistered causes;
    `estimation`: mask (m,) of the rows to use (None: all). The result prints its findings.

    Raises StudyError for an unknown name, NotEstimable where the data do not determine the base."""
    rows = len(problem)
    used = np.ones(rows, bool) if estimation is None else np.asarray(estimation, bool)
    folds = np.zeros(rows, np.intp)
    split = Split(problem, used, np.zeros(rows, bool), folds, known_sigma=False)
    model = Model(tuple(mechanism(name, problem.robot, registry) for name in base))
    is_open = candidates == ALL
    offered = _resolve_candidates(problem, candidates, registry)
    return diagnose_split(split, model, offered, seed, is_open, options=options)[1]


def _resolve_candidates(
    problem: Problem, candidates: Sequence[str] | str, registry: Registry
) -> tuple[Mechanism, ...]:
    robot = problem.robot
    if candidates == ALL:
        return (*build_faults(robot), *every(robot, registry))
    names = [candidates] if isinstance(candidates, str) else candidates
    return tuple(part for name in names for part in build_mechanisms(name, robot, registry))


def diagnose_split(
    split: Split,
    base: Model,
    everything: tuple[Mechanism, ...],
    seed: int,
    cells: bool,
    say: Say = lambda _: None,
    options: DiagnosisOptions = DEFAULT_OPTIONS,
) -> tuple[Split, Diagnosis, tuple[Candidate, ...]]:
    """Find outliers and name effects in turn, until the outliers stay the same (at most MAX_ROUNDS).

    `everything`: mechanisms that may extend the base; `cells`: whether unregistered causes may,
    too. Of more than `options.max_rows` estimation rows, configurations drawn by the seed are
    scanned; outliers are judged in all rows. Returns the split with its outliers marked, the
    diagnosis, and the candidates."""
    inquiry = _Inquiry(base, everything, seed, cells, say, options)
    if split.estimation.sum() <= options.max_rows:
        return _alternate(split, inquiry)
    sample = replace(split, estimation=_draw_configurations(split, seed, options.max_rows))
    sample, diagnosis, found = _alternate(sample, inquiry)
    outlying = _find_outliers_everywhere(split, sample, diagnosis)
    return replace(split, outlying=outlying), diagnosis, found


class _Inquiry(NamedTuple):
    """What is asked of the rows of a split."""

    base: Model
    everything: tuple[Mechanism, ...]
    seed: int
    cells: bool
    say: Say
    options: DiagnosisOptions

    def search(self, problem: Problem, found: tuple[Candidate, ...]) -> Diagnosis:
        """Search for effects in a training problem, with the study's random stream of naming."""
        rng = generator(self.seed, "naming")
        base_fit = fit(problem, self.base)
        return run_stepwise_search(problem, self.base, base_fit, found, rng, self.say)


def _alternate(split: Split, inquiry: _Inquiry) -> tuple[Split, Diagnosis, tuple[Candidate, ...]]:
    """Alternate outliers and names: where the extended model shows other outliers than the base
    did, effects are named once more without those."""
    training = split.problem.take(split.estimation)
    outlying = find_gross_outliers(training, inquiry.base)
    for _ in range(MAX_ROUNDS):
        split = replace(split, outlying=_expand_mask(split.estimation, outlying))
        kept = split.training()
        found = build_candidates(
            kept, inquiry.base, inquiry.everything, inquiry.cells, inquiry.options
        )
        inquiry.say(f"naming: {len(found)} candidates")
        diagnosis = inquiry.search(kept, found)
        again = _find_outliers(training, diagnosis, outlying)
        if outlying.any():
            again = _reconsider_outliers(training, inquiry, found, outlying, again)
        if (again == outlying).all() or again.mean() > MAX_OUTLIER_SHARE:
            break
        outlying = again
    return split, diagnosis, found


def _reconsider_outliers(
    training: Problem,
    inquiry: _Inquiry,
    found: tuple[Candidate, ...],
    outlying: Mask,
    again: Mask,
) -> Mask:
    """Reconsider outliers with all rows in the search: an effect of a few rows resembles outliers
    until it may be named. Returns the outliers of that search if they are at most half as many,
    else `again`."""
    with_all = inquiry.search(training, found)
    fewer = _find_outliers(training, with_all, np.zeros(len(training), bool))
    return fewer if fewer.sum() <= outlying.sum() / 2 else again


def _find_outliers(problem: Problem, diagnosis: Diagnosis, outlying: Mask) -> Mask:
    """Find rows far off the extended model, in robust standard deviations of the rows that are not
    `outlying`, to which it was fitted."""
    size = whitened(problem, diagnosis.fit.residuals(problem))
    measured = None if problem.measured is None else problem.measured[~outlying]
    return find_far_rows(size, size[~outlying], _choose_threshold(diagnosis), measured)


def _find_outliers_everywhere(split: Split, sample: Split, diagnosis: Diagnosis) -> Mask:
    """Find outliers among all estimation rows, in robust standard deviations of the sampled rows;
    those of the sample alone where they would be too many."""
    problem, used = split.problem, sample.used
    size = whitened(problem, diagnosis.fit.residuals(problem))
    measured = None if problem.measured is None else problem.measured[used]
    far = find_far_rows(size, size[used], _choose_threshold(diagnosis), measured)
    outlying = split.estimation & far
    is_plausible = outlying[split.estimation].mean() <= MAX_OUTLIER_SHARE
    return outlying if is_plausible else sample.outlying


def _choose_threshold(diagnosis: Diagnosis) -> float:
    return REFINED_THRESHOLD if diagnosis.effects else GROSS_THRESHOLD


def _draw_configurations(split: Split, seed: int, max_rows: int) -> Mask:
    """Draw about `max_rows` estimation rows (mask) by the seed, equal readings together."""
    block = split.problem.data.block
    drawn = generator(seed, "scan").permutation(np.unique(block[split.estimation]))
    share = max_rows / float(split.estimation.sum())
    count = max(MIN_CONFIGURATIONS, int(share * len(drawn)))
    return np.asarray(split.estimation & np.isin(block, drawn[:count]))


def _expand_mask(rows: Mask, marked: Mask) -> Mask:
    """Expand a mask of the selected rows to all rows (m,)."""
    mask = np.zeros(len(rows), bool)
    mask[np.flatnonzero(rows)[marked]] = True
    return mask


@dataclass(frozen=True)
class Nested:
    """The whole procedure repeated without each fold: errors of base and chosen model on rows that
    it has not seen, and how often each name was found."""

    folds: int
    base: Errors
    chosen: Errors
    named: dict[str, int]


class _Fold(NamedTuple):
    """One fold: its rows (mask), their residuals under base and chosen model, the names found."""

    rows: Mask
    base: Array
    chosen: Array
    names: list[str]


def _run_fold(
    k: int,
    split: Split,
    base: Model,
    everything: tuple[Mechanism, ...],
    seed: int,
    cells: bool,
    fold: Index,
) -> _Fold:
    outside = fold == k
    inside = replace(
        split, estimation=split.estimation & ~outside, outlying=np.zeros(len(fold), bool)
    )
    inside, diagnosis, _ = diagnose_split(inside, base, everything, seed, cells)
    problem = split.problem.take(outside)
    base_fit = fit(inside.training(), base)
    names = [effect.candidate.label for effect in diagnosis.effects]
    return _Fold(outside, base_fit.residuals(problem), diagnosis.fit.residuals(problem), names)


def run_nested_folds(
    split: Split, base: Model, everything: tuple[Mechanism, ...], seed: int, cells: bool, folds: int
) -> Nested:
    """Repeat outliers, naming and fit without each fold of the estimation configurations, in
    parallel; the result does not depend on the number of workers."""
    fold = np.full(len(split.estimation), -1, dtype=np.intp)
    estimation = split.problem.data.take(split.estimation)
    fold[split.estimation] = assign_folds(estimation, folds, generator(seed, "nested"))
    count = int(fold.max()) + 1
    run = partial(
        _run_fold, split=split, base=base, everything=everything, seed=seed, cells=cells, fold=fold
    )
    with ProcessPoolExecutor(max_workers=min(count, os.cpu_count() or 1)) as pool:
        done = list(pool.map(run, range(count)))
    before, after = (np.full((len(fold), split.problem.components), np.nan) for _ in range(2))
    for one in done:
        before[one.rows], after[one.rows] = one.base, one.chosen
    rows, outlying = split.estimation, split.outlying[split.estimation]
    base_errors, chosen_errors = (
        summarise_errors(before[rows], outlying),
        summarise_errors(after[rows], outlying),
    )
    return Nested(count, base_errors, chosen_errors, _count_names(done))


def _count_names(folds: Sequence[_Fold]) -> dict[str, int]:
    """Count in how many folds each name was found, the most frequent first."""
    counts: dict[str, int] = {}
    for one in folds:
        for name in dict.fromkeys(one.names):
            counts[name] = counts.get(name, 0) + 1
    return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))
