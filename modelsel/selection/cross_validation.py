"""Exact K-fold and leave-one-out cross-validation from one factorisation, without a refit.

With Q an orthonormal basis of the design, Q_k its rows in fold k and e the residual,
    beta(-k) = beta − R⁻¹ (I − Q_kᵀQ_k)⁻¹ Q_kᵀ e_k                 (Cook & Weisberg 1982; methods.md A.1).
Each fold is reduced to a small block [columns | response], so the cost does not depend on the
number of rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from .._linalg import TINY
from .._typing import Array, Index
from ..fitting.design import assemble, whiten
from ..fitting.identifiability import identify, solve
from ..fitting.least_squares import Fit
from ..fitting.linearisation import Linearisation
from ..fitting.problem import BLOCK, Problem
from ..fitting.reduction import Reduction, reduce_folds, scatter_columns
from ..mechanisms.terms import Term
from .moments import Coordinates, LinearRows, Moments, measure_fit


@dataclass(frozen=True, eq=False)
class FoldedData:
    """Linearised data, reduced fold by fold.

    blocks: (K, h, p+1) of [columns | response], zero-padded.
    rows: (K,) whitened coordinates behind each block.
    prior: rows (k, p+1) that belong to no fold and are in every fit.
    """

    blocks: Array
    rows: Index
    prior: Array | None = field(default=None, repr=False)

    def select(self, columns: Sequence[int] | Index) -> FoldedData:
        """Select columns; the response stays last."""
        chosen = [*columns, -1]
        blocks = self.blocks[:, :, chosen]
        prior = self.prior
        if prior is not None:
            prior = prior[:, chosen]
        return FoldedData(blocks, self.rows, prior)

    @cached_property
    def total(self) -> Reduction:
        """All folds as one triangle."""
        blocks = self.blocks
        width = blocks.shape[2]
        rows = blocks.reshape(-1, width)
        data = Reduction.empty(width - 1)
        data = data.add(rows)
        prior = self.prior
        if prior is not None:
            data = data.add(prior)
        count = self.rows.sum()
        count = int(count)
        return Reduction(data.R, count)


def pad_blocks(parts: Sequence[Array], rows: Sequence[int] | Index) -> FoldedData:
    """Pad blocks of different heights to one array; tall ones are reduced to triangles first."""
    first = parts[0]
    width = first.shape[1]
    empty = Reduction.empty(width - 1)
    short = []
    for part in parts:
        block = part
        if len(part) > width:
            block = empty.add(part).R
        short.append(block)
    count = len(short)
    height = max(map(len, short))
    blocks = np.zeros((count, height, width))
    for k, block in enumerate(short):
        h = len(block)
        blocks[k, :h] = block
    counts = np.array(rows, dtype=np.intp)
    return FoldedData(blocks, counts)


def fold(
    problem: Problem,
    terms: Sequence[Term],
    fold_of: Index,
    at: Linearisation | None = None,
    only: Sequence[int] | None = None,
) -> FoldedData:
    """Reduce a problem's whitened design and residual fold by fold.

    `fold_of` (m,): the rows' folds; `at`: where the model is linearised; `only`: the terms that are
    wanted, the other columns are zero where there are many rows."""
    folds = int(fold_of.max()) + 1
    rows_of = problem.counted(fold_of, folds)
    if len(problem) > BLOCK:
        return _fold_blockwise(problem, terms, at, only, fold_of, rows_of)
    return _fold_at_once(problem, terms, at, fold_of, rows_of)


def _fold_at_once(
    problem: Problem,
    terms: Sequence[Term],
    at: Linearisation | None,
    fold_of: Index,
    rows_of: Index,
) -> FoldedData:
    """Reduce one design that fits in memory; `rows_of` (K,) coordinates in every fold."""
    design = assemble(problem, terms, at)
    design = whiten(problem, design)
    rows = design.transpose(2, 1, 0)  # (m, c, p+1)
    width = len(terms) + 1
    folds = len(rows_of)
    parts = []
    for k in range(folds):
        in_fold = fold_of == k
        part = rows[in_fold]
        parts.append(part.reshape(-1, width))
    return pad_blocks(parts, rows_of)


def _fold_blockwise(
    problem: Problem,
    terms: Sequence[Term],
    at: Linearisation | None,
    only: Sequence[int] | None,
    fold_of: Index,
    rows_of: Index,
) -> FoldedData:
    """Reduce a design block of rows by block of rows, the wanted columns only."""
    count = len(terms)
    columns = range(count) if only is None else only
    wanted = [*columns, count]
    reductions = reduce_folds(problem, terms, fold_of, at, only)
    parts = [scatter_columns(reduction.R, wanted, count + 1) for reduction in reductions]
    return pad_blocks(parts, rows_of)


def fold_by_unit(
    problem: Problem, terms: Sequence[Term], unit: Index, at: Linearisation | None = None
) -> Iterator[FoldedData]:
    """Reduce a design with a fold per unit (m,), a configuration or a group, in order.

    Yields some units at a time, so that only one block of rows is held in memory."""
    _, unit = np.unique(unit, return_inverse=True)
    unit = unit.reshape(-1)
    order = np.argsort(unit, kind="stable")
    new = np.diff(unit[order], prepend=-1)
    edges = np.append(np.flatnonzero(new), len(problem))
    count = len(edges) - 1
    first = 0
    while first < count:
        stop = edges[first] + BLOCK
        place = np.searchsorted(edges, stop, side="right")
        last = max(int(place) - 1, first + 1)
        rows = order[edges[first] : edges[last]]
        if len(rows) == len(problem):
            design = assemble(problem, terms, at)
            design = whiten(problem, design)
            design = design[:, :, rows]
        else:
            part = problem.take(rows)
            design = assemble(part, terms, at)
            design = whiten(part, design)
        numbers = unit[rows] - first
        starts = edges[first : last + 1]
        yield _fold_units(problem, design, rows, numbers, starts)
        first = last


def _fold_units(
    problem: Problem, design: Array, rows: Index, unit: Index, edges: Index
) -> FoldedData:
    """Reduce a design (p+1, c, rows), its rows sorted by unit, to a block per unit.

    `edges` (K+1,) are the units' first rows."""
    width, c, _ = design.shape
    height = np.diff(edges)
    units = len(height)
    starts = edges[:-1] - edges[0]
    place = np.arange(len(rows)) - starts[unit]
    blocks = np.zeros((units, height.max(), c, width))
    blocks[unit, place] = design.transpose(2, 1, 0)
    blocks = blocks.reshape(units, -1, width)
    if problem.measured is None:
        counts = height * c
    else:
        part = problem.take(rows)
        counts = part.counted(unit, units)
    if blocks.shape[1] <= width:
        return FoldedData(blocks, counts)
    tall = [block[: h * c] for block, h in zip(blocks, height, strict=True)]
    return pad_blocks(tall, counts)


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Exact cross-validation of one model over K folds.

    without: (K, p) coefficients fitted without each fold.
    held_out: (K,) held-out sums of squares, in whitened coordinates.
    rows: (K,) whitened coordinates of each fold.
    rss: residual sum of squares of all rows.
    gram: (K, r, r) the folds' QᵀQ.
    quadratic: (K,) eᵀ(I − H)⁻¹e of each fold.
    by_prior: number of rows of the prior.
    """

    without: Array
    held_out: Array
    rows: Index
    rss: float
    gram: Array = field(repr=False)
    quadratic: Array = field(repr=False)
    by_prior: int = 0

    @cached_property
    def density(self) -> Array:
        """(K,) log predictive density of every fold given the others (Jeffreys prior, multivariate
        t; methods.md A.4)."""
        rank = self.gram.shape[1] - self.by_prior
        return _log_density(self.gram, self.quadratic, self.rss, self.rows, rank)

    @property
    def rms(self) -> float:
        """Root mean square of one whitened coordinate, held out."""
        square_sum = self.held_out.sum()
        count = self.rows.sum()
        mean_square = square_sum / count
        return float(np.sqrt(mean_square))


def cross_validate(
    folded: FoldedData, kept: Sequence[int] | None = None, prior: Array | None = None
) -> CrossValidation:
    """Cross-validate a model exactly, from one factorisation.

    `kept`: the columns to fit (default: those `identify` keeps); `prior`: rows (k, p+1) of
    [columns | response] that belong to no fold. Raises NotEstimable where the model is not
    estimable without some fold."""
    total = folded.total
    if prior is not None:
        joined = total.add(prior)
        total = Reduction(joined.R, total.rows)
    if kept is None:
        kept = identify(total).kept
    kept = list(kept)
    beta, factor, rss = solve(total, kept)
    X = folded.blocks[:, :, kept]
    y = folded.blocks[:, :, -1]
    residual = y - X @ beta
    rows = np.concatenate([X @ factor, residual[:, :, None]], axis=2)
    moments = Moments.of(rows.transpose(0, 2, 1) @ rows)
    change = moments.shift()
    without = np.zeros((len(X), folded.blocks.shape[2] - 1))
    without[:, kept] = beta + change @ factor.T
    by_prior = 0 if prior is None else len(prior)
    return _validate(moments, change, without, folded.rows, rss, by_prior)


def cross_validate_fit(rows: LinearRows, fitted: Fit, fold_of: Index) -> CrossValidation:
    """Cross-validate a fit exactly on the rows it was fitted to, linear about its solution.

    `fold_of` (m,): the rows' folds. Raises NotEstimable where the model is not estimable without
    some fold."""
    coordinates = Coordinates.of(fitted)
    moments = measure_fit(rows, fitted, coordinates, fold_of)
    counts = rows.problem.counted(fold_of, len(moments.square))
    return validate_moments(moments, coordinates, counts)


def validate_moments(moments: Moments, coordinates: Coordinates, counts: Index) -> CrossValidation:
    """Cross-validate a fit from the moments of its folds, of so many measured coordinates (K,)."""
    change = moments.shift()
    without = coordinates.coefficients(change)
    return _validate(moments, change, without, counts, coordinates.rss, len(coordinates.prior))


def _validate(
    moments: Moments, change: Array, without: Array, rows: Index, rss: float, by_prior: int
) -> CrossValidation:
    """Compute the cross-validation from the change (K, r) of the solution without each fold."""
    held_out = moments.moved(change)
    quadratic = moments.square - (moments.score * change).sum(1)
    return CrossValidation(without, held_out, rows, rss, moments.gram, quadratic, by_prior)


def _log_density(gram: Array, quadratic: Array, rss: float, rows: Index, rank: int) -> Array:
    """Compute the log (K,) of t_{n_k}(y_k | the other folds); −inf where the others leave no degree
    of freedom.

    With ν = n − n_k − rank and ν s² = RSS − eᵀ(I − H)⁻¹e, the RSS without the fold,
    ln Γ((ν+n_k)/2) − ln Γ(ν/2) − n_k/2 ln(ν π s²) + ½ ln|I − H| − (ν+n_k)/2 ln(1 + eᵀ(I − H)⁻¹e/(ν s²))."""
    from scipy.special import gammaln

    nu = rows.sum() - rows - rank
    good = nu > 0
    nu = np.where(good, nu, 1).astype(float)
    scale = np.maximum(rss - quadratic, TINY) / nu
    logdet = np.zeros(len(gram))
    if gram.shape[1]:
        logdet = np.linalg.slogdet(np.eye(gram.shape[1]) - gram)[1]
    power = (nu + rows) / 2
    constant = gammaln(power) - gammaln(nu / 2) - rows / 2 * np.log(nu * np.pi * scale)
    density = constant + logdet / 2 - power * np.log1p(quadratic / (nu * scale))
    return np.where(good, density, -np.inf)
