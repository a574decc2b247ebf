"""Columns of screws: what every term moves, as the screw field of its place times its cause.

At row i a screw of unit size moves the measured components by F_i (c,), which depends on its place
alone, and a term moves them by F_i u_i, with the cause u_i. Thousands of candidates share some
forty places, so no column is stored: with w_i = F_i · v_i, the product of a column with a vector v
is Σ_i u_i w_i. Products with many vectors are one matrix product a place, of a third of the work
that the columns themselves would take (a column-wise Khatri-Rao product). The many splines of free
functions are zero at most rows: only their other values are kept."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._typing import Array, Index, Rows
from ..._workers import map_in_threads
from ...fitting.linearisation import Linearisation
from ...fitting.problem import Problem
from ...mechanisms.causes import Bump, Cause
from ...mechanisms.terms import Term
from .kept_causes import KeptCauses
from .row_blocks import CACHED_ROWS, EVERY, RowBlock, build_row_blocks, split_range
from .screw_places import Place, build_places, find_fields

# numbers of the products by place that are held together
TOGETHER = 1_500_000
# products of columns, rows and vectors from which a second core pays
MANY_PRODUCTS = 5e7
# share of the memory of a diagnosis that the values of the causes may take
CAUSES_SHARE = 0.85


@dataclass(frozen=True, eq=False)
class ScrewColumns:
    """Whitened columns of C terms at N measured coordinates, by place and cause.

    Coordinates are ordered by block of rows, component, row. `places` are those of causes that are
    not zero at most rows, `local_places` those of the others, `local` (l,). `pairs` (3, n): column,
    field and cause of every screw, ordered by column; `starts` (C+1,): where each column's screws
    begin."""

    count: int
    rows: int
    blocks: tuple[RowBlock, ...]
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
            del causes, add_up, arranged, totals  # room for those of the next block
        return out.reshape(self.count, *values.shape[1:])

    def _add_local(self, block: RowBlock, values: NDArray[Any], out: NDArray[Any]) -> None:
        """Add up the products of local causes over a block with values (m, c, B), to `out` (C, B)."""
        for place in self.local_places:
            field = block.fields[:, place.number].astype(values.dtype, copy=False)
            by_place = np.matmul(field[:, None], values)[:, 0]
            for run in place.runs:
                out[run.columns] += block.local.dot(run.causes, by_place)

    def _add_up(
        self,
        block: RowBlock,
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
            right = np.ascontiguousarray(values[rows])
            together = TOGETHER // max(len(right) * width, 1)
            for some in split_range(len(self.places), together):
                places = self.places[some]
                by_place = np.matmul(fields[:, [place.number for place in places]], right)
                for k, place in enumerate(places):
                    for run in place.runs:
                        own = causes[run.causes, rows].astype(values.dtype, copy=False)
                        out[run.columns] += own @ by_place[:, k]

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

    def multiply(self, columns: Index, others: Index) -> Array:
        """Compute the products (k, l) of some columns with others, both of one screw at one place."""
        total = np.zeros((len(columns), len(others)))
        for block in self.blocks:
            _, weighed = self._expand_causes(block, others)
            cause = self.pairs[2, self.starts[columns]]
            is_wide = cause < len(block.wide)
            total[is_wide] += block.evaluate_causes(cause[is_wide]) @ weighed.T
            local = cause[~is_wide] - len(block.wide)
            total[~is_wide] += block.local.dot(local, weighed.T)
        return total

    def expand_causes(self, columns: Index) -> tuple[Array, Array]:
        """Compute the causes (k, m) of columns of one screw, as they are and weighed.

        Products of the ones with the others are those of columns of one place."""
        pairs = [self._expand_causes(block, columns) for block in self.blocks]
        causes = np.concatenate([own for own, _ in pairs], axis=1)
        return causes, np.concatenate([weighed for _, weighed in pairs], axis=1)

    def _expand_causes(self, block: RowBlock, columns: Index) -> tuple[Array, Array]:
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

    def _gram_at_place(self, block: RowBlock, columns: Index) -> Array:
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

    def _expand_rows(self, block: RowBlock, columns: Index, rows: Rows) -> Array:
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
            del values  # room for those of the next block
            total += np.concatenate([squares, block.local.sum_squares()])
        out = dict(zip(known, (total / len(problem)).tolist(), strict=True))
        for cause in causes:
            if cause not in out:
                value = np.atleast_1d(cause.of(problem.state))
                out[cause] = float(value @ value) / len(value)
        return out


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
    row_blocks = tuple(build_row_blocks(problem, fields, at, wide, local, known, kept_rows))
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
