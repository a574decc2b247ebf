"""Restricted likelihood of how large the parts of the errors are that rows share.

With H = I + Σ_k ρ_k V_k the rows' covariance over the variance φ of one coordinate, and
P = H⁻¹ − H⁻¹X (XᵀH⁻¹X)⁻¹ XᵀH⁻¹, twice the logarithm of the restricted likelihood is, φ at its best,
    −n ln(yᵀPy) − ln|H| − ln|XᵀH⁻¹X|                     (Patterson & Thompson 1971, Biometrika 58, 545).
Where the variance of a part is known, ρ is that over φ, and φ is sought with the others.
It is maximised over ρ ≥ 0 with its exact slope; standard errors are by the average information
(Gilmour, Thompson & Cullis 1995, Biometrics 51, 1440)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from .._linalg import TINY
from .._typing import Array, Mask
from .shared_errors import Layout, Precision, SharedError, confine, keep_within

# of L-BFGS-B: changes of twice the log likelihood, and its slope, at which it ends
EXACT = {"maxiter": 60, "ftol": 1e-13, "gtol": 1e-5}
ROUGH = {"maxiter": 20, "ftol": 1e-7, "gtol": 3e-2}
# times the mean square of ε that a part's is at most: where the parts have as many draws as the rows of a
# visit have coordinates, they explain whatever is left, and rows without noise would decide everything
MOST_OF_ALL = 30.0
# the same where the parts have at most so many draws for every coordinate, of which the targets of a
# visit, on one rigid body, have six at most
FEW_DRAWS = 0.7
OF_A_BODY = 6
MOST_OF_FEW = 1e4
# share of the most from which a part is at it
AT_MOST = 0.99
# the same where the maximum is sought at least, and below which a part is none
LEAST, NO_PART = 3e-7, 3e-5


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


@dataclass
class _Best:
    """The best likelihood that a search has seen, which begins and mostly ends there: it is not
    computed again."""

    evaluate: Callable[[Array], Likelihood]
    x: Array
    at: Likelihood

    def look(self, x: Array) -> Likelihood:
        """Return the likelihood at x."""
        is_here = np.array_equal(x, self.x)
        if is_here:
            return self.at
        at = self.evaluate(x)
        if not at.log < self.at.log:
            self.x, self.at = x.copy(), at
        return at


def maximise_likelihood(
    model: LinearModel,
    parts: Sequence[SharedError],
    held: Sequence[SharedError] = (),
    exact: bool = True,
) -> Likelihood:
    """Maximise the restricted likelihood over the variances of parts, from those that they have.

    Parts that are `held` keep theirs; where parts are of known variance, φ is sought in their
    place. A part whose variance ends at nought is none of the result's. Unless `exact`, twice the
    log likelihood is within some hundredths of its maximum."""
    every = [*held, *parts]
    if not parts:
        return evaluate_likelihood(model, every)
    # a seventh of a second, which studies without such parts need not spend
    from scipy.optimize import minimize

    is_known = np.array([part.known is not None for part in every])
    is_sought = ~is_known & (np.arange(len(every)) >= len(held))
    unit = 1 / np.array([_mean_square(part) for part in every])
    least, most = LEAST * unit, _choose_most(every) * unit
    # where a model leaves next to nothing, a variance that is guessed from it can be beyond all bounds
    guessed = np.array([part.variance for part in every])
    every = _set_variances(every, np.where(is_sought, np.clip(guessed, least, most), guessed))
    layout = lay_out(every)
    start = np.log([part.variance for part in every])
    first = evaluate_likelihood(model, every, layout)
    scale = _choose_scale(first, is_sought)
    # what the logarithms of the variances go by: their own, and that of φ where some are known
    steps = np.eye(len(every))[:, is_sought]
    if is_known.any():
        steps = np.column_stack([steps, -is_known.astype(float)])
        scale = np.append(scale, np.sqrt(model.freedom))
    moves = np.flatnonzero(is_sought | is_known)

    def evaluate(x: Array) -> Likelihood:
        variance = np.exp(start + steps @ (x / scale))
        return evaluate_likelihood(model, _set_variances(every, variance), layout)

    best = _Best(evaluate, np.zeros(len(scale)), first)

    def lose(x: Array) -> tuple[float, Array]:
        at = best.look(x)
        variance = np.array([part.variance for part in at.parts])
        slopes = np.array([at.slope(at.parts[k])[0] for k in moves])
        loss = -steps[moves].T @ (slopes * variance[moves])
        if is_known.any():
            loss[-1] += model.freedom - at.square / at.phi
        return -at.log, loss / scale

    low = np.log(least) - start
    high = np.log(most) - start
    bounds = np.stack([low, high])[:, is_sought]
    if is_known.any():
        bounds = np.column_stack([bounds, [-high[is_known].min(), -low[is_known].max()]])
    options = EXACT if exact else ROUGH
    found = minimize(
        lose, best.x, jac=True, method="L-BFGS-B", bounds=(bounds * scale).T, options=options
    )
    ended = best.look(found.x)
    variance = np.array([part.variance for part in ended.parts])
    is_there = ~is_sought | (variance >= NO_PART * unit)
    if is_there.all():
        return ended
    there = [part for part, kept in zip(ended.parts, is_there, strict=True) if kept]
    return evaluate_likelihood(model, there)


def _choose_scale(at: Likelihood, is_sought: Mask) -> Array:
    """Choose (k,) what makes the likelihood about equally curved in the logarithms of the variances
    that are sought."""
    scale = []
    for k in np.flatnonzero(is_sought):
        part = at.parts[k]
        information = float(at.information(at.slope(part)[1])[0, 0])
        curvature = information * part.variance**2
        scale.append(np.sqrt(max(curvature, 1.0)))
    return np.array(scale)


def _choose_most(parts: Sequence[SharedError]) -> float:
    """Choose how many times the mean square of ε a part's may be."""
    if any(part.time is not None for part in parts):
        return MOST_OF_ALL
    levels = [len(np.unique(part.level)) for part in parts]
    draws = sum(count * part.loading.shape[2] for count, part in zip(levels, parts, strict=True))
    finest = parts[int(np.argmax(levels))]
    has_few = draws <= FEW_DRAWS * _count_motions(finest)
    return MOST_OF_FEW if has_few else MOST_OF_ALL


def _count_motions(part: SharedError) -> int:
    """Count the numbers that rows of each level can differ in from the model: their coordinates, and those
    of a rigid body at most, which the targets of a visit are on."""
    _, components, _ = part.loading.shape
    _, rows = np.unique(part.level, return_counts=True)
    return int(np.minimum(rows * components, OF_A_BODY).sum())


def is_at_most(parts: Sequence[SharedError]) -> bool:
    """Whether one of the parts is as large as it may be: ε could be smaller then, down to nothing."""
    sought = [part for part in parts if part.known is None]
    if not sought:
        return False
    largest = max(part.variance * _mean_square(part) for part in sought)
    return largest > AT_MOST * _choose_most(parts)


def _mean_square(part: SharedError) -> float:
    """Compute the mean square of a row's coordinate by draws of unit variance."""
    return max(float(np.square(part.loading).sum(2).mean()), TINY)


def _set_variances(parts: Sequence[SharedError], variance: Array) -> list[SharedError]:
    return [replace(part, variance=float(v)) for part, v in zip(parts, variance, strict=True)]
