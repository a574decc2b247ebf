"""Blocks of rows of a problem, with the screw fields and the causes there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._typing import Array, Index, Rows
from ...fitting.design import blocks
from ...fitting.linearisation import Linearisation
from ...fitting.problem import Problem
from ...fitting.shared_errors import Mixing
from ...mechanisms.causes import Cause
from ...mechanisms.terms import Term
from .kept_causes import KeptCauses, evaluate_everywhere
from .local_causes import LocalCauses
from .place_weights import PlaceWeights

# rows of one product, which is of full speed with as many
CACHED_ROWS = 1024
EVERY = slice(None)  # all rows of a block
MOST_TWICE = 64_000_000  # bytes of causes up to which they are kept in single precision, too


@dataclass(frozen=True, eq=False)
class RowBlock:
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


def split_range(count: int, size: int) -> Iterator[slice]:
    """Split `count` into slices of at most `size`."""
    size = max(size, 1)
    return (slice(start, min(start + size, count)) for start in range(0, count, size))


def build_row_blocks(
    problem: Problem,
    fields: Sequence[Term],
    at: Linearisation | None,
    wide: tuple[Cause, ...],
    local: tuple[Cause, ...],
    known: KeptCauses,
    kept_rows: int,
) -> Iterator[RowBlock]:
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
        yield RowBlock(
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
