"""Folds by configuration or group, and exact K-fold and leave-one-out from one factorisation: no
refit.

With Q an orthonormal basis of the design, Q_k its rows in fold k and e the residual,
    beta(-k) = beta − R⁻¹ (I − Q_kᵀQ_k)⁻¹ Q_kᵀ e_k                 (Cook & Weisberg 1982; methods.md A.1).
Each fold enters reduced to a small block [columns | response], so any number of rows costs the
same."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .._typing import Array, Index
from ..exceptions import NotEstimable
from ..fitting.design import assemble, blocks, whiten
from ..fitting.identifiability import identify, solve
from ..fitting.linearisation import Linearisation
from ..fitting.problem import BLOCK, Problem
from ..fitting.reduction import STREAM, Reduction, scatter_columns
from ..mechanisms.terms import Term
from ..robot._kernels import Space

DEPENDENT = (
    1e-9  # 1 − largest eigenvalue of Q_kᵀQ_k: below it the model is not estimable without the fold
)


@dataclass(frozen=True, eq=False)
class Folded:
    """K blocks (K, h, p+1) of [columns | response], zero-padded, and the whitened coordinates (K,)
    behind each; the `prior`'s rows are in every fit."""

    blocks: Array
    rows: Index
    prior: Array | None = field(default=None, repr=False)  # rows (k, p+1) that belong to no fold

    def select(self, columns: Sequence[int] | Index) -> Folded:
        """Of some columns; the response stays last."""
        return Folded(
            self.blocks[:, :, [*columns, -1]],
            self.rows,
            None if self.prior is None else self.prior[:, [*columns, -1]],
        )

    @cached_property
    def total(self) -> Reduction:
        """All folds as one triangle."""
        p1 = self.blocks.shape[2]
        data = Reduction.empty(p1 - 1).add(self.blocks.reshape(-1, p1))
        return Reduction(
            (data if self.prior is None else data.add(self.prior)).R, int(self.rows.sum())
        )


def pad(parts: Sequence[Array], rows: Sequence[int] | Index) -> Folded:
    """Blocks of different heights as one array; the taller ones are folded into triangles first."""
    p1 = parts[0].shape[1]
    parts = [part if len(part) <= p1 else Reduction.empty(p1 - 1).add(part).R for part in parts]
    out = np.zeros((len(parts), max(map(len, parts)), p1))
    for block, part in zip(out, parts, strict=True):
        block[: len(part)] = part
    return Folded(out, np.array(rows, dtype=np.intp))


Point = tuple[
    Sequence[Term], Linearisation | None, Sequence[int] | None
]  # terms, where linearised, which


def fold(
    problem: Problem,
    terms: Sequence[Term],
    fold_of: Index,
    at: Linearisation | None = None,
    only: Sequence[int] | None = None,
) -> Folded:
    """A problem's whitened design and residual, reduced fold by fold, block of rows by block of rows.
    `only`: the terms that are asked for; of many rows the other columns are nought."""
    return folds(problem, [(terms, at, only)], fold_of)[0]


def folds(problem: Problem, points: Sequence[Point], fold_of: Index) -> list[Folded]:
    """`fold` of several models, each at its own point, in one pass: a block's causes are evaluated
    once for all of them."""
    count = int(fold_of.max()) + 1
    rows_of = problem.counted(fold_of, count)
    if len(problem) <= BLOCK:
        out = []
        for terms, at, _ in points:
            stacked = whiten(problem, assemble(problem, terms, at)).transpose(
                2, 1, 0
            )  # (rows, c, p+1)
            out.append(
                pad(
                    [stacked[fold_of == k].reshape(-1, len(terms) + 1) for k in range(count)],
                    rows_of,
                )
            )
        return out
    picked = [
        [*(range(len(terms)) if only is None else only), len(terms)] for terms, _, only in points
    ]
    found = [[Reduction.empty(len(some) - 1)] * count for some in picked]
    spaces = [Space() for _ in points]
    order = np.argsort(fold_of, kind="stable")
    for rows in (order[start : start + STREAM] for start in range(0, len(problem), STREAM)):
        part, (own, first) = problem.take(rows), np.unique(fold_of[rows], return_index=True)
        for (terms, at, _), some, into, space in zip(points, picked, found, spaces, strict=True):
            block = whiten(part, assemble(part, terms, at, space=space))[some]
            for k, start, stop in zip(own, first, [*first[1:], len(rows)], strict=True):
                into[k] = into[k].add(block[:, :, start:stop].reshape(len(some), -1).T)
    return [
        pad([scatter_columns(r.R, some, len(terms) + 1) for r in into], rows_of)
        for (terms, _, _), some, into in zip(points, picked, found, strict=True)
    ]


