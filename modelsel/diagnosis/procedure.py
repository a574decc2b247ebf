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
from ..fitting.problem import Scene
from ..mechanisms.terms import Mechanism
from ..selection.evaluation import Data, Errors, errors
from ..selection.splits import assign
from .candidates import Candidate, candidates
from .outliers import GROSS, LEFT, MOST, far_off, gross
from .stepwise import Extension, extend

OUTLIER_ROUNDS = 3
SCANNED = 2500  # rows: beyond it the columns of all candidates take a gigabyte and more


def explain(
    data: Data,
    base: Model,
    everything: tuple[Mechanism, ...],
    seed: int,
    cells: bool,
    say: Say = lambda _: None,
) -> tuple[Data, Extension, tuple[Candidate, ...]]:
    """Outliers, then names; where the extended model shows other outliers than the base did, once
    more with those.

    `everything`: mechanisms that may extend the base; `cells`: whether unregistered causes may,
    too. Of more than SCANNED rows a seeded choice of configurations is scanned, so that the scan's
    columns fit into memory; outliers are judged in all rows."""
    if data.estimation.sum() > SCANNED:
        some, extension, found = explain(
            replace(data, estimation=_chosen(data, seed)), base, everything, seed, cells, say
        )
        size, used = whitened(data.scene, extension.fit.residuals(data.scene)), some.used
        seen = None if data.scene.measured is None else data.scene.measured[used]
        outlying = data.estimation & far_off(
            size, size[used], LEFT if extension.effects else GROSS, seen
        )
        return (
            replace(
                data,
                outlying=outlying if outlying[data.estimation].mean() <= MOST else some.outlying,
            ),
            extension,
            found,
        )
    training = data.scene.take(data.estimation)
    rows = np.flatnonzero(data.estimation)
    outlying = gross(training, base)
    for _ in range(OUTLIER_ROUNDS):
        data = replace(data, outlying=_mask(len(data.estimation), rows[outlying]))
        kept = data.training()
        base_fit = fit(kept, base)
        found = candidates(kept, base, everything, cells=cells)
        say(f"naming: {len(found)} candidates")
        extension = extend(kept, base, base_fit, found, generator(seed, "naming"), say)
        again = _left_over(training, extension, outlying)
        if (
            outlying.any()
        ):  # an effect of a few rows looks like outliers: does it still, once it may be named?
            everyone = replace(data, outlying=np.zeros(len(data.estimation), bool)).training()
            other = extend(
                everyone, base, fit(everyone, base), found, generator(seed, "naming"), say
            )
            fewer = _left_over(everyone, other, np.zeros(len(everyone), bool))
            again = fewer if fewer.sum() <= outlying.sum() / 2 else again
        if (again == outlying).all() or again.mean() > MOST:
            break
        outlying = again
    return data, extension, found


def _chosen(data: Data, seed: int) -> NDArray[np.bool_]:
    """Mask of about SCANNED estimation rows: configurations drawn by the seed, equal readings
    together."""
    block = data.scene.data.block
    drawn = generator(seed, "scan").permutation(np.unique(block[data.estimation]))
    share = SCANNED / float(data.estimation.sum())
    return np.asarray(data.estimation & np.isin(block, drawn[: max(20, int(share * len(drawn)))]))


def _left_over(
    scene: Scene, extension: Extension, outlying: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Rows far off the extended model, in robust standard deviations of the rows that made it."""
    size = whitened(scene, extension.fit.residuals(scene))
    seen = None if scene.measured is None else scene.measured[~outlying]
    return far_off(size, size[~outlying], LEFT if extension.effects else GROSS, seen)


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
    data: Data,
    base: Model,
    everything: tuple[Mechanism, ...],
    seed: int,
    cells: bool,
    fold: Index,
) -> tuple[NDArray[np.bool_], NDArray[np.float64], NDArray[np.float64], list[str]]:
    inside = replace(
        data, estimation=data.estimation & (fold != k), outlying=np.zeros(len(fold), bool)
    )
    inside, extension, _ = explain(inside, base, everything, seed, cells)
    out = fold == k
    scene = data.scene.take(out)
    base_fit = fit(inside.training(), base)
    return (
        out,
        base_fit.residuals(scene),
        extension.fit.residuals(scene),
        [e.candidate.label for e in extension.effects],
    )


def nested(
    data: Data, base: Model, everything: tuple[Mechanism, ...], seed: int, cells: bool, folds: int
) -> Nested:
    """Outliers, naming and fit redone without each fold of the estimation configurations, in
    parallel; the same figures whatever the number of workers."""
    fold = np.full(len(data.estimation), -1, dtype=np.intp)
    fold[data.estimation] = assign(
        data.scene.data.take(data.estimation), folds, generator(seed, "nested")
    )
    count = int(fold.max()) + 1
    work = partial(
        _one_fold, data=data, base=base, everything=everything, seed=seed, cells=cells, fold=fold
    )
    with ProcessPoolExecutor(max_workers=min(count, os.cpu_count() or 1)) as pool:
        done = list(pool.map(work, range(count)))
    before, after = (np.full((len(fold), data.scene.components), np.nan) for _ in range(2))
    named: dict[str, int] = {}
    for out, b, a, names in done:
        before[out], after[out] = b, a
        for name in dict.fromkeys(names):
            named[name] = named.get(name, 0) + 1
    rows = data.estimation
    return Nested(
        count,
        errors(before[rows], data.outlying[rows]),
        errors(after[rows], data.outlying[rows]),
        dict(sorted(named.items(), key=lambda item: (-item[1], item[0]))),
    )
