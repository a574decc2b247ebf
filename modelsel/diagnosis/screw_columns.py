"""Columns of screws: what every term moves, as the screw field of its place times its cause.

At row i a screw of unit size moves the measured components by F_i (c,), which depends on its place
alone, and a term moves them by F_i u_i, with the cause u_i. Thousands of candidates share some
forty places, so no column is stored: with w_i = F_i · v_i, the product of a column with a vector v
is Σ_i u_i w_i. Products with many vectors are one matrix product a place, of a third of the work
that the columns themselves would take (a column-wise Khatri-Rao product). The many splines of free
functions are zero at most rows: only their other values are kept."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._typing import Array, Index, Rows
from .._workers import map_in_threads
from ..fitting.design import blocks
from ..fitting.linearisation import Linearisation
from ..fitting.problem import Problem
from ..fitting.shared_errors import Mixing
from ..mechanisms.causes import Bump, Cause
from ..mechanisms.terms import Term
from .kept_causes import KeptCauses, evaluate_everywhere
from .local_causes import LocalCauses
from .place_weights import PlaceWeights
from .screw_places import Place, build_places, find_fields

# rows of one product, which is of full speed with as many, and numbers of the products by place
# that are held together
CACHED_ROWS = 1024
TOGETHER = 1_500_000
EVERY = slice(None)  # all rows of a block
# products of columns, rows and vectors from which a second core pays
MANY_PRODUCTS = 5e7
MOST_TWICE = 64_000_000  # bytes of causes up to which they are kept in single precision, too
# share of the memory of a diagnosis that the values of the causes may take
CAUSES_SHARE = 0.85


@dataclass(frozen=True, eq=False)
class _RowBlock:
    """A block of rows of the problem.

    `fields` (m, f, c): whitened displacement by a unit screw at every place; `coordinates`: its
    slice of all measured coordinates; `measured` (c·m,): which of its components are measured, None
    for all; `local`: the splines among the causes, which are the last of them; `kept` (w, m): the
    others, None where they are evaluated each time. Fields are whitened row by row; where rows share
    errors, the columns are made independent by `mixing`; `weights`: of the rows at every place."""

    problem: Problem
    fields: Array
    coordinates: slice
    measured: Index | None
    wide: tuple[Cause, ...]
    kept: Array | None
    local: LocalCauses
    mixing: Mixing | None
    weights: PlaceWeights

    def evaluate_wide(self, is_single: bool = False) -> NDArray[Any]:
        """Return the causes (w, m) that are not zero at most rows, in single precision if few."""
        if self.kept is None:
            return evaluate_everywhere(self.problem, self.wide)
        is_kept_twice = is_single and self.kept.nbytes <= MOST_TWICE
        return self._single if is_kept_twice else self.kept

    @cached_property
    def _single(self) -> NDArray[np.float32]:
        assert self.kept is not None
        return self.kept.astype(np.float32)

    def evaluate_causes(self, which: Index, rows: Rows = EVERY) -> Array:
        """Return some causes (k, ...) of some rows."""
        count = len(self.fields[rows])
        out = np.empty((len(which), count))
        is_wide = which < len(self.wide)
        numbers = which[is_wide]
        if self.kept is None:
            causes = [self.wide[k] for k in numbers]
            out[is_wide] = evaluate_everywhere(self.problem, causes)[:, rows]
        elif isinstance(rows, slice):
            out[is_wide] = self.kept[numbers, rows]
        else:
            out[is_wide] = self.kept[np.ix_(numbers, rows)]
        local = which[~is_wide] - len(self.wide)
        out[~is_wide] = self.local.expand(local)[:, rows]
        return out

    def split(self) -> Iterator[tuple[Rows, Mixing | None]]:
        """Split the rows into pieces that share nothing with one another, each with what makes its
        rows independent."""
        whole = self.mixing
        count = len(self.fields)
        if whole is None:
            for rows in split_range(count, CACHED_ROWS):
                yield rows, None
            return
        for every, inverse in zip(whole.rows, whole.inverse, strict=True):
            blocks, size = every.shape
            cached_blocks = CACHED_ROWS // size
            for piece in split_range(blocks, cached_blocks):
                own = every[piece]
                places = np.arange(own.size)
                there = places.reshape(own.shape)
                own_inverse = inverse[piece]
                mixing = Mixing((there,), (own_inverse,))
                flat = own.reshape(-1)
                yield flat, mixing

    def arrange(self, values: NDArray[Any]) -> NDArray[Any]:
        """Arrange values (N, B) of all coordinates as (m, c, B) of this block's rows.

        The columns' products with what independent rows hold are those of the columns as they are
        with that, carried back."""
        m, _, c = self.fields.shape
        own = values[self.coordinates]
        if self.measured is not None:
            whole = np.zeros((c * m, values.shape[1]), values.dtype)
            whole[self.measured] = own
            own = whole
        if self.mixing is not None:
            by_vector = np.array(own.reshape(c, m, -1).transpose(2, 0, 1), order="C")
            return self.mixing.apply_transposed(by_vector).transpose(2, 1, 0)
        return own.reshape(c, m, -1).transpose(1, 0, 2)


@dataclass(frozen=True, eq=False)
class ScrewColumns:
    """Whitened columns of C terms at N measured coordinates, by place and cause.

    Coordinates are ordered by block of rows, component, row. `places` are those of causes that are
    not zero at most rows, `local_places` those of the others, `local` (l,). `pairs` (3, n): column,
    field and cause of every screw, ordered by column; `starts` (C+1,): where each column's screws
    begin."""

    count: int
    rows: int
    blocks: tuple[_RowBlock, ...]
    places: tuple[Place, ...]
    local_places: tuple[Place, ...]
    local: tuple[Cause, ...]
    pairs: Index
    starts: Index

    @property
    def size(self) -> int:
        """Count of the columns' numbers."""
        return self.count * self.rows

    def dot(self, values: NDArray[Any]) -> NDArray[Any]:
        """Compute (C, ...) products of every column with values (N + k, ...), in their precision.

        In the k rows of a model's prior the columns are zero. Halves of the rows are summed apart,
        whatever the number of cores."""
        matrix = values.reshape(len(values), -1)
        is_large = self.count * len(self.blocks[0].fields) * matrix.shape[1] > MANY_PRODUCTS
        parts = 2 if is_large else 1
        out = np.zeros((self.count, matrix.shape[1]), matrix.dtype)
        for block in self.blocks:
            causes = block.evaluate_wide(values.dtype == np.float32)
            arranged = block.arrange(matrix)
            halves = list(split_range(len(arranged), -(-len(arranged) // parts)))
            # what is summed apart has a place of its own, but for the first
            totals = [out, *(np.zeros_like(out) for _ in halves[1:])]
            add_up = partial(self._add_up, block, causes, arranged)
            map_in_threads(add_up, list(zip(halves, totals, strict=True)), worth=is_large)
            for total in totals[1:]:
                out += total
            self._add_local(block, arranged, out)
        return out.reshape(self.count, *values.shape[1:])

    def _add_local(self, block: _RowBlock, values: NDArray[Any], out: NDArray[Any]) -> None:
        """Add up the products of local causes over a block with values (m, c, B), to `out` (C, B)."""
        for place in self.local_places:
            field = block.fields[:, place.number].astype(values.dtype, copy=False)
            by_place = np.matmul(field[:, None], values)[:, 0]
            for run in place.runs:
                out[run.columns] += block.local.dot(run.causes, by_place)

    def _add_up(
        self,
        block: _RowBlock,
        causes: NDArray[Any],
        values: NDArray[Any],
        part: tuple[slice, NDArray[Any]],
    ) -> None:
        """Add up the products over some rows of a block with values (m, c, B).

        `part`: the rows, and what the products are added to (C, B)."""
        (first, last), out = (part[0].start, part[0].stop), part[1]
        width = values.shape[2]
        for start in range(first, last, CACHED_ROWS):
            rows = slice(start, min(start + CACHED_ROWS, last))
            fields = block.fields[rows].astype(values.dtype, copy=False)
            own = causes[:, rows].astype(values.dtype, copy=False)
            right = np.ascontiguousarray(values[rows])
            together = TOGETHER // max(len(right) * width, 1)
            for some in split_range(len(self.places), together):
                places = self.places[some]
                by_place = np.matmul(fields[:, [place.number for place in places]], right)
                for k, place in enumerate(places):
                    for run in place.runs:
                        out[run.columns] += own[run.causes] @ by_place[:, k]

    def expand(self, columns: Index) -> Array:
        """Compute some columns (k, N) in full."""
        out = np.zeros((len(columns), self.rows))
        for block in self.blocks:
            m, _, c = block.fields.shape
            own = self._expand_rows(block, columns, EVERY)
            if block.mixing is not None:
                own = block.mixing.apply(own)
            flat = own.reshape(len(columns), c * m)
            out[:, block.coordinates] = flat if block.measured is None else flat[:, block.measured]
        return out

    @cached_property
    def lone_field(self) -> Index:
        """The field (C,) of columns of one screw, -1 of others."""
        is_lone = np.diff(self.starts) == 1
        first = np.minimum(self.starts[:-1], max(len(self.pairs[0]) - 1, 0))
        return np.where(is_lone, self.pairs[1][first], -1)

    def expand_causes(self, columns: Index) -> tuple[Array, Array]:
        """Compute the causes (k, m) of columns of one screw, as they are and weighed.

        Products of the ones with the others are those of columns of one place."""
        pairs = [self._expand_causes(block, columns) for block in self.blocks]
        causes = np.concatenate([own for own, _ in pairs], axis=1)
        return causes, np.concatenate([weighed for _, weighed in pairs], axis=1)

    def _expand_causes(self, block: _RowBlock, columns: Index) -> tuple[Array, Array]:
        _, places, cause = self.pairs[:, self.starts[columns]]
        values = block.evaluate_causes(cause)
        weighed = np.empty_like(values)
        for place in np.unique(places).tolist():
            own = places == place
            weighed[own] = block.weights.weigh(place, values[own])
        return values, weighed

    def gram(self, columns: Index) -> Array:
        """Compute the products (k, k) of some columns, rows by rows.

        Components that are not measured have no part: the field is zero there."""
        total = np.zeros((len(columns), len(columns)))
        fields = self.lone_field[columns]
        if len(columns) and fields[0] >= 0 and (fields == fields[0]).all():
            for block in self.blocks:
                total += self._gram_at_place(block, columns)
            return total
        for block in self.blocks:
            for rows, mixing in block.split():
                X = self._expand_rows(block, columns, rows)
                if mixing is not None:
                    X = mixing.apply(X)
                k, c, m = X.shape
                numbers = c * m
                flat = X.reshape(k, numbers)
                total += flat @ flat.T
        return total

    def _gram_at_place(self, block: _RowBlock, columns: Index) -> Array:
        """Compute the products (k, k) of some columns of one screw at one place over a block."""
        if block.mixing is not None:
            causes, weighed = self._expand_causes(block, columns)
            return np.asarray(causes @ weighed.T)
        _, number, cause = self.pairs[:, self.starts[columns]]
        square = block.weights.squares[number[0]]
        wide = np.flatnonzero(cause < len(block.wide))
        local = np.flatnonzero(cause >= len(block.wide))
        length = np.sqrt(square)
        values = block.evaluate_causes(cause[wide]) * length
        total = np.empty((len(columns), len(columns)))
        total[np.ix_(wide, wide)] = values @ values.T
        which = cause[local] - len(block.wide)
        across = block.local.dot(which, (values * length).T)
        total[np.ix_(local, wide)] = across
        total[np.ix_(wide, local)] = across.T
        total[np.ix_(local, local)] = block.local.gram(which, square)
        return total

    def _expand_rows(self, block: _RowBlock, columns: Index, rows: Rows) -> Array:
        """Compute some columns (k, c, m) at some rows of a block, which still share errors."""
        fields = block.fields[rows]
        m, _, c = fields.shape
        own = np.zeros((len(columns), c, m))
        first, last = self.starts[columns], self.starts[columns + 1]
        most = int((last - first).max(initial=0))
        for step in range(most):
            has = np.flatnonzero(first + step < last)
            _, number, cause = self.pairs[:, first[has] + step]
            moved = fields[:, number].transpose(1, 2, 0)
            values = block.evaluate_causes(cause, rows)
            own[has] += moved * values[:, None]
        return own

    def mean_squares(self, problem: Problem, causes: Iterable[Cause]) -> dict[Cause, float]:
        """Compute the mean square of causes over the rows of the problem."""
        known = (*self.blocks[0].wide, *self.local)
        total = np.zeros(len(known))
        for block in self.blocks:
            values = block.evaluate_wide()
            squares = np.einsum("um,um->u", values, values)
            total += np.concatenate([squares, block.local.sum_squares()])
        out = dict(zip(known, (total / len(problem)).tolist(), strict=True))
        for cause in causes:
            if cause not in out:
                value = np.atleast_1d(cause.of(problem.state))
                out[cause] = float(value @ value) / len(value)
        return out


def split_range(count: int, size: int) -> Iterator[slice]:
    """Split `count` into slices of at most `size`."""
    size = max(size, 1)
    return (slice(start, min(start + size, count)) for start in range(0, count, size))


def build_screw_columns(
    problem: Problem,
    terms: Sequence[Term],
    at: Linearisation | None,
    memory_mb: float,
    known: KeptCauses | None = None,
) -> ScrewColumns:
    """Build the columns of distinct terms at a point of the parameters (None: the nominal one).

    The causes of as many blocks of rows are kept as take no more than their share of `memory_mb`;
    with those that are `known` of other columns at these rows."""
    fields, screws = find_fields(problem, terms)
    causes = dict.fromkeys(cause for own in screws for _, cause in own)
    wide = tuple(cause for cause in causes if not isinstance(cause, Bump))
    known = KeptCauses() if known is None else known
    share_mb = CAUSES_SHARE * memory_mb
    kept_rows = int(share_mb / (8e-6 * max(known.count_with(wide), 1)))
    if kept_rows >= next(problem.blocks()).stop:
        wide = known.add(wide)
    local = tuple(cause for cause in causes if isinstance(cause, Bump))
    number = {cause: k for k, cause in enumerate((*wide, *local))}
    pairs = np.array(
        [(k, f, number[cause]) for k, own in enumerate(screws) for f, cause in own], dtype=np.intp
    ).T.reshape(3, -1)
    starts = np.searchsorted(pairs[0], np.arange(len(terms) + 1))
    row_blocks = tuple(_build_row_blocks(problem, fields, at, wide, local, known, kept_rows))
    is_wide = pairs[2] < len(wide)
    wide_pairs, local_pairs = pairs[:, is_wide], pairs[:, ~is_wide]
    local_pairs[2] -= len(wide)
    return ScrewColumns(
        count=len(terms),
        rows=row_blocks[-1].coordinates.stop,
        blocks=row_blocks,
        places=tuple(build_places(wide_pairs)),
        local_places=tuple(build_places(local_pairs)),
        local=local,
        pairs=pairs,
        starts=starts,
    )


def _build_row_blocks(
    problem: Problem,
    fields: Sequence[Term],
    at: Linearisation | None,
    wide: tuple[Cause, ...],
    local: tuple[Cause, ...],
    known: KeptCauses,
    kept_rows: int,
) -> Iterator[_RowBlock]:
    """Build the blocks of rows; of the first `kept_rows` the causes are kept."""
    start = 0
    whitening = problem.whitening.by_row()
    by_row = replace(problem, whitening=whitening)
    for rows, values, _ in blocks(by_row, fields, at):
        whole = rows.stop - rows.start == len(problem)
        part = problem if whole else problem.take(rows)
        shared = part.whitening.shared
        measured = None
        stop = start + values[0].size
        if problem.measured is not None:
            measured = np.flatnonzero(problem.measured[rows].T.reshape(-1))
            stop = start + len(measured)
        by_place = np.ascontiguousarray(values.transpose(2, 0, 1))
        mixing = None if shared is None else shared.mixing
        yield _RowBlock(
            problem=part,
            fields=by_place,
            coordinates=slice(start, stop),
            measured=measured,
            wide=wide,
            kept=known.evaluate(part, rows) if rows.stop <= kept_rows else None,
            local=LocalCauses.of(part, local),
            mixing=mixing,
            weights=PlaceWeights(by_place, mixing),
        )
        start = stop
