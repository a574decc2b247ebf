"""Columns of the candidates: whitened changes of the target's position per unit of every term.

Each screw's column is evaluated once, however many candidates share it. Rows are ordered block,
component, configuration."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._linalg import TINY
from .._typing import Array, Index
from ..fitting.design import blocks
from ..fitting.linearisation import Linearisation
from ..fitting.problem import Problem
from ..fitting.splines import spline, spline_groups
from ..mechanisms.terms import Mechanism, Term, TermKey
from .candidates import Candidate

# sizes [mm, rad] beyond which a screw is no error of an arm
LARGEST_SCREW = {"t": 100.0, "r": 0.1}
# numbers of candidates' columns that a core's cache holds together with what is made of them
CACHED_NUMBERS = 60_000
# columns up to which the Gram matrices of many candidates are computed together
FEW_COLUMNS = 4


@dataclass(frozen=True, eq=False)
class Block:
    """Candidates of one number of columns k, with what their columns have in common.

    `which` (n,): their indices among all candidates; `index` (n, k): their columns; `gram` (n, k,
    k): their Gram matrices; `most` (n, k): the largest coefficients of small screws; `root` (n, k,
    k), of free functions alone: the root of their coefficients' prior covariance, up to a factor."""

    which: Index
    index: Index
    gram: Array
    most: Array
    root: Array | None = None


@dataclass(frozen=True, eq=False)
class Columns:
    """All candidates' whitened columns, with their Gram blocks.

    `XT` (C, N): the columns, transposed; `slices`: the columns of each candidate; `signs`, (k,) for
    each candidate: the signs that physics allows its terms, 0 for either."""

    XT: Array
    slices: tuple[Index, ...]
    grams: tuple[Block, ...]
    signs: tuple[Array, ...]

    @property
    def groups(self) -> int:
        """Number of candidates."""
        return len(self.slices)

    def largest_terms(self, g: int) -> Array:
        """(k,) largest coefficients of candidate g with which its screws are small."""
        block = next(b for b in self.grams if g in b.which)
        row = int(np.flatnonzero(block.which == g)[0])
        return np.asarray(block.most[row])

    def dot(self, values: Array) -> Array:
        """Compute (C, ...) products of every column with values (N + k, ...).

        In the k rows of a model's prior the columns are zero."""
        rows = self.XT.shape[1]
        return np.asarray(self.XT @ values[:rows])

    def sum_of(self, weights: Array, g: int, rows: int) -> Array:
        """Sum up (rows, ...) candidate g's columns times weights (k, ...).

        The sum is zero in the rows of a model's prior."""
        total = np.zeros((rows, *weights.shape[1:]))
        total[: self.XT.shape[1]] = self.XT[self.slices[g]].T @ weights
        return total


def build_columns(
    problem: Problem, found: Sequence[Candidate], at: Linearisation | None = None
) -> Columns:
    """Build the columns of every candidate at a point of the parameters (None: the nominal one)."""
    mechanisms = [candidate.mechanism for candidate in found]
    terms: dict[TermKey, Term] = {}
    for mechanism in mechanisms:
        for term in mechanism.terms:
            terms.setdefault(term.key, term)
    place = {key: k for k, key in enumerate(terms)}
    slices, signs = [], []
    for mechanism in mechanisms:
        places = [place[term.key] for term in mechanism.terms]
        slices.append(np.array(places, dtype=np.intp))
        signs.append(np.array(mechanism.signs, dtype=float))
    distinct = tuple(terms.values())
    parts = []
    for rows, columns, _ in blocks(problem, distinct, at):
        measured = flatten_measured(problem, rows, columns)
        parts.append(measured)
    XT = parts[0]
    if len(parts) > 1:
        XT = np.concatenate(parts, axis=1)
    most = _compute_largest(problem, distinct)
    grams = _build_blocks(mechanisms, XT, slices, most)
    return Columns(XT=XT, slices=tuple(slices), grams=tuple(grams), signs=tuple(signs))


def _build_blocks(
    mechanisms: Sequence[Mechanism], XT: Array, slices: Sequence[Index], most: Array
) -> Iterator[Block]:
    """Build a block of every number of columns, free functions apart."""
    keys = []
    for columns, mechanism in zip(slices, mechanisms, strict=True):
        first_term = mechanism.terms[0]
        is_smooth = spline(first_term) is not None
        keys.append((len(columns), is_smooth))
    for size, is_smooth in sorted(set(keys)):
        members = [g for g, key in enumerate(keys) if key == (size, is_smooth)]
        which = np.array(members, dtype=np.intp)
        index = np.stack([slices[g] for g in members])
        if size > FEW_COLUMNS:
            gram = np.stack([XT[columns] @ XT[columns].T for columns in index])
        else:
            gram = compute_grams(XT, index)
        root = None
        if is_smooth:
            roots = []
            norms = np.einsum("nkk->nk", gram)
            for g, norm in zip(members, norms, strict=True):
                terms = mechanisms[g].terms
                roots.append(_compute_root(terms, norm))
            root = np.stack(roots)
        yield Block(which=which, index=index, gram=gram, most=most[index], root=root)


