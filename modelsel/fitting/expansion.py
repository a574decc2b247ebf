"""A model's squares about a point, to second order: what steps towards the minimum and judgements
of what is determined are worked out from.

They are wanted again and again, with other priors: the parameters that have a usual size stand
last, so that a prior of theirs changes the end of the triangle alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .._typing import Array
from .gradient import Slope
from .prior import Seen, Shrinkage, WeakPrior
from .reduction import Reduction

# least squared share of a column that is its own, from which products tell it from the others to
# eight digits and more
SAFE = 1e-8
BLUR = 1e-7  # of a unit column: what products do not tell from nothing
SHARP = 3e-4  # of the noise: rounding below it changes what is judged by 1e-8
VANISHING = 1e-14  # of the products of unit columns: rounding


class Unsafe(ArithmeticError):
    """Columns that products cannot tell apart."""


@dataclass(frozen=True, eq=False)
class Expansion:
    """About theta (p,): the products (p, p) of the columns, and the slope; `reduction` where the
    rows have been reduced there, `free` that of the terms without a variance of their own."""

    theta: Array
    gram: Array
    slope: Slope
    reduction: Reduction | None = None
    free: Reduction | None = None

    @staticmethod
    def of_reduction(theta: Array, reduction: Reduction) -> Expansion:
        """Return the expansion that a reduction at theta is."""
        R = reduction.R
        return Expansion.of_products(theta, R.T @ R, reduction)

    @staticmethod
    def of_products(
        theta: Array,
        products: Array,
        reduction: Reduction | None = None,
        free: Reduction | None = None,
    ) -> Expansion:
        """Return the expansion of products (p+1, p+1) of [columns | residual] at theta."""
        squares: float = products[-1, -1].item()
        slope = Slope(squares, products[:-1, -1])
        return Expansion(theta, products[:-1, :-1], slope, reduction, free)

    @cached_property
    def response(self) -> Array:
        """Products (p,) of the columns with the residual, all parameters put back."""
        return np.asarray(self.slope.products + self.gram @ self.theta)

    def slope_at(self, theta: Array) -> Slope:
        """Return the slope at theta (p,), as the squares' second order has it."""
        change = theta - self.theta
        moved = self.gram @ change
        squares = self.slope.squares + float(change @ (moved - 2 * self.slope.products))
        return Slope(squares, self.slope.products - moved)

    def distance(self, theta: Array) -> float:
        """How far all rows together move on the way to theta, whitened."""
        change = theta - self.theta
        square = float(change @ self.gram @ change)
        return float(np.sqrt(max(square, 0.0)))

    def triangle(
        self, others: Sequence[int], sized: Sequence[int], shrinkage: Shrinkage
    ) -> Triangle:
        """Factorise the products of some columns with those of a prior: exactly where the rows are
        reduced. Raises Unsafe where products do not do."""
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
        """`triangle` of the reduction."""
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
    """(top rows (first, k) of the triangle of unit products (k, k), response (k - first,) of the
    rest beyond them). Raises Unsafe where the first columns can hardly be told apart."""
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
    """(root (k, k) of products, the response (k,) in its rows)."""
    values, vectors = np.linalg.eigh(products)
    values = np.where(values > VANISHING, values, 0.0)
    size = np.sqrt(values)
    turned = vectors.T @ response
    in_rows = np.divide(turned, size, out=np.zeros_like(turned), where=size > 0)
    return size[:, None] * vectors.T, in_rows


@dataclass(frozen=True, eq=False)
class Triangle:
    """Factor of a model's products: the rows `top` (o, k) of the columns without a usual size, in
    `order`, and what is `seen` of those with one beyond them; `blur` (k - o,): what in their rows
    may be rounding."""

    order: tuple[int, ...]
    top: Array
    seen: Seen
    blur: Array

    def blurs(self, weak: WeakPrior, sigma: float) -> bool:
        """Return whether rounding has a say in a prior that was judged by this triangle."""
        if weak.rows is None or weak.sizes is None:
            return False
        sized = list(self.seen.index)
        direction = np.abs(weak.rows[:, sized]) * np.square(weak.sizes[sized]) / sigma
        return bool((direction @ self.blur).max() > SHARP * sigma)

    def held(self, weak: Array | None) -> Array:
        """Return the whole triangle (k, k), with a prior's rows (w, p) on the sized columns."""
        rest = self.seen.root
        if weak is not None:
            rest = np.vstack([rest, weak[:, list(self.seen.index)]])
        end = np.linalg.qr(rest, mode="r") if rest.size else rest
        k, first = len(self.order), len(self.top)
        out = np.zeros((k, k))
        out[:first] = self.top
        out[first:, first:] = end
        return out
