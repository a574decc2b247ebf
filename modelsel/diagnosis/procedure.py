"""What is wrong with a base model, from its training rows alone: outliers, then names, then again
where those differ; and the same in every fold, for a gain that no part of the procedure has
seen."""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from .._random import generator
from .._typing import Index, Say
from ..fitting.design import Model, whitened
from ..fitting.least_squares import fit
from ..fitting.problem import Problem
from ..mechanisms.terms import Mechanism
from ..selection.evaluation import Errors, Split, summarise_errors
from ..selection.splits import assign_folds
from .candidates import Candidate, build_candidates
from .outliers import GROSS_THRESHOLD, LEFT, MOST, find_far_rows, find_gross_outliers
from .stepwise import Diagnosis, run_stepwise_search

OUTLIER_ROUNDS = 3
SCANNED = 2500  # rows: beyond it the columns of all candidates take a gigabyte and more


def diagnose_split(
    split: Split,
    base: Model,
    everything: tuple[Mechanism, ...],
    seed: int,
    cells: bool,
    say: Say = lambda _: None,
) -> tuple[Split, Diagnosis, tuple[Candidate, ...]]:
    """Outliers, then names; where the extended model shows other outliers than the base did, once
    more with those.

    `everything`: mechanisms that may extend the base; `cells`: whether unregistered causes may,
    too. Of more than SCANNED rows a seeded choice of configurations is scanned, so that the scan's
    columns fit into memory; outliers are judged in all rows."""
    if split.estimation.sum() > SCANNED:
        some, extension, found = diagnose_split(
            replace(split, estimation=_chosen(split, seed)), base, everything, seed, cells, say
        )
        size, used = whitened(split.problem, extension.fit.residuals(split.problem)), some.used
        seen = None if split.problem.measured is None else split.problem.measured[used]
        outlying = split.estimation & find_far_rows(
            size, size[used], LEFT if extension.effects else GROSS_THRESHOLD, seen
        )
        return (
            replace(
                split,
                outlying=outlying if outlying[split.estimation].mean() <= MOST else some.outlying,
            ),
            extension,
            found,
        )
    training = split.problem.take(split.estimation)
    rows = np.flatnonzero(split.estimation)
    outlying = find_gross_outliers(training, base)
    for _ in range(OUTLIER_ROUNDS):
        split = replace(split, outlying=_mask(len(split.estimation), rows[outlying]))
        kept = split.training()
        base_fit = fit(kept, base)
        found = build_candidates(kept, base, everything, cells=cells)
        say(f"naming: {len(found)} candidates")
        extension = run_stepwise_search(kept, base, base_fit, found, generator(seed, "naming"), say)
        again = _left_over(training, extension, outlying)
        if (
            outlying.any()
        ):  # an effect of a few rows looks like outliers: does it still, once it may be named?
            everyone = replace(split, outlying=np.zeros(len(split.estimation), bool)).training()
            other = run_stepwise_search(
                everyone, base, fit(everyone, base), found, generator(seed, "naming"), say
            )
            fewer = _left_over(everyone, other, np.zeros(len(everyone), bool))
            again = fewer if fewer.sum() <= outlying.sum() / 2 else again
        if (again == outlying).all() or again.mean() > MOST:
            break
        outlying = again
    return split, extension, found


def _chosen(split: Split, seed: int) -> NDArray[np.bool_]:
    """Mask of about SCANNED estimation rows: configurations drawn by the seed, equal readings
    together."""
    block = split.problem.data.block
    drawn = generator(seed, "scan").permutation(np.unique(block[split.estimation]))
    share = SCANNED / float(split.estimation.sum())
    return np.asarray(split.estimation & np.isin(block, drawn[: max(20, int(share * len(drawn)))]))


def _left_over(
    problem: Problem, diagnosis: Diagnosis, outlying: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Rows far off the extended model, in robust standard deviations of the rows that made it."""
    size = whitened(problem, diagnosis.fit.residuals(problem))
    seen = None if problem.measured is None else problem.measured[~outlying]
    return find_far_rows(
        size, size[~outlying], LEFT if diagnosis.effects else GROSS_THRESHOLD, seen
    )


def _mask(m: int, rows: Index) -> NDArray[np.bool_]:
    out = np.zeros(m, bool)
    out[rows] = True
    return out


@dataclass(frozen=True)
class Nested:
    """The whole procedure repeated in every fold: errors of base and chosen model on rows it has
    not seen, and how often each name came up."""

    folds: int
    base: Errors
    chosen: Errors
    named: dict[str, int]


def _one_fold(
    k: int,
    split: Split,
    base: Model,
    everything: tuple[Mechanism, ...],
    seed: int,
    cells: bool,
    fold: Index,
) -> tuple[NDArray[np.bool_], NDArray[np.float64], NDArray[np.float64], list[str]]:
    inside = replace(
        split, estimation=split.estimation & (fold != k), outlying=np.zeros(len(fold), bool)
    )
    inside, extension, _ = diagnose_split(inside, base, everything, seed, cells)
    out = fold == k
    problem = split.problem.take(out)
    base_fit = fit(inside.training(), base)
    return (
        out,
        base_fit.residuals(problem),
        extension.fit.residuals(problem),
        [e.candidate.label for e in extension.effects],
    )


def run_nested_folds(
    split: Split, base: Model, everything: tuple[Mechanism, ...], seed: int, cells: bool, folds: int
) -> Nested:
    """Outliers, naming and fit redone without each fold of the estimation configurations, in
    parallel; the same figures whatever the number of workers."""
    fold = np.full(len(split.estimation), -1, dtype=np.intp)
    fold[split.estimation] = assign_folds(
        split.problem.data.take(split.estimation), folds, generator(seed, "nested")
    )
    count = int(fold.max()) + 1
    work = partial(
        _one_fold, split=split, base=base, everything=everything, seed=seed, cells=cells, fold=fold
    )
    with ProcessPoolExecutor(max_workers=min(count, os.cpu_count() or 1)) as pool:
        done = list(pool.map(work, range(count)))
    before, after = (np.full((len(fold), split.problem.components), np.nan) for _ in range(2))
    named: dict[str, int] = {}
    for out, b, a, names in done:
        before[out], after[out] = b, a
        for name in dict.fromkeys(names):
            named[name] = named.get(name, 0) + 1
    rows = split.estimation
    return Nested(
        count,
        summarise_errors(before[rows], split.outlying[rows]),
        summarise_errors(after[rows], split.outlying[rows]),
        dict(sorted(named.items(), key=lambda item: (-item[1], item[0]))),
    )
