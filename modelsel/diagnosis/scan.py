"""The scan: how much of a residual every candidate explains beyond the fitted model, and what
chance alone would explain.

With Q an orthonormal basis of the fitted model and X_g a candidate's columns, everything needed is
X_gᵀX_g, X_gᵀQ and X_gᵀr: the projected Gram is X_gᵀX_g − (X_gᵀQ)(X_gᵀQ)ᵀ, and no projected column
is ever stored."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._typing import Array, Index
from ..fitting.design import blocks
from ..fitting.linearisation import Linearisation
from ..fitting.problem import Problem
from ..fitting.splines import spline, spline_groups
from ..mechanisms.terms import Term
from .candidates import Candidate
from .sign_constraints import Sides, build_sides, least

ABSORBED = (
    1e-5  # share of a direction's squared norm that must be left beyond the model for it to count
)
SMALL = {
    "t": 100.0,
    "r": 0.1,
}  # mm, rad: an error screw is small; what would have to be larger is not the cause
SOLID = 1e-3  # weight from which a smooth function's direction shows in its size
CACHED = 60_000  # numbers that a core's cache holds beside what is made of them
# prior size of a smooth function's direction, against its largest, below which it does not count
FAINT_WEIGHT = 1e-7


@dataclass(frozen=True, eq=False)
class Block:
    """Candidates of one size k: `which` (n,), their columns `index` (n, k), their `gram` (n, k, k),
    the largest coefficients of small screws `most` (n, k); of free functions also the `root` (n, k,
    k) of their coefficients' prior covariance, to scale."""

    which: Index
    index: Index
    gram: Array
    most: Array
    root: Array | None = None


@dataclass(frozen=True, eq=False)
class Bucket:
    """A block beyond the model: its Gram `left` there, and W (n, k, k) with Z_gᵀr = W X_gᵀr, Z_g
    orthonormal; `weights` (n, k): prior variances of a free function's directions, the largest 1;
    None where all are alike."""

    block: Block
    left: Array
    W: Array
    weights: Array | None


class Strength(NamedTuple):
    """What responses (N, B) have in common with every candidate: |Z_gᵀr|² (G, B); of those with a
    sign (S, B) the fitted term that is least of that sign, times the sign and over its standard
    error at unit noise; of the free functions (F, K, B) every direction alone, squared, nought
    beyond a function's own."""

    whole: Array
    root: Array
    smooth: Array


@dataclass(frozen=True, eq=False)
class Columns:
    """All candidates' whitened columns, transposed (C, N), where each candidate's stand, their Gram
    blocks, and the signs (k,) that physics allows each candidate's terms, nought for either."""

    XT: Array
    slices: tuple[Index, ...]
    grams: tuple[Block, ...]
    signs: tuple[Array, ...]

    @property
    def groups(self) -> int:
        """Number of candidates."""
        return len(self.slices)

    def dot(self, values: Array) -> Array:
        """(C, ...) products of every column with values (N + k, ...): in the k rows of a model's
        prior the columns are nought."""
        return np.asarray(self.XT @ values[: self.XT.shape[1]])

    def sum_of(self, weights: Array, g: int, rows: int) -> Array:
        """(rows, ...) candidate g's columns times weights (k, ...), nought in the rows of a model's
        prior."""
        out = np.zeros((rows, *weights.shape[1:]))
        out[: self.XT.shape[1]] = self.XT[self.slices[g]].T @ weights
        return out


def columns(
    problem: Problem, found: Sequence[Candidate], at: Linearisation | None = None
) -> Columns:
    """Columns of every candidate, each screw's evaluated once. Rows are ordered block, component,
    configuration."""
    terms: dict[tuple[object, ...], Term] = {}
    for candidate in found:
        for t in candidate.mechanism.terms:
            terms.setdefault(t.key, t)
    place = {screws: k for k, screws in enumerate(terms)}
    slices = [np.array([place[t.key] for t in c.mechanism.terms], dtype=np.intp) for c in found]
    parts = [flat(problem, rows, c) for rows, c, _ in blocks(problem, tuple(terms.values()), at)]
    XT = parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)
    rms: dict[int, float] = {}  # by the cause's identity: a hundred places share one
    most = np.array([_most(problem, t, rms) for t in terms.values()])
    soft = np.array([spline(c.mechanism.terms[0]) is not None for c in found])
    grams = []
    for size, smooth in sorted({(len(s), bool(w)) for s, w in zip(slices, soft, strict=True)}):
        which = np.array(
            [g for g, s in enumerate(slices) if len(s) == size and soft[g] == smooth], dtype=np.intp
        )
        index = np.stack([slices[g] for g in which])
        gram = np.stack([XT[i] @ XT[i].T for i in index]) if size > 4 else grams_of(XT, index)
        roots = (
            [_root(found[g].mechanism.terms, np.diag(G)) for g, G in zip(which, gram, strict=True)]
            if smooth
            else None
        )
        grams.append(
            Block(which, index, gram, most[index], None if roots is None else np.stack(roots))
        )
    return Columns(
        XT,
        tuple(slices),
        tuple(grams),
        tuple(np.array(c.mechanism.signs, dtype=float) for c in found),
    )


