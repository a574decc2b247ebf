"""The whole diagnosis: outliers and names in turn, and the same repeated in folds.

`diagnose` is the entry for users of the package; `diagnose_split` is the same for a study's split,
and `run_nested_folds` repeats it without each fold, for a gain that no part of the procedure has
seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from .._arguments import check_rows, check_type, check_whole_number, collect_names
from .._progress import News, follow, keep_silent
from .._random import generator
from .._typing import Array, Index, Mask
from .._workers import count_cores, steady_arithmetic
from ..exceptions import StudyError
from ..fitting.design import Model
from ..fitting.least_squares import fit
from ..fitting.problem import PROBLEM_EXPECTED, Problem
from ..mechanisms.campaign_registry import set_targets
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
from .base_fits import keep_base
from .candidates.candidate import Candidate
from .candidates.options import DEFAULT_OPTIONS, DiagnosisOptions
from .chosen_moments import choose_step_moments, list_scanned_steps
from .faults.outliers import MAX_OUTLIER_SHARE
from .findings.outcome import Diagnosis
from .findings.step_sides import find_open_sides, mark_open
from .outlier_rounds import alternate, judge_rows
from .separation import Inquiry

# configurations that are scanned at least, of many rows
MIN_CONFIGURATIONS = 20
UNFINISHED = (
    "split.nested_folds: a process that repeats the folds has ended before it was done. A script that "
    'asks for folds calls run_study below `if __name__ == "__main__":`, as every process reads the '
    "script anew on Windows and macOS; otherwise the memory may not be enough for as many as there "
    "are cores."
)
ALL = "all"


@steady_arithmetic()
def diagnose(  # noqa: PLR0913  all but the first have defaults
    problem: Problem,
    *,
    base: Sequence[str] | str = ("geometric",),
    candidates: Sequence[str] | str = ALL,
    seed: int = 0,
    registry: Registry = BUILTIN,
    estimation: Mask | None = None,
    options: DiagnosisOptions = DEFAULT_OPTIONS,
    progress: bool | None = None,
) -> Diagnosis:
    """Name what is wrong with a model of a robot.

    `base`: registered names of the model to extend, or one; `candidates`: registered names that may extend
    it, or "all" for every mechanism of the registry, data faults and unregistered causes;
    `estimation`: mask (m,) of the rows to use (None: all); `seed`: of every random choice, 0 or more; `progress`: show what is being done and
    what is found, in a notebook or on the error stream (by default on a terminal). The result
    prints its findings.

    Raises StudyError for an unknown name or a wrong argument, NotEstimable where the data do not determine the base."""
    check_type("problem", problem, Problem, PROBLEM_EXPECTED)
    check_type("options", options, DiagnosisOptions, "DiagnosisOptions(…)")
    seed = check_whole_number("seed", seed, 0)
    base_names = collect_names("base", base)
    rows = len(problem)
    used = np.ones(rows, bool)
    if estimation is not None:
        used = check_rows("estimation", estimation, rows)
    split = Split(problem, used, np.zeros(rows, bool), np.zeros(rows, np.intp), known_sigma=False)
    registry = set_targets(registry, problem.data.targets, problem.data.listed_targets)
    mechanisms = _build_base(problem, used, base_names, registry)
    with follow(None, progress) as say:
        inquiry = Inquiry(
            base=Model(mechanisms),
            everything=_resolve_candidates(problem, candidates, registry),
            seed=seed,
            cells=_takes_all(candidates),
            say=say,
            options=options,
        )
        _, diagnosis, _ = diagnose_split(split, inquiry)
    return diagnosis


def _build_base(
    problem: Problem, used: Mask, names: Sequence[str], registry: Registry
) -> tuple[Mechanism, ...]:
    """Build the mechanisms of a base; of steps without a moment at that which fits the `used` rows
    best."""
    robot = problem.robot
    listed = {name: list_scanned_steps(name, robot, registry) for name in names}
    steps = {name: every for name, every in listed.items() if every}
    others = {name: mechanism(name, robot, registry) for name in names if name not in steps}
    chosen: dict[str, Mechanism] = {}
    if steps:
        model = Model(tuple(others.values()))
        chosen = choose_step_moments(problem, used, model, steps)
    known = others | chosen
    return tuple(known.get(name) or mechanism(name, robot, registry) for name in names)


def _takes_all(candidates: Sequence[str] | str) -> bool:
    return isinstance(candidates, str) and candidates == ALL


def _resolve_candidates(
    problem: Problem, candidates: Sequence[str] | str, registry: Registry
) -> tuple[Mechanism, ...]:
    robot = problem.robot
    if _takes_all(candidates):
        return (*build_faults(robot), *every(robot, registry))
    mechanisms: list[Mechanism] = []
    names = collect_names("candidates", candidates)
    for name in names:
        mechanisms += build_mechanisms(name, robot, registry)
    return tuple(mechanisms)


def diagnose_split(
    split: Split, inquiry: Inquiry
) -> tuple[Split, Diagnosis, tuple[Candidate, ...]]:
    """Find outliers and name effects in turn, until the outliers stay the same.

    Of more than `options.max_rows` estimation rows, configurations drawn by the seed are scanned; outliers are judged in all rows. Returns the split with its outliers marked and its rows
    weighed so that they are independent, the diagnosis, and the candidates."""
    split = replace(split, problem=split.problem.as_stated())
    max_rows = inquiry.options.max_rows
    if split.estimation.sum() <= max_rows:
        return alternate(split, inquiry)
    drawn = _draw_configurations(split, inquiry.seed, max_rows)
    sample = replace(split, estimation=drawn)
    # to a sample the base is fitted roughly
    sample, diagnosis, found = alternate(sample, inquiry._replace(tell_base=keep_base))
    split.problem.keep_values(diagnosis.model.terms)
    outlying = _find_outliers_everywhere(split, sample, diagnosis)
    whole = replace(split.problem, whitening=sample.problem.whitening)
    marked = replace(split, problem=whole, outlying=outlying)
    return marked, diagnosis, found


def _find_outliers_everywhere(split: Split, sample: Split, diagnosis: Diagnosis) -> Mask:
    """Find outliers among all estimation rows, judged by the sampled rows.

    Where they would be too many, those of the sample alone are returned."""
    own = diagnosis.errors.of_instrument()
    weighed = own.whiten(split.problem)
    is_far = judge_rows(weighed, diagnosis, sample.used)
    outlying = split.estimation & is_far
    share = outlying[split.estimation].mean()
    if share <= MAX_OUTLIER_SHARE:
        return outlying
    return sample.outlying


def _draw_configurations(split: Split, seed: int, max_rows: int) -> Mask:
    """Draw about `max_rows` estimation rows (mask) by the seed, equal readings together."""
    block = split.problem.data.block
    drawn = generator(seed, "scan").permutation(np.unique(block[split.estimation]))
    share = max_rows / float(split.estimation.sum())
    count = max(MIN_CONFIGURATIONS, int(share * len(drawn)))
    return np.asarray(split.estimation & np.isin(block, drawn[:count]))


@dataclass(frozen=True)
class Nested:
    """The whole procedure repeated without each fold.

    `base` and `chosen`: errors of both models on rows that the procedure has not seen; `named`: in
    how many folds each name was found."""

    folds: int
    base: Errors
    chosen: Errors
    named: dict[str, int]


class _Fold(NamedTuple):
    """One fold: its rows (mask), those of them whose side of a step was not known without it (mask), their
    residuals under base and chosen model, the names found."""

    rows: Mask
    undecided: Mask
    base: Array
    chosen: Array
    names: list[str]


def assign_nested_folds(split: Split, folds: int, seed: int) -> Index:
    """Assign every estimation row (m,) to one of the folds in which all is repeated; -1: held out."""
    rows = split.estimation
    data = split.problem.data
    estimation = data.take(rows)
    rng = generator(seed, "nested")
    count = len(rows)
    fold = np.full(count, -1, dtype=np.intp)
    fold[rows] = assign_folds(estimation, folds, rng)
    return fold


@steady_arithmetic()
def _run_fold(k: int, split: Split, inquiry: Inquiry, fold: Index) -> _Fold:
    outside = fold == k
    rest = replace(
        split, estimation=split.estimation & ~outside, outlying=np.zeros(len(fold), bool)
    )
    base = inquiry.base
    inside, diagnosis, _ = diagnose_split(rest, inquiry)
    problem = split.problem.take(outside)
    base_fit = fit(inside.training, base)
    names = [effect.candidate.label for effect in diagnosis.effects]
    mechanisms = diagnosis.model.mechanisms
    sides = find_open_sides(split.problem, inside.used, mechanisms, diagnosis.effects)
    return _Fold(
        rows=outside,
        undecided=mark_open(sides, outside),
        base=base_fit.residuals(problem),
        chosen=diagnosis.fit.residuals(problem),
        names=names,
    )


def run_nested_folds(split: Split, asked: Inquiry, folds: int) -> Nested:
    """Repeat outliers, naming and fit without each fold of the estimation configurations.

    Rows whose side of a step is not known without their fold are left out of the errors, unless all
    are. The folds run in parallel; the result does not depend on the number of workers. Raises
    StudyError where their processes end before they are done."""
    from concurrent.futures import ProcessPoolExecutor
    from concurrent.futures.process import BrokenProcessPool

    rows = split.estimation
    fold = assign_nested_folds(split, folds, asked.seed)
    count = int(fold.max()) + 1
    say = asked.say
    inquiry = asked._replace(say=keep_silent, tell_base=keep_base)
    run = partial(_run_fold, split=split, inquiry=inquiry, fold=fold)
    workers = min(count, count_cores())
    done: list[_Fold] = []
    try:
        with ProcessPoolExecutor(max_workers=workers) as pool:
            say(News(f"none of {count} folds", 0.0))
            for one in pool.map(run, range(count)):
                done.append(one)
                say(News(f"{len(done)} of {count} folds", len(done) / count))
    except BrokenProcessPool:
        raise StudyError(UNFINISHED) from None
    shape = len(fold), split.problem.components
    before = np.full(shape, np.nan)
    after = np.full(shape, np.nan)
    undecided = np.zeros(len(fold), bool)
    for one in done:
        before[one.rows] = one.base
        after[one.rows] = one.chosen
        undecided |= one.undecided
    outlying = split.outlying[rows]
    if not (outlying | undecided[rows]).all():
        outlying = outlying | undecided[rows]
    return Nested(
        folds=count,
        base=summarise_errors(before[rows], outlying),
        chosen=summarise_errors(after[rows], outlying),
        named=_count_names(done),
    )


def _count_names(folds: Sequence[_Fold]) -> dict[str, int]:
    """Count in how many folds each name was found, the most frequent first."""
    counts: dict[str, int] = {}
    for one in folds:
        for name in dict.fromkeys(one.names):
            before = counts.get(name, 0)
            counts[name] = before + 1
    names = sorted(counts)
    names.sort(key=lambda name: -counts[name])
    return {name: counts[name] for name in names}