def by_unit(
    problem: Problem,
    terms: Sequence[Term],
    unit: Index,
    at: Linearisation | None = None,
) -> Iterator[Folded]:
    """A fold per unit (m,), a configuration or a group, in order, a block of rows at a time: of any
    number of rows only one block is held."""
    unit = np.unique(unit, return_inverse=True)[1].reshape(-1)
    order = np.argsort(unit, kind="stable")
    edges = np.append(np.flatnonzero(np.diff(unit[order], prepend=-1)), len(problem))
    c, p1, k = problem.components, len(terms) + 1, 0
    while k < len(edges) - 1:
        end = max(int(np.searchsorted(edges, edges[k] + BLOCK, side="right")) - 1, k + 1)
        rows, height = order[edges[k] : edges[end]], np.diff(edges[k : end + 1])
        if len(rows) == len(problem):
            block = whiten(problem, assemble(problem, terms, at))[:, :, rows]
        else:
            part = problem.take(rows)
            block = whiten(part, assemble(part, terms, at))
        out = np.zeros((end - k, height.max(), c, p1))
        which = unit[rows] - k
        out[which, np.arange(len(rows)) - (edges[k:end] - edges[k])[which]] = block.transpose(
            2, 1, 0
        )
        out = out.reshape(end - k, -1, p1)
        tall = [b[: h * c] for b, h in zip(out, height, strict=True)] if out.shape[1] > p1 else None
        seen = (
            height * c if problem.measured is None else problem.take(rows).counted(which, end - k)
        )
        yield Folded(out, seen) if tall is None else pad(tall, seen)
        k = end


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Of one model: beta (K, p) fitted without each fold, held-out sums of squares (K,) in whitened
    coordinates, the residual sum of squares of all rows, and the log predictive density (K,) of
    every fold (Jeffreys prior, multivariate t; methods.md A.4) from the folds' QᵀQ (K, r, r) and
    eᵀ(I − H)⁻¹e (K,)."""

    without: Array
    held_out: Array
    rows: Index
    rss: float
    gram: Array = field(repr=False)
    quadratic: Array = field(repr=False)
    by_prior: int = 0

    @cached_property
    def density(self) -> Array:
        """(K,) log predictive density of every fold given the others."""
        return _density(
            self.gram, self.quadratic, self.rss, self.rows, self.gram.shape[1] - self.by_prior
        )

    @property
    def rms(self) -> float:
        """Root mean square of one whitened coordinate, held out."""
        return float(np.sqrt(self.held_out.sum() / self.rows.sum()))


def cross_validate(
    folded: Folded, kept: Sequence[int] | None = None, prior: Array | None = None
) -> CrossValidation:
    """Exact, from one factorisation. `kept`: the columns to fit (default: those `identify` keeps);
    `prior`: rows (k, p+1) of [columns | response] that belong to no fold. Raises NotEstimable where
    the model is not estimable without some fold."""
    total = folded.total
    if prior is not None:
        total = Reduction(total.add(prior).R, total.rows)
    kept = list(identify(total).kept if kept is None else kept)
    beta, factor, rss = solve(total, kept)
    X, y = folded.blocks[:, :, kept], folded.blocks[:, :, -1]
    Q, e = X @ factor, y - X @ beta
    gram = Q.transpose(0, 2, 1) @ Q
    gap = 1 - np.linalg.eigvalsh(gram)[:, -1] if kept else np.ones(len(X))
    if gap.min() < DEPENDENT:
        worst = int(gap.argmin())
        raise NotEstimable(
            f"without fold {worst + 1} of {len(X)} the model is not estimable: some parameter rests on that "
            "fold alone. Use more folds or measure more configurations."
        )
    v = np.linalg.solve(np.eye(len(kept)) - gram, (Q.transpose(0, 2, 1) @ e[:, :, None]))[:, :, 0]
    without = np.zeros((len(X), folded.blocks.shape[2] - 1))
    without[:, kept] = beta - v @ factor.T
    left = e + np.einsum("khr,kr->kh", Q, v)
    return CrossValidation(
        without,
        np.square(left).sum(1),
        folded.rows,
        rss,
        gram,
        np.einsum("kh,kh->k", e, left),
        0 if prior is None else len(prior),
    )


def _density(gram: Array, quadratic: Array, rss: float, rows: Index, rank: int) -> Array:
    """log t_{n_k}(y_k | the other folds); −inf where the others leave no degree of freedom."""
    from scipy.special import gammaln

    nu = rows.sum() - rows - rank
    good = nu > 0
    nu = np.where(good, nu, 1).astype(float)
    scale = np.maximum(rss - quadratic, 1e-300) / nu  # s²(-k): RSS(-k) = RSS − e_kᵀ(I−H_kk)⁻¹e_k
    logdet = (
        np.linalg.slogdet(np.eye(gram.shape[1]) - gram)[1] if gram.shape[1] else np.zeros(len(gram))
    )
    out = (
        gammaln((nu + rows) / 2)
        - gammaln(nu / 2)
        - rows / 2 * np.log(nu * np.pi * scale)
        + logdet / 2
        - (nu + rows) / 2 * np.log1p(quadratic / (nu * scale))
    )
    return np.where(good, out, -np.inf)


def held_out_residuals(
    problem: Problem,
    terms: Sequence[Term],
    fold_of: Index,
    without: Array,
    at: Linearisation | None = None,
) -> Array:
    """(m, 3) mm: every row's residual under the fit that has not seen its fold (linear about `at`),
    not whitened."""
    out = np.empty((len(problem), 3))
    for rows, columns, residual in blocks(problem.unweighted(), terms, at):
        delta: NDArray[np.float64] = without[fold_of[rows]]
        out[rows] = (residual[:3] - np.einsum("pcm,mp->cm", columns[:, :3], delta)).T
    return out
