"""Second moments of a fitted model's rows, fold by fold, in orthonormal coordinates.

With F the fit's factor, Q = X F has orthonormal columns over the rows of the data and of the prior
together. The products [Q | e]ᵀ[Q | e] of a fold, e the residual, are all that cross-validation,
leaving terms out and half-samples ask of its rows. They cost one matrix product; the conditioning
of X does not enter."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .._typing import Array, Index
from ..exceptions import NotEstimable
from ..fitting.design import assemble
from ..fitting.least_squares import Fit
from ..fitting.linearisation import Linearisation
from ..fitting.problem import BLOCK, Problem
from ..mechanisms.terms import Term

# numbers of a design that are kept for a second pass (32 MB)
MAX_KEPT = 4_000_000
# 1 − largest eigenvalue of Q_kᵀQ_k below which the model is not estimable without the fold
DEPENDENT = 1e-9
# a margin above it, of which a Cholesky factor tells without eigenvalues
CLEARLY_ESTIMABLE = 1e-6


@dataclass(frozen=True, eq=False)
class LinearRows:
    """The rows of a problem [columns | residual], linear about a point, in mm and rad.

    They are made block by block whenever they are asked for; few are kept."""

    problem: Problem
    terms: Sequence[Term]
    at: Linearisation | None = None

    def parts(self) -> Iterator[tuple[slice, Problem, Array]]:
        """Yield (rows, their problem, block (p+1, c, rows))."""
        numbers = len(self.problem) * self.problem.components * (len(self.terms) + 1)
        yield from self._kept if numbers <= MAX_KEPT else self._make()

    @cached_property
    def _kept(self) -> list[tuple[slice, Problem, Array]]:
        return list(self._make())

    def _make(self) -> Iterator[tuple[slice, Problem, Array]]:
        for rows, part in self.problem.parts():
            yield rows, part, assemble(part, self.terms, self.at)

    def held_out(self, fold_of: Index, without: Array) -> Array:
        """Compute every row's residual (m, 3) [mm] under the fit without its fold.

        `without` (K, p): the coefficients fitted without each fold."""
        residual = np.empty((len(self.problem), 3))
        for rows, _, block in self.parts():
            residual[rows] = hold_out(block, fold_of[rows], without)
        return residual


def hold_out(block: Array, fold_of: Index, without: Array) -> Array:
    """Compute the residuals (m, 3) [mm] of a block (p+1, c, m) under the fits without its rows'
    folds; `without` (K, p)."""
    delta = np.ascontiguousarray(without.T)[:, fold_of]
    predicted = np.einsum("pcm,pm->cm", block[:-1, :3], delta)
    return np.asarray((block[-1, :3] - predicted).T)


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Orthonormal coordinates of a linear model of p columns, of which r are fitted.

    kept: the fitted columns.
    factor: (r, r) with Q = X factor.
    projection: (r,) Qᵀ y over data and prior; prior: (k, r) the prior's rows of Q.
    prior_left: (k,) what the fit leaves of the prior's response.
    rss: sum of squares that the fit leaves of data and prior.
    """

    p: int
    kept: tuple[int, ...]
    factor: Array
    projection: Array
    prior: Array
    prior_left: Array
    rss: float

    @staticmethod
    def of(fitted: Fit) -> Coordinates:
        """Return the coordinates of a fit, linear about its solution.

        Each points against its column, so that draws in these coordinates do not depend on the signs
        that a factorisation happened to choose."""
        kept = list(fitted.found.kept)
        factor = fitted.factor[kept]
        factor = -factor * np.sign(np.diagonal(factor))
        triangle = fitted.reduction.R
        data = triangle[:, kept] @ factor
        root = fitted.root
        prior = root[:, kept] @ factor
        response = triangle[:, -1]
        prior_response = -root @ fitted.theta
        projection = data.T @ response + prior.T @ prior_response
        left = response - data @ projection
        prior_left = prior_response - prior @ projection
        rss = float(left @ left + prior_left @ prior_left)
        return Coordinates(
            fitted.reduction.p, tuple(kept), factor, projection, prior, prior_left, rss
        )

    @property
    def rank(self) -> int:
        """Number of coordinates."""
        return len(self.kept)

    @cached_property
    def map(self) -> Array:
        """Matrix (p+1, r+1) that turns [columns | response] into [Q | residual]."""
        columns = list(self.kept)
        out = np.zeros((self.p + 1, self.rank + 1))
        out[columns, :-1] = self.factor
        out[columns, -1] = -self.factor @ self.projection
        out[-1, -1] = 1.0
        return out

    def coefficients(self, change: Array) -> Array:
        """Return the coefficients (..., p) at a change (..., r) of the solution's coordinates."""
        out = np.zeros((*change.shape[:-1], self.p))
        out[..., list(self.kept)] = (self.projection + change) @ self.factor.T
        return out


