"""Columns of the candidates: whitened changes of the target's position per unit of every term.

Each term's column exists once, however many candidates share it. Rows are ordered block, component,
configuration."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache, partial
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..._linalg import TINY
from ..._typing import Array, Index, Mask
from ...fitting.design import blocks
from ...fitting.linearisation import Linearisation
from ...fitting.problem import Problem
from ...fitting.splines import spline, spline_groups
from ...mechanisms.terms import Mechanism, Term, TermKey
from ..candidates.candidate import Candidate
from ..candidates.options import DEFAULT_OPTIONS
from .kept_causes import KeptCauses
from .row_blocks import split_range
from .screw_columns import ScrewColumns, build_screw_columns
from .screw_places import order_terms

# sizes [mm, rad] beyond which a screw is no error of an arm
LARGEST_SCREW = {"t": 100.0, "r": 0.1}
# norm up to which a column moves nothing: single precision has to hold its inverse
NO_COLUMN = 1e-30
# numbers of candidates' columns that are expanded together for their Gram matrices, and of those
# that are kept for the next question, which mostly concerns the same candidates
EXPANDED_NUMBERS = 1_000_000
KEPT_NUMBERS = 2_000_000
# layouts of columns that are remembered
REMEMBERED = 4


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

    @property
    def key(self) -> tuple[int, bool]:
        """The number of columns, and whether the candidates are free functions."""
        return self.index.shape[1], self.root is not None

    @cached_property
    def unit(self) -> Array:
        """The inverse lengths (n, k) of the columns, 0 for one that moves nothing."""
        norm = np.sqrt(np.maximum(np.einsum("nkk->nk", self.gram), 0))
        return np.where(norm > NO_COLUMN, 1 / np.maximum(norm, NO_COLUMN), 0)

    def take(self, members: Index | Mask) -> Block:
        """Return some of the candidates."""
        return Block(
            which=self.which[members],
            index=self.index[members],
            gram=self.gram[members],
            most=self.most[members],
            root=None if self.root is None else self.root[members],
        )


@dataclass(frozen=True, eq=False)
class Columns:
    """All candidates' whitened columns, with their Gram blocks.

    `screws`: the C columns; `place`: where that of each term is; `slices`: the columns of each
    candidate; `signs`, (k,) for each candidate: the signs that physics allows its terms, 0 for
    either."""

    screws: ScrewColumns
    place: dict[TermKey, int]
    slices: tuple[Index, ...]
    grams: tuple[Block, ...]
    signs: tuple[Array, ...]
    _expanded: dict[int, Array] = field(default_factory=dict, repr=False)

    @property
    def groups(self) -> int:
        """Number of candidates."""
        return len(self.slices)

    @property
    def rows(self) -> int:
        """Number of measured coordinates N."""
        return self.screws.rows

    @cached_property
    def signed(self) -> Index:
        """Candidates (S,) with a term that physics gives a sign."""
        return find_signed(self.signs)

    @cached_property
    def home(self) -> Index:
        """Block and row therein (G, 2) of every candidate."""
        places = np.empty((self.groups, 2), np.intp)
        for number, block in enumerate(self.grams):
            places[block.which, 0] = number
            places[block.which, 1] = np.arange(len(block.which))
        return places

    def largest_terms(self, g: int) -> Array:
        """(k,) largest coefficients of candidate g with which its screws are small."""
        number, row = self.home[g]
        return np.asarray(self.grams[number].most[row])

    def take_gram(self, g: int) -> Array:
        """(k, k) Gram matrix of candidate g's columns."""
        home = self.home
        number, row = home[g]
        block = self.grams[number]
        gram: Array = block.gram[row]
        return gram

    def dot(self, values: NDArray[Any]) -> NDArray[Any]:
        """Compute (C, ...) products of every column with values (N + k, ...).

        In the k rows of a model's prior the columns are zero."""
        return self.screws.dot(values)

    def expand(self, g: int) -> Array:
        """Compute the columns (k, N) of candidate g."""
        known = self._expanded
        if g not in known:
            columns = self.screws.expand(self.slices[g])
            while known and sum(own.size for own in known.values()) + columns.size > KEPT_NUMBERS:
                del known[next(iter(known))]
            known[g] = columns
        return known[g]

    def expand_terms(self, keys: Sequence[TermKey]) -> Array:
        """Compute the columns (k, N) of some terms."""
        places = np.array([self.place[key] for key in keys], dtype=np.intp)
        return self.screws.expand(places)


def find_signed(signs: Sequence[Array]) -> Index:
    """Find the candidates (S,) with a term that physics gives a sign."""
    return np.flatnonzero([own.any() for own in signs])


def build_columns(
    problem: Problem,
    found: Sequence[Candidate],
    at: Linearisation | None = None,
    memory_mb: float = DEFAULT_OPTIONS.memory_mb,
    known: KeptCauses | None = None,
    before: Columns | None = None,
) -> Columns:
    """Build the columns of every candidate at a point of the parameters (None: the nominal one).

    `known`: the causes of other columns at the same rows; `before`: the columns of the first of these
    candidates, at the same point and rows."""
    mechanisms = tuple(candidate.mechanism for candidate in found)
    layout = _lay_out(mechanisms)
    terms = layout.terms
    screws = build_screw_columns(problem, terms, at, memory_mb, known)
    most = _compute_largest(screws, terms, problem)
    blocks_ = tuple(_build_blocks(layout, mechanisms, screws, most, before))
    return Columns(screws, layout.place, layout.slices, blocks_, layout.signs)