def compute_grams(XT: Array, index: Index) -> Array:
    """Compute (n, k, k) Gram matrices of candidates of few columns, `index` (n, k).

    As many are computed at a time as stay in cache."""
    grams = np.empty((*index.shape, index.shape[1]))
    for piece in split_range(len(index), CACHED_NUMBERS // (index.shape[1] * XT.shape[1])):
        X = XT[index[piece]]
        np.einsum("nkr,nlr->nkl", X, X, out=grams[piece])
    return grams


def split_range(count: int, size: int) -> Iterator[slice]:
    """Split `count` into slices of at most `size`."""
    size = max(size, 1)
    return (slice(start, min(start + size, count)) for start in range(0, count, size))


def flatten_measured(problem: Problem, rows: slice, values: NDArray[Any]) -> NDArray[Any]:
    """Flatten values (k, c, rows) to their measured coordinates (k, N)."""
    k, components, count = values.shape
    coordinates = components * count
    every = values.reshape(k, coordinates)
    if problem.measured is None:
        return every
    of_rows = problem.measured[rows]
    is_measured = of_rows.T.reshape(-1)
    return every[:, is_measured]


def _compute_largest(problem: Problem, terms: Sequence[Term]) -> Array:
    """Compute (C,) the largest coefficients with which every screw of a term is small.

    A screw counts with its root mean square over the rows."""
    # by the cause's identity: a hundred places share one
    rms: dict[int, float] = {}
    largest = []
    for term in terms:
        limits = []
        for screw in term.screws:
            cause = screw.cause
            motion = screw.axis[0]
            if id(cause) not in rms:
                value = np.atleast_1d(problem.cause(cause))
                mean_square = float(value @ value) / len(value)
                rms[id(cause)] = max(sqrt(mean_square), TINY)
            limits.append(LARGEST_SCREW[motion] / rms[id(cause)])
        largest.append(min(limits))
    return np.array(largest)


def _compute_root(terms: Sequence[Term], norms: Array) -> Array:
    """Compute (k, k) the root of the prior covariance of a free function's coefficients.

    The places of one mechanism move the target by equal amounts, whatever their units; `norms`
    (k,): squared norms of the columns."""
    count = len(terms)
    whole = np.zeros((count, count))
    for index, root in spline_groups(terms):
        mean_square = float(norms[index].mean())
        size = np.sqrt(max(mean_square, TINY))
        own = np.ix_(index, index)
        whole[own] = root / size
    return whole


def select_columns(cols: Columns, which: Index) -> Columns:
    """Select the columns of some candidates alone, in the order of `which`."""
    selected = [cols.slices[g] for g in which]
    every_column = np.concatenate(selected)
    used, place = np.unique(every_column, return_inverse=True)
    widths = [len(columns) for columns in selected]
    bounds = np.cumsum([0, *widths])
    slices = tuple(place[start:end] for start, end in pairwise(bounds))
    position = {int(g): k for k, g in enumerate(which)}
    grams = []
    for block in cols.grams:
        is_inside = np.isin(block.which, which)
        inside = np.flatnonzero(is_inside)
        if not len(inside):
            continue
        members = [position[g] for g in block.which[inside].tolist()]
        root = None
        if block.root is not None:
            root = block.root[inside]
        grams.append(
            Block(
                which=np.array(members, dtype=np.intp),
                index=np.stack([slices[k] for k in members]),
                gram=block.gram[inside],
                most=block.most[inside],
                root=root,
            )
        )
    return Columns(
        XT=cols.XT[used],
        slices=slices,
        grams=tuple(grams),
        signs=tuple(cols.signs[g] for g in which),
    )


def stack_design(
    problem: Problem, terms: Sequence[Term], at: Linearisation | None
) -> tuple[Array, Array]:
    """Stack (columns (N, p), residual (N,)), whitened, in the row order of `build_columns`."""
    columns, residuals = [], []
    for rows, values, residual in blocks(problem, terms, at):
        columns.append(flatten_measured(problem, rows, values))
        residuals.append(flatten_measured(problem, rows, residual[None])[0])
    return np.concatenate(columns, axis=1).T, np.concatenate(residuals)
