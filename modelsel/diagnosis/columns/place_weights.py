"""Weights of places: products of two columns at one place by their causes alone.

A column of one screw is a cause times what a unit screw of its place moves, F_i u_i at row i. The
product of two such columns is Σ_i u_i |F_i|² v_i; where rows share errors, with L⁻¹ what makes a
block of them independent and D the block's F, it is uᵀ(Dᵀ L⁻ᵀ L⁻¹ D)v: a weight for every two rows
of a block, and no components."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..._typing import Array
from ...fitting.shared_errors import Mixing

# numbers of the weights of rows that share errors that are kept
KEPT_NUMBERS = 4_000_000


@dataclass(frozen=True, eq=False)
class PlaceWeights:
    """What the rows of a block weigh at every place.

    fields: (m, f, c) whitened displacement by a unit screw at every place; mixing: what makes rows
    independent that share errors."""

    fields: Array
    mixing: Mixing | None
    _known: dict[int, tuple[Array, ...]] = field(default_factory=dict, repr=False)

    @cached_property
    def squares(self) -> Array:
        """Squared lengths (f, m) of what a unit screw moves each row."""
        squares: Array = np.einsum("mfc,mfc->fm", self.fields, self.fields)
        return squares

    def weigh(self, place: int, values: Array) -> Array:
        """Weigh causes (k, m) of columns at a place."""
        if self.mixing is None:
            return np.asarray(values * self.squares[place])
        weighed = np.empty_like(values)
        weights = self._find_weights(place)
        for rows, weight in zip(self.mixing.rows, weights, strict=True):
            own = values[:, rows]
            by_row = own.transpose(1, 2, 0)
            product = np.matmul(weight, by_row)
            weighed[:, rows] = product.transpose(2, 0, 1)
        return weighed

    def _find_weights(self, place: int) -> tuple[Array, ...]:
        """Find the weights at a place; those of the last places are known."""
        known = self._known
        if place not in known:
            computed = self._compute_weights(place)
            weights = tuple(computed)
            numbers = sum(one.size for one in weights)
            places = len(known) + 1
            if places * numbers > KEPT_NUMBERS:
                known.clear()
            known[place] = weights
        return known[place]

    def _compute_weights(self, place: int) -> Iterator[Array]:
        """Compute the weights (B, k, k) of every two rows of blocks of k rows."""
        assert self.mixing is not None
        moved = self.fields[:, place]
        components = moved.shape[1]
        mixing = self.mixing
        for rows, inverse in zip(mixing.rows, mixing.inverse, strict=True):
            blocks, size = rows.shape
            own = moved[rows]
            by_row = inverse.reshape(blocks, size * components, size, components)
            columns = np.einsum("btsc,bsc->bts", by_row, own)
            across = columns.transpose(0, 2, 1)
            yield np.matmul(across, columns)
