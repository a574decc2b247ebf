"""Restricted likelihood of how large the parts of the errors are that rows share.

With H = I + Σ_k ρ_k V_k the rows' covariance over the variance φ of one coordinate, and
P = H⁻¹ − H⁻¹X (XᵀH⁻¹X)⁻¹ XᵀH⁻¹, twice the logarithm of the restricted likelihood is, φ at its best,
    −n ln(yᵀPy) − ln|H| − ln|XᵀH⁻¹X|                     (Patterson & Thompson 1971, Biometrika 58, 545).
Where the variance of a part is known, ρ is that over φ, and φ is sought with the others.
Standard errors are by the average information (Gilmour, Thompson & Cullis 1995, Biometrics 51,
1440)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from .._linalg import TINY
from .._typing import Array
from .shared_errors import Layout, Precision, SharedError, confine, keep_within


@dataclass(frozen=True, eq=False)
class LinearModel:
    """A linear model whose errors are looked at, whitened row by row.

    columns: (p, c, m); response: (c, m); freedom: measured coordinates less columns.
    """

    columns: Array
    response: Array
    freedom: float

    @cached_property
    def stacked(self) -> Array:
        """Columns and response together, (m, c, p+1)."""
        both = np.concatenate([self.columns, self.response[None]])
        return np.ascontiguousarray(both.transpose(2, 1, 0))


@dataclass(frozen=True, eq=False)
class Likelihood:
    """The restricted likelihood of some parts, at their variances.

    square: yᵀPy; log: twice the log likelihood; innovations: Py (m, c, 1); directions: (m, c, p)
    H⁻¹X R⁻¹ with RᵀR = XᵀH⁻¹X."""

    model: LinearModel
    parts: tuple[SharedError, ...]
    layout: Layout
    precision: Precision | None
    square: float
    log: float
    innovations: Array
    directions: Array

    @property
    def phi(self) -> float:
        """Variance φ of one coordinate."""
        return _choose_phi(self.parts, self.square, self.model.freedom)

    def solve(self, values: Array) -> Array:
        """Compute P times values (m, c, k)."""
        solved = values if self.precision is None else self.precision.multiply(values)
        inside = np.einsum("mcp,mck->pk", self.directions, values)
        return np.asarray(solved - np.einsum("mcp,pk->mck", self.directions, inside))

    def slope(self, part: SharedError) -> tuple[float, Array]:
        """Compute (the slope of twice the log likelihood by a part's variance, V P y (m, c, 1))."""
        number = next((k for k, own in enumerate(self.parts) if own.is_like(part)), None)
        laid = self.layout.parts
        own = confine(part, laid) if number is None else laid[number]
        moved = own.multiply(self.innovations)
        seen = float(np.vdot(self.innovations, moved))
        return seen / self.phi - self._trace(own, number), moved

    def information(self, moved: Array) -> Array:
        """Compute the average information (k, k) of twice the log likelihood in the directions
        V P y (m, c, k) of some parts."""
        seen = np.einsum("mck,mcl->kl", moved, self.solve(moved))
        along = np.einsum("mck,mc->k", moved, self.innovations[:, :, 0])
        return np.asarray((seen - np.outer(along, along) / self.square) / self.phi)

    def _trace(self, part: SharedError, number: int | None) -> float:
        """Compute the trace of P V; `number`: of the part among those that are there."""
        taken = part.measure(self.directions)
        if self.precision is None:
            return float(np.square(part.loading).sum()) - taken
        total = 0.0
        blocks = zip(self.precision.rows, self.precision.blocks, strict=True)
        for k, (rows, precision) in enumerate(blocks):
            spread = part.spread(rows) if number is None else self.layout.spreads[k][number]
            total += float(np.vdot(precision, spread))
        return total - taken


def lay_out(parts: Sequence[SharedError]) -> Layout:
    """Lay out the rows of parts, with no level beyond a stretch of a lasting one."""
    return Layout.of(keep_within(parts)) if parts else Layout((), (), ())


def evaluate_likelihood(
    model: LinearModel, parts: Sequence[SharedError], layout: Layout | None = None
) -> Likelihood:
    """Compute the restricted likelihood of parts at their variances; `layout`: of these parts."""
    parts = tuple(parts)
    layout = layout or lay_out(parts)
    precision, log_determinant = None, 0.0
    solved = model.stacked
    if parts:
        precision = layout.invert([part.variance for part in parts])
        solved = precision.multiply(solved)
        log_determinant = precision.log_determinant
    p = len(model.columns)
    flat = solved.reshape(-1, p + 1)
    gram = model.stacked.reshape(-1, p + 1).T @ flat
    lower = np.linalg.cholesky(gram[:-1, :-1])
    along = solve_triangular(lower, gram[:-1, -1], lower=True)
    square = float(gram[-1, -1] - along @ along)
    log_determinant += 2 * float(np.log(np.diagonal(lower)).sum())
    beta = solve_triangular(lower, along, lower=True, trans="T")
    innovations = flat[:, -1] - flat[:, :-1] @ beta
    directions = solve_triangular(lower, flat[:, :-1].T, lower=True).T
    rows = solved.shape[:2]
    square, freedom = max(square, TINY), model.freedom
    phi = _choose_phi(parts, square, freedom)
    return Likelihood(
        model=model,
        parts=parts,
        layout=layout,
        precision=precision,
        square=square,
        log=freedom * float(1 - np.log(phi * freedom)) - square / phi - log_determinant,
        innovations=innovations.reshape(*rows, 1),
        directions=np.ascontiguousarray(directions).reshape(*rows, p),
    )


def _choose_phi(parts: Sequence[SharedError], square: float, freedom: float) -> float:
    """Choose φ: by the parts of known variance where there are any, else its best."""
    for part in parts:
        if part.known is not None:
            return part.known / part.variance
    return square / freedom
