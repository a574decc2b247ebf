"""The sum of squares of a model, expanded to second order about a point.

Steps towards the minimum, and what the data determine, are computed from it. Both are needed
repeatedly, with different priors: the parameters that have a usual size stand last in the
factorisation, so that a prior on them changes the end of the triangle alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .._typing import Array
from .gradient import Slope
from .prior import Seen, Shrinkage, WeakPrior
from .reduction import Reduction

# smallest squared share of a column beyond the others at which the products still determine it to
# eight digits
SAFE = 1e-8
BLUR = 1e-7  # of a unit column: smaller parts are lost in products
SHARP = 3e-4  # of the noise: rounding below it changes the prior by 1e-8
VANISHING = 1e-14  # of the products of unit columns: rounding


class Unsafe(ArithmeticError):
    """Columns so nearly dependent that products cannot separate them."""


@dataclass(frozen=True, eq=False)
class Expansion:
    """The squares about theta (p,): the products `gram` (p, p) of the columns, and the gradient.

    `reduction`: of the rows at theta, if it was computed; `free`: the reduction of the terms without a
    prior variance."""

    theta: Array
    gram: Array
    slope: Slope
    reduction: Reduction | None = None
    free: Reduction | None = None

    @staticmethod
    def of_reduction(
        theta: Array, reduction: Reduction, free: Reduction | None = None
    ) -> Expansion:
        """Expand from a reduction at theta."""
        R = reduction.R
        return Expansion.of_products(theta, R.T @ R, reduction, free)

    @staticmethod
    def of_products(
        theta: Array,
        products: Array,
        reduction: Reduction | None = None,
        free: Reduction | None = None,
    ) -> Expansion:
        """Expand from the products (p+1, p+1) of [columns | residual] at theta."""
        squares: float = products[-1, -1].item()
        slope = Slope(squares, products[:-1, -1])
        return Expansion(theta, products[:-1, :-1], slope, reduction, free)

    @cached_property
    def response(self) -> Array:
        """Products (p,) of the columns with the residual at zero parameters, to first order."""
        return np.asarray(self.slope.products + self.gram @ self.theta)

    def slope_at(self, theta: Array) -> Slope:
        """Return the gradient of the expanded squares at theta (p,)."""
        change = theta - self.theta
        moved = self.gram @ change
        squares = self.slope.squares + float(change @ (moved - 2 * self.slope.products))
        return Slope(squares, self.slope.products - moved)

    def distance(self, theta: Array) -> float:
        """Length of the whitened change of all rows from the point of expansion to theta (p,)."""
        change = theta - self.theta
        square = float(change @ self.gram @ change)
        return float(np.sqrt(max(square, 0.0)))

    def reduction_at(self, theta: Array) -> Reduction:
        """Return the reduction, shifted to theta (p,) nearby."""
        assert self.reduction is not None
        return self.reduction.shift(theta - self.theta)

    def triangle(
        self, others: Sequence[int], sized: Sequence[int], shrinkage: Shrinkage
    ) -> Triangle:
        """Factorise the products of some columns and a prior, from the reduction where there is one.

        Raises Unsafe where there is none and the products are too inaccurate."""
        order = [*others, *sized]
        if self.reduction is not None:
            return self._reduced(order, len(others), shrinkage.rows)
        gram = (self.gram + shrinkage.gram)[np.ix_(order, order)]
        norm = np.sqrt(np.diagonal(gram))
        norm = np.where(norm > 0, norm, 1.0)
        last = slice(len(others), None)
        unit = gram / norm / norm[:, None]
        top, said = _eliminate(unit, self.response[order] / norm, len(others))
        root_of_rest, response = _root(unit[last, last] - top[:, last].T @ top[:, last], said)
        top = top * norm
        rest = root_of_rest * norm[last]
        seen = Seen(sized, rest, response)
        return Triangle(tuple(order), top, seen, BLUR * norm[last])

    def _reduced(self, order: Sequence[int], first: int, root: Array) -> Triangle:
        """Compute `triangle` from the reduction."""
        assert self.reduction is not None
        R = self.reduction.R
        response = R[:, -1] + R[:, :-1] @ self.theta
        data = np.column_stack([R[:, order], response])
        prior = np.column_stack([root[:, order], np.zeros(len(root))])
        T: Array = np.asarray(np.linalg.qr(np.vstack([data, prior]), mode="r"))
        end = len(order)
        seen = Seen(order[first:], T[first:end, first:end], T[first:end, end])
        return Triangle(tuple(order), T[:first, :end], seen, np.zeros(end - first))


def _eliminate(unit: Array, response: Array, first: int) -> tuple[Array, Array]:
    """Eliminate the first columns of unit products (k, k).

    Returns the top rows (first, k) of the triangle, and the response (k - first,) of the other columns
    beyond these. Raises Unsafe where the first columns are nearly dependent."""
    from scipy.linalg import solve_triangular

    if not first:
        return np.zeros((0, len(unit))), response
    try:
        L = np.linalg.cholesky(unit[:first, :first])
    except np.linalg.LinAlgError:
        raise Unsafe from None
    if np.square(np.diagonal(L)).min() < SAFE:
        raise Unsafe
    right = np.column_stack([unit[:first, first:], response[:first]])
    solved = solve_triangular(L, right, lower=True, check_finite=False)
    top = np.concatenate([L.T, solved[:, :-1]], axis=1)
    return top, response[first:] - solved[:, :-1].T @ solved[:, -1]


def _root(products: Array, response: Array) -> tuple[Array, Array]:
    """Compute a root (k, k) of products, and the response (k,) in its rows."""
    values, vectors = np.linalg.eigh(products)
    values = np.where(values > VANISHING, values, 0.0)
    size = np.sqrt(values)
    turned = vectors.T @ response
    in_rows = np.divide(turned, size, out=np.zeros_like(turned), where=size > 0)
    return size[:, None] * vectors.T, in_rows


@dataclass(frozen=True, eq=False)
class Triangle:
    """Triangular factor of a model's products, its columns in `order`.

    `top` (o, k): the rows of the columns without a usual size; `seen`: what the data say of the others
    beyond these; `blur` (k - o,): the size of rounding in the rows of the others."""

    order: tuple[int, ...]
    top: Array
    seen: Seen
    blur: Array

    def blurs(self, weak: WeakPrior, sigma: float) -> bool:
        """Return whether rounding affects a prior that was computed from this triangle."""
        if weak.rows is None or weak.sizes is None:
            return False
        sized = list(self.seen.index)
        direction = np.abs(weak.rows[:, sized]) * np.square(weak.sizes[sized]) / sigma
        return bool((direction @ self.blur).max() > SHARP * sigma)

    def held(self, weak: Array | None) -> Array:
        """Return the whole triangle (k, k), with a prior's rows (w, p) on columns of a usual size."""
        rest = self.seen.root
        if weak is not None:
            rest = np.vstack([rest, weak[:, list(self.seen.index)]])
        end = np.linalg.qr(rest, mode="r") if rest.size else rest
        k, first = len(self.order), len(self.top)
        out = np.zeros((k, k))
        out[:first] = self.top
        out[first:, first:] = end
        return out