@dataclass(frozen=True, eq=False)
class Moments:
    """Products of [Q | e], e the residual, over the rows of every fold.

    gram: (K, r, r) QᵀQ; score: (K, r) Qᵀe; square: (K,) eᵀe.
    """

    gram: Array
    score: Array
    square: Array

    @staticmethod
    def of(products: Array) -> Moments:
        """Return the moments of products (K, r+1, r+1)."""
        return Moments(products[:, :-1, :-1], products[:, :-1, -1], products[:, -1, -1])

    def moved(self, change: Array) -> Array:
        """Compute the sums of squares (K,) of the rows once the coordinates changed by (K, r) or
        (r,)."""
        predicted = (self.gram @ change[..., None])[..., 0]
        return np.asarray(self.square + ((predicted - 2 * self.score) * change).sum(1))

    def reduced(self, directions: Array, change: Array) -> Moments:
        """Return the moments without some orthonormal directions (r, s) of Q, after a change (r,)
        along these."""
        score = self.score - self.gram @ change
        along = self.gram @ directions
        inside = directions.T @ along
        gram = self.gram - along @ directions.T - directions @ along.transpose(0, 2, 1)
        gram += directions @ inside @ directions.T
        return Moments(gram, score - (score @ directions) @ directions.T, self.moved(change))

    def shift(self) -> Array:
        """Compute the change (K, r) of the coordinates when each fold is left out.

        Raises NotEstimable where the model is not estimable without some fold."""
        check_estimable(self.gram)
        remaining = np.eye(self.gram.shape[1]) - self.gram
        solved = np.linalg.solve(remaining, self.score[:, :, None])
        return -np.asarray(solved[:, :, 0])


def check_estimable(gram: Array) -> None:
    """Raise NotEstimable where a fold's QᵀQ (K, r, r) has an eigenvalue of one: a direction that
    rests on that fold alone."""
    if not gram.shape[1]:
        return
    clear = (1 - CLEARLY_ESTIMABLE) * np.eye(gram.shape[1])
    try:
        np.linalg.cholesky(clear - gram)
        return
    except np.linalg.LinAlgError:
        gap = 1 - np.linalg.eigvalsh(gram)[:, -1]
    if gap.min() < DEPENDENT:
        worst = int(gap.argmin())
        raise NotEstimable(
            f"without fold {worst + 1} of {len(gram)} the model is not estimable: some parameter "
            "rests on that fold alone. Use more folds or measure more configurations."
        )


def leave_out(coordinates: Coordinates, theta: Array, terms: Sequence[int]) -> tuple[Array, Array]:
    """Return the directions (r, s) of Q that some fitted terms alone span, and the change (r,) of
    the solution at theta (p,) without these terms."""
    places = [coordinates.kept.index(k) for k in terms]
    directions, root = np.linalg.qr(coordinates.factor[places].T)
    along = directions.T @ coordinates.projection
    if places:
        along = along + np.linalg.solve(root.T, theta[list(terms)])
    return directions, -directions @ along


def measure_moments(
    rows: LinearRows,
    coordinates: Coordinates,
    fold_of: Index,
    weighted: bool = True,
    components: int | None = None,
) -> Moments:
    """Sum the moments of every fold (m,) over the rows; unless `weighted`, in mm and rad.

    `components`: how many of every row's numbers count (None: all)."""
    width = coordinates.rank + 1
    products = np.zeros((int(fold_of.max()) + 1, width, width))
    for places, part, block in rows.parts():
        values = transform(block, coordinates.map)
        if weighted:
            values = part.whitening.apply(values)
        add_products(products, values[:, :components], fold_of[places])
    return Moments.of(products)


def measure_fit(rows: LinearRows, fitted: Fit, coordinates: Coordinates, fold_of: Index) -> Moments:
    """Sum the moments of every fold (m,) of the rows that were fitted; where these were reduced fold
    by fold, they are not made again."""
    parts = fitted.reduction.parts
    if not parts:
        return measure_moments(rows, coordinates, fold_of)
    turned = np.stack([part.R @ coordinates.map for part in parts])
    return Moments.of(turned.transpose(0, 2, 1) @ turned)


def transform(block: Array, columns: Array) -> Array:
    """Combine a block's columns (p+1, c, rows) by a matrix (p+1, r+1): (r+1, c, rows)."""
    flat = columns.T @ block.reshape(len(block), -1)
    return np.asarray(flat.reshape(-1, *block.shape[1:]))


def add_products(products: Array, values: Array, fold_of: Index) -> None:
    """Add the products of values (r+1, c, rows) to those (K, r+1, r+1) of their rows' folds."""
    for k in np.unique(fold_of):
        own = fold_of == k
        chosen = values if own.all() else values[:, :, own]
        flat = chosen.reshape(len(values), -1)
        products[k] += flat @ flat.T


def rows_by_unit(
    problem: Problem, fitted: Fit, coordinates: Coordinates, unit: Index
) -> tuple[Array, Index]:
    """Return rows (N, r+1) of [Q | e] and their units (N,), in order of the units (m,).

    A unit of more than r+1 rows is reduced to as many, of the same products; the design is made for
    some units at a time."""
    width = coordinates.rank + 1
    order = np.argsort(unit, kind="stable")
    edges = np.searchsorted(unit[order], np.arange(int(unit.max()) + 2))
    rows: list[Array] = []
    units: list[Index] = []
    first = 0
    while first < len(edges) - 1:
        fitting = int(np.searchsorted(edges, edges[first] + BLOCK, side="right")) - 1
        last = max(fitting, first + 1)
        part = problem.take(order[edges[first] : edges[last]])
        block = assemble(part, fitted.terms, fitted.at())
        values = transform(block, coordinates.map)
        values = part.whitening.apply(values).transpose(2, 1, 0)
        for k in range(first, last):
            start, stop = edges[k : k + 2] - edges[first]
            own = values[start:stop].reshape(-1, width)
            if len(own) > width:
                own = np.asarray(np.linalg.qr(own, mode="r"))
            rows.append(own)
            units.append(np.full(len(own), k))
        first = last
    return np.concatenate(rows), np.concatenate(units)