class _Layout(NamedTuple):
    """Where the columns of some mechanisms stand, at whatever point and rows: the distinct `terms`,
    and `place`, `slices`, `signs` as in `Columns`; `keys`: the number of every mechanism's columns,
    and whether it is a free function."""

    terms: tuple[Term, ...]
    place: dict[TermKey, int]
    slices: tuple[Index, ...]
    signs: tuple[Array, ...]
    keys: tuple[tuple[int, bool], ...]


@lru_cache(maxsize=REMEMBERED)
def _lay_out(mechanisms: tuple[Mechanism, ...]) -> _Layout:
    """Lay out the columns; the searches of one study mostly ask for the same."""
    terms: dict[TermKey, Term] = {}
    for mechanism in mechanisms:
        for term in mechanism.terms:
            terms.setdefault(term.key, term)
    distinct = order_terms(tuple(terms.values()))
    place = {term.key: k for k, term in enumerate(distinct)}
    slices, signs, keys = [], [], []
    for mechanism in mechanisms:
        own = mechanism.terms
        places = [place[term.key] for term in own]
        slices.append(np.array(places, dtype=np.intp))
        signs.append(np.array(mechanism.signs, dtype=float))
        is_smooth = spline(own[0]) is not None
        keys.append((len(own), is_smooth))
    return _Layout(tuple(distinct), place, tuple(slices), tuple(signs), tuple(keys))


def _build_blocks(
    layout: _Layout,
    mechanisms: Sequence[Mechanism],
    screws: ScrewColumns,
    most: Array,
    before: Columns | None,
) -> Iterator[Block]:
    """Build a block of every number of columns, free functions apart."""
    keys, slices = layout.keys, layout.slices
    known = {} if before is None else {block.key: block for block in before.grams}
    for size, is_smooth in sorted(set(keys)):
        members = [g for g, key in enumerate(keys) if key == (size, is_smooth)]
        which = np.array(members, dtype=np.intp)
        index = np.stack([slices[g] for g in members])
        # candidates that were there before come first, in the same order
        same = known.get((size, is_smooth))
        count = 0 if same is None else len(same.which)
        gram = _compute_grams(screws, index[count:])
        root = None
        if is_smooth:
            norms = np.einsum("nkk->nk", gram)
            own = zip(members[count:], norms, strict=True)
            roots = [_compute_root(mechanisms[g].terms, norm) for g, norm in own]
            root = np.array(roots).reshape(gram.shape)
        if same is not None:
            gram = np.concatenate([same.gram, gram])
            root = None if root is None else np.concatenate([same.root, root])
        yield Block(which=which, index=index, gram=gram, most=most[index], root=root)


def _compute_grams(screws: ScrewColumns, index: Index) -> Array:
    """Compute (n, k, k) Gram matrices of candidates of k columns, `index` (n, k).

    As many are computed at a time as need little memory; a candidate at one place needs only the
    causes of its columns."""
    n, k = index.shape
    grams = np.empty((n, k, k))
    field = screws.lone_field[index]
    at_one_place = (field[:, 0] >= 0) & (field == field[:, :1]).all(1)
    for which, expand in (
        (np.flatnonzero(at_one_place), screws.expand_causes),
        (np.flatnonzero(~at_one_place), partial(_expand_twice, screws)),
    ):
        for piece in split_range(len(which), EXPANDED_NUMBERS // (k * screws.rows)):
            members = which[piece]
            shape = len(members), k, -1
            X, Y = (values.reshape(shape) for values in expand(index[members].ravel()))
            grams[members] = np.matmul(X, Y.swapaxes(1, 2))
    return grams


def _expand_twice(screws: ScrewColumns, columns: Index) -> tuple[Array, Array]:
    """Compute some columns (k, N) in full, for both sides of their products."""
    X = screws.expand(columns)
    return X, X


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


def _compute_largest(screws: ScrewColumns, terms: Sequence[Term], problem: Problem) -> Array:
    """Compute (C,) the largest coefficients with which every screw of a term is small.

    A screw counts with its root mean square over the rows."""
    causes = (screw.cause for term in terms for screw in term.screws)
    mean_square = screws.mean_squares(problem, causes)
    largest = []
    for term in terms:
        limits = []
        for screw in term.screws:
            rms = max(sqrt(mean_square[screw.cause]), TINY)
            limits.append(LARGEST_SCREW[screw.axis[0]] / rms)
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


def stack_design(
    problem: Problem, terms: Sequence[Term], at: Linearisation | None
) -> tuple[Array, Array]:
    """Stack (columns (N, p), residual (N,)), whitened, in the row order of `build_columns`."""
    columns, residuals = [], []
    for rows, values, residual in blocks(problem, terms, at):
        columns.append(flatten_measured(problem, rows, values))
        residuals.append(flatten_measured(problem, rows, residual[None])[0])
    return np.concatenate(columns, axis=1).T, np.concatenate(residuals)
