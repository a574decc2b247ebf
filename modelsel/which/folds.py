"""Folds by configuration or group, and exact K-fold and leave-one-out from one factorisation: no refit.

With Q an orthonormal basis of the design, Q_k its rows in fold k and e the residual,
    beta(-k) = beta − R⁻¹ (I − Q_kᵀQ_k)⁻¹ Q_kᵀ e_k                 (Cook & Weisberg 1982; methods.md A.1).
Each fold enters reduced to a small block [columns | response], so any number of rows costs the same.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..data.measurements import Index, Measurements
from ..matrix.design import blocks
from ..matrix.identify import identify, solve
from ..matrix.reduce import Reduction, reduce_scene
from ..matrix.scene import BLOCK, Scene
from ..words.errors import NotEstimable
from ..words.rigid import Array
from ..wrong.screws import Term

DEPENDENT = 1e-9   # 1 − largest eigenvalue of Q_kᵀQ_k: below it the model is not estimable without the fold


def assign(data: Measurements, folds: int, rng: np.random.Generator, by: str = "configuration") -> Index:
    """(m,) fold of every row: equal readings never apart; by="group" keeps groups whole. folds = 0 leaves one out."""
    unit = data.group if by == "group" else data.block
    distinct = np.unique(unit)
    count = len(distinct) if folds <= 0 else min(folds, len(distinct))
    order = rng.permutation(len(distinct))
    if data.gauges is not None:             # rows of one feature go to different folds: each can be told without any one of them
        first = np.full(len(distinct), -1)
        first[np.searchsorted(distinct, unit)] = data.gauges.feature
        order = order[np.argsort(first[order], kind="stable")]
    fold = np.empty(len(distinct), dtype=np.intp)
    fold[order] = np.arange(len(distinct)) % count
    return fold[np.searchsorted(distinct, unit)]


@dataclass(frozen=True, eq=False)
class Folded:
    """K blocks (K, h, p+1) of [columns | response], zero-padded, and the whitened coordinates (K,) behind each."""

    blocks: Array
    rows: Index

    def select(self, columns: Sequence[int] | Index) -> Folded:
        """Of some columns; the response stays last."""
        return Folded(self.blocks[:, :, [*columns, -1]], self.rows)

    def total(self) -> Reduction:
        """All folds as one triangle."""
        p1 = self.blocks.shape[2]
        return Reduction(Reduction.empty(p1 - 1).add(self.blocks.reshape(-1, p1)).R, int(self.rows.sum()))


def pad(parts: Sequence[Array], rows: Sequence[int] | Index) -> Folded:
    """Blocks of different heights as one array; the taller ones are folded into triangles first."""
    p1 = parts[0].shape[1]
    parts = [part if len(part) <= p1 else Reduction.empty(p1 - 1).add(part).R for part in parts]
    out = np.zeros((len(parts), max(map(len, parts)), p1))
    for block, part in zip(out, parts, strict=True):
        block[:len(part)] = part
    return Folded(out, np.array(rows, dtype=np.intp))


def fold(scene: Scene, terms: Sequence[Term], fold_of: Index, at: tuple[Sequence[Term], Array] | None = None) -> Folded:
    """A scene's whitened design and residual, reduced fold by fold, block of rows by block of rows."""
    count, p1 = int(fold_of.max()) + 1, len(terms) + 1
    rows_of = (np.bincount(fold_of, minlength=count) * scene.components if scene.measured is None
               else np.bincount(fold_of, scene.measured.sum(1), minlength=count).astype(np.intp))
    if len(scene) > BLOCK:
        return pad([reduce_scene(scene.take(fold_of == k), terms, at).R for k in range(count)], rows_of)
    _, columns, residual = next(blocks(scene, terms, at))
    stacked = np.concatenate([columns, residual[None]]).transpose(2, 1, 0)          # (rows, c, p+1)
    return pad([stacked[fold_of == k].reshape(-1, p1) for k in range(count)], rows_of)


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Of one model: beta (K, p) fitted without each fold, held-out sums of squares (K,) in whitened coordinates, and the
    log predictive density (K,) of every fold (Jeffreys prior, multivariate t; methods.md A.4)."""

    without: Array
    held_out: Array
    density: Array
    rows: Index

    @property
    def rms(self) -> float:
        """Root mean square of one whitened coordinate, held out."""
        return float(np.sqrt(self.held_out.sum() / self.rows.sum()))


def cross_validate(folded: Folded, kept: Sequence[int] | None = None, prior: Array | None = None) -> CrossValidation:
    """Exact, from one factorisation. `kept`: the columns to fit (default: those `identify` keeps); `prior`: rows (k, p+1) of
    [columns | response] that belong to no fold. Raises NotEstimable where the model is not estimable without some fold."""
    total = folded.total()
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
        raise NotEstimable(f"without fold {worst + 1} of {len(X)} the model is not estimable: some parameter rests on that "
                           "fold alone. Use more folds or measure more configurations.")
    v = np.linalg.solve(np.eye(len(kept)) - gram, (Q.transpose(0, 2, 1) @ e[:, :, None]))[:, :, 0]
    without = np.zeros((len(X), folded.blocks.shape[2] - 1))
    without[:, kept] = beta - v @ factor.T
    left = e + np.einsum("khr,kr->kh", Q, v)
    quadratic = np.einsum("kh,kh->k", e, left)               # e_kᵀ (I − H_kk)⁻¹ e_k
    return CrossValidation(without, np.square(left).sum(1), _density(gram, quadratic, rss, folded.rows, len(kept)), folded.rows)


def _density(gram: Array, quadratic: Array, rss: float, rows: Index, rank: int) -> Array:
    """log t_{n_k}(y_k | the other folds); −inf where the others leave no degree of freedom."""
    from scipy.special import gammaln
    nu = rows.sum() - rows - rank
    good = nu > 0
    nu = np.where(good, nu, 1).astype(float)
    scale = np.maximum(rss - quadratic, 1e-300) / nu         # s²(-k): RSS(-k) = RSS − e_kᵀ(I−H_kk)⁻¹e_k
    logdet = np.linalg.slogdet(np.eye(gram.shape[1]) - gram)[1] if gram.shape[1] else np.zeros(len(gram))
    out = (gammaln((nu + rows) / 2) - gammaln(nu / 2) - rows / 2 * np.log(nu * np.pi * scale) + logdet / 2
           - (nu + rows) / 2 * np.log1p(quadratic / (nu * scale)))
    return np.where(good, out, -np.inf)


def held_out_residuals(scene: Scene, terms: Sequence[Term], fold_of: Index, without: Array,
                       at: tuple[Sequence[Term], Array] | None = None) -> Array:
    """(m, 3) mm: every row's residual under the fit that has not seen its fold (linear about `at`), not whitened."""
    from dataclasses import replace
    out = np.empty((len(scene), 3))
    for rows, columns, residual in blocks(replace(scene, whiten=1.0), terms, at):
        delta: NDArray[np.float64] = without[fold_of[rows]]
        out[rows] = (residual[:3] - np.einsum("pcm,mp->cm", columns[:, :3], delta)).T
    return out