def grams_of(XT: Array, index: Index) -> Array:
    """(n, k, k) products of the columns `index` (n, k) of few-column candidates, some at a time:
    they stay in cache."""
    out = np.empty((*index.shape, index.shape[1]))
    for some in pieces(len(index), CACHED // (index.shape[1] * XT.shape[1])):
        X = XT[index[some]]
        np.einsum("nkr,nlr->nkl", X, X, out=out[some])
    return out


def pieces(count: int, size: int) -> Iterator[slice]:
    """Slices of at most `size` that cover `count`."""
    size = max(size, 1)
    return (slice(start, min(start + size, count)) for start in range(0, count, size))


def flat(problem: Problem, rows: slice, values: NDArray[Any]) -> NDArray[Any]:
    """(k, N) measured coordinates of values (k, c, rows)."""
    every = values.reshape(len(values), values.shape[1] * values.shape[2])  # of no columns, too
    return problem.select_measured(every, rows)


def _most(problem: Problem, term: Term, rms: dict[int, float]) -> float:
    """Largest coefficient with which every screw of a term is small, root mean square over the
    rows; `rms` remembers."""
    for s in term.screws:
        if id(s.cause) not in rms:
            value = np.atleast_1d(problem.cause(s.cause))
            rms[id(s.cause)] = max(sqrt(float(value @ value) / len(value)), 1e-300)
    return min(SMALL[s.axis[0]] / rms[id(s.cause)] for s in term.screws)


def _root(terms: Sequence[Term], norms: Array) -> Array:
    """(k, k) root of the prior covariance of a free function's coefficients; places of one
    mechanism move the target alike far, whatever their units."""
    out = np.zeros((len(terms), len(terms)))
    for index, root in spline_groups(terms):
        out[np.ix_(index, index)] = root / np.sqrt(max(float(norms[index].mean()), 1e-300))
    return out


def subset(cols: Columns, which: Index) -> Columns:
    """The columns of some candidates alone, in the order of `which`."""
    used, place = np.unique(np.concatenate([cols.slices[g] for g in which]), return_inverse=True)
    bounds = np.cumsum([0, *(len(cols.slices[g]) for g in which)])
    position = {int(g): k for k, g in enumerate(which)}
    grams = []
    for block in cols.grams:
        inside = np.flatnonzero(np.isin(block.which, which))
        if len(inside):
            own = np.array([position[int(g)] for g in block.which[inside]], dtype=np.intp)
            index = np.stack([place[bounds[k] : bounds[k + 1]] for k in own])
            grams.append(
                Block(
                    own,
                    index,
                    block.gram[inside],
                    block.most[inside],
                    None if block.root is None else block.root[inside],
                )
            )
    slices = tuple(place[a:b] for a, b in pairwise(bounds))
    return Columns(cols.XT[used], slices, tuple(grams), tuple(cols.signs[g] for g in which))


def stacked(
    problem: Problem, terms: Sequence[Term], at: Linearisation | None
) -> tuple[Array, Array]:
    """(columns (N, p), residual (N,)) whitened, in the row order of `columns`."""
    parts = [
        (flat(problem, rows, c), flat(problem, rows, r[None])[0])
        for rows, c, r in blocks(problem, terms, at)
    ]
    return np.concatenate([c for c, _ in parts], axis=1).T, np.concatenate([r for _, r in parts])


def compute_basis(matrix: Array) -> Array:
    """Orthonormal basis (N, r) of the columns of (N, p), rank by pivoted QR on unit columns."""
    from scipy.linalg import qr

    size = np.linalg.norm(matrix, axis=0)
    unit = matrix[:, size > 1e-13 * size.max(initial=0)] / size[size > 1e-13 * size.max(initial=0)]
    if not unit.shape[1]:
        return np.zeros((len(matrix), 0))
    Q, R, _ = qr(unit, mode="economic", pivoting=True)
    return np.asarray(Q[:, : int((np.abs(np.diag(R)) > 1e-10).sum())])


@dataclass(frozen=True, eq=False)
class Scan:
    """The candidates seen from one fitted model: Z_g bases, effective sizes k (G,), `freedom` N −
    r; Q (N, ·) spans the model (its columns need not be orthonormal after directions were given
    back: Q Qᵀ still projects). A model with shrunk terms has its prior's rows below the data's:
    what is beyond it is then weighed as if those terms were integrated out."""

    columns: Columns
    Q: Array
    buckets: tuple[Bucket, ...]
    sizes: Array
    freedom: int

    @cached_property
    def smooth(self) -> tuple[Index, Array]:
        """The free functions (F,) and the weights (F, K) of their directions, nought beyond a
        function's own."""
        some = [(b.block.which, b.weights) for b in self.buckets if b.weights is not None]
        weights = np.zeros(
            (sum(len(which) for which, _ in some), max((w.shape[1] for _, w in some), default=0))
        )
        at = 0
        for which, w in some:
            weights[at : at + len(which), : w.shape[1]] = w
            at += len(which)
        return np.concatenate([np.zeros(0, np.intp), *(which for which, _ in some)]), weights

    @cached_property
    def signed(self) -> Index:
        """Candidates with a term that physics gives a sign."""
        return np.flatnonzero([own.any() for own in self.columns.signs])

    @cached_property
    def sides(self) -> tuple[Sides, ...]:
        """Of every bucket, how the terms with a sign follow from its Zᵀr."""
        return tuple(
            build_sides(b.block.which, b.W, self.columns.signs, self.signed) for b in self.buckets
        )

    def strength(self, response: Array) -> Strength:
        """What responses (N, B) have in common with every candidate."""
        s = self.columns.dot(response)
        return self.gather([np.matmul(bucket.W, s[bucket.block.index]) for bucket in self.buckets])

    def judged(self, response: Array) -> tuple[Strength, NDArray[np.bool_]]:
        """The same of one response (N,), and whether (G,) it asks for small screws only: a joint
        that turns about its own target would have to turn by radians to explain a tenth of a
        millimetre, and is not its cause."""
        s, small, products = self.columns.dot(response[:, None]), np.ones(len(self.sizes), bool), []
        for b in self.buckets:
            products.append(np.matmul(b.W, s[b.block.index]))
            z = (
                products[-1]
                if b.weights is None
                else np.where(b.weights[:, :, None] > SOLID, products[-1], 0.0)
            )
            small[b.block.which] = (
                np.abs(np.matmul(b.W.swapaxes(1, 2), z)[:, :, 0]) < b.block.most
            ).all(1)
        return self.gather(products), small

    def gather(self, products: Sequence[Array]) -> Strength:
        """The same from every bucket's Z_gᵀr (n, k, B), in their precision; they are
        overwritten."""
        kind, draws = (
            (products[0].dtype, products[0].shape[2]) if products else (np.dtype(float), 0)
        )
        whole: Array = np.zeros((len(self.sizes), draws), kind)
        root: Array = np.zeros((len(self.signed), draws), kind)
        smooth, at = np.zeros((*self.smooth[1].shape, draws), kind), 0
        for bucket, z, side in zip(self.buckets, products, self.sides, strict=True):
            which, k = bucket.block.which, z.shape[1]
            root[side.signed] = least(z, side)
            np.square(z, out=z)
            whole[which] = z[:, 0] if k == 1 else z.sum(1)
            if bucket.weights is not None:
                smooth[at : at + len(which), :k] = z
                at += len(which)
        return Strength(whole, root, smooth)


def scan(cols: Columns, Q: Array) -> Scan:
    """Project every candidate off the model's basis Q (N, r)."""
    A = cols.dot(Q)
    lefts = [b.gram - np.matmul(A[b.index], A[b.index].swapaxes(1, 2)) for b in cols.grams]
    return _scan(cols, Q, lefts)


def build_scan_without(seen: Scan, D: Array) -> Scan:
    """The scan from a smaller model, whose basis lacks the directions D (N, d) of `seen.Q`'s span:
    they are given back."""
    A = seen.columns.dot(D)
    lefts = [
        b.left + np.matmul(A[b.block.index], A[b.block.index].swapaxes(1, 2)) for b in seen.buckets
    ]
    return _scan(seen.columns, seen.Q - D @ (D.T @ seen.Q), lefts, seen.freedom + D.shape[1])


def _scan(cols: Columns, Q: Array, lefts: Sequence[Array], freedom: int | None = None) -> Scan:
    buckets, sizes = [], np.zeros(cols.groups)
    for block, left in zip(cols.grams, lefts, strict=True):
        norm = np.sqrt(np.maximum(np.einsum("nkk->nk", block.gram), 1e-300))
        value, vector = np.linalg.eigh(left / norm[:, :, None] / norm[:, None, :])
        good = value > ABSORBED * (1 if block.gram.shape[1] <= 4 else 1e1)
        sizes[block.which] = good.sum(1)
        W = _whitener(value, vector, good) / norm[:, None, :]
        weights = None
        if (
            block.root is not None
        ):  # the directions that a smooth function's prior and these data keep apart
            half = np.matmul(
                W, np.matmul(left, block.root)
            )  # (Zᵀ X) L: what the prior makes of every direction
            value, vector = np.linalg.eigh(np.matmul(half, half.swapaxes(1, 2)))
            W = np.matmul(vector.swapaxes(1, 2), W)
            top = np.maximum(value.max(1, keepdims=True), 1e-300)
            weights = np.where(value > FAINT_WEIGHT * top, value / top, 0.0)
        buckets.append(Bucket(block, left, W, weights))
    return Scan(
        cols, Q, tuple(buckets), sizes, Q.shape[0] - Q.shape[1] if freedom is None else freedom
    )


def _whitener(value: Array, vector: Array, good: NDArray[np.bool_]) -> Array:
    """(n, k, k) rows 1/sqrt(value) · vectorᵀ of the good directions, noughts for the others."""
    return np.where(good, 1 / np.sqrt(np.where(good, value, 1)), 0)[:, :, None] * vector.swapaxes(
        1, 2
    )
