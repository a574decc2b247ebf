"""Weighted, rank-revealing least squares, re-linearised on the exact chain until the step is below 0.1 µm."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..matrix.design import Model, residuals
from ..matrix.identify import FAINT_MM, Identified, identify, solve, told, usual_sizes
from ..matrix.reduce import PROBE, Reduction, Source, reduce_scene
from ..matrix.scene import Scene
from ..matrix.size import as_drawn
from ..matrix.smooth import penalty
from ..words.errors import NotEstimable
from ..words.rigid import Array
from ..wrong.screws import Term

STEP_MM = 1e-4     # 0.1 µm
ITERATIONS = 60
STUCK = 1e8        # damping at which no step lowers the cost: the minimum, to rounding


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted model: theta (p,) in the terms' units, nought where a term is not estimable; `factor` (p, rank) with
    covariance = sigma² factor factorᵀ; rss and rows in whitened coordinates; `reduction` linearised at theta."""

    model: Model
    theta: Array
    found: Identified
    factor: Array = field(repr=False)
    rss: float
    rows: int
    iterations: int
    step_mm: float
    reduction: Reduction = field(repr=False)
    precision: Array | None = field(default=None, repr=False)

    @property
    def terms(self) -> tuple[Term, ...]:
        """The model's terms, in the order of theta."""
        return self.model.terms

    @property
    def rank(self) -> int:
        """Estimable parameters."""
        return self.found.rank

    @property
    def freedom(self) -> float:
        """Rows minus what the fit has used: the rank, or the trace of the hat matrix where terms are shrunk."""
        if self.precision is None:
            return float(self.rows - self.rank)
        inner = self.reduction.R[:-1, list(self.found.kept)] @ self.factor[list(self.found.kept)]
        return float(self.rows - (inner ** 2).sum())

    @property
    def sigma(self) -> float:
        """Residual standard deviation of one whitened coordinate."""
        return float(np.sqrt(self.rss / self.freedom)) if self.freedom > 0 else float("nan")

    @property
    def standard_errors(self) -> Array:
        """(p,) from the residual variance; nought where a term is not estimable."""
        return np.asarray(np.sqrt((self.factor ** 2).sum(1)) * self.sigma)

    @property
    def covariance(self) -> Array:
        """(p, p) from the residual variance."""
        return np.asarray(self.factor @ self.factor.T * self.sigma ** 2)

    @cached_property
    def root(self) -> Array:
        """(k, p) root of the prior's precision matrix, in whitened units: the shrunk terms' prior is root · theta ~ N(0, 1)
        times the noise; no rows for a plain fit."""
        return np.zeros((0, len(self.theta))) if self.precision is None else penalty(self.terms, self.precision)

    @property
    def prior(self) -> Array | None:
        """(k, p+1) rows [columns | response] of the prior at theta; None for a plain fit."""
        return None if self.precision is None else _rows(self.root, self.theta)

    def at(self) -> tuple[Sequence[Term], Array]:
        """The point to linearise other models at."""
        return self.terms, self.theta

    def residuals(self, scene: Scene) -> Array:
        """Exact residuals (m, c) [mm, rad] of a scene under this fit."""
        return residuals(scene, self.terms, self.theta)


def _rows(root: Array, theta: Array) -> Array:
    return np.column_stack([root, -root @ theta])


def _with_prior(reduction: Reduction, root: Array | None, theta: Array) -> Reduction:
    """The reduction with the prior's rows, root · (theta + delta) = 0, stacked on; its count stays that of the data."""
    if root is None or not len(root):
        return reduction
    return Reduction(reduction.add(_rows(root, theta)).R, reduction.rows)


def _damped(reduction: Reduction, damping: float) -> Reduction:
    """With Marquardt's damping: a row per column, in proportion to its norm, that holds the step back."""
    if not damping:
        return reduction
    rows = np.diag(np.sqrt(damping) * np.linalg.norm(reduction.R, axis=0))
    rows[-1, -1] = 0.0
    return Reduction(reduction.add(rows).R, reduction.rows)


def _linear_sigma(reduction: Reduction, found: Identified) -> float:
    """Residual standard deviation of the linear fit: a combination whose standard error exceeds any usual size of its
    parameters is not told by the data, only by their noise."""
    free = reduction.rows - found.rank
    return float(np.sqrt(solve(reduction, found.kept)[2] / free)) if free > 0 else 0.0


def _cost(reduction: Reduction) -> float:
    return float(np.square(reduction.R[:, -1]).sum())


def typical_weight(scene: Scene | Source) -> float:
    """1/mm: of one coordinate of a typical row."""
    return scene.whiten if isinstance(scene.whiten, float) else float(np.median(np.diagonal(scene.whiten, 0, 1, 2)[:, :3]))


def fit(scene: Scene | Source, model: Model, *, precision: Array | None = None, iterations: int = ITERATIONS,
        start: Array | None = None, step_mm: float = STEP_MM) -> Fit:
    """Least squares of a model on a scene. precision (p,): prior 1/variance of each term in whitened units, about zero, the
    terms of a free function correlated (`smooth`).

    Gauss-Newton on the exact chain, until all rows together move less than `step_mm`; `iterations=1` is the linear fit at
    `start` (zero). Raises NotEstimable where the data have no more coordinates than the model has estimable parameters, or
    the iteration does not settle.
    """
    terms = model.terms
    theta = np.zeros(len(terms)) if start is None else start.copy()
    weight = typical_weight(scene)
    nominal = reduce_scene(scene, terms)
    # rank is a property of the nominal chain: off it, exact dependences turn into directions that need radians to be seen
    root = None if precision is None else penalty(terms, precision)
    found = _estimable(_with_prior(nominal, root, theta), nominal, model, weight, scene, precision is None)
    kept = list(found.kept)
    lost = np.delete(np.arange(len(terms)), kept)
    if theta[lost].any():               # another choice of representatives: the start's parts do not fit together
        theta[:] = 0.0
    only = kept if len(scene) > PROBE[1] else None
    reduction = nominal if not theta.any() else reduce_scene(scene, terms, (terms, theta), only)
    full, step, done, damping = _with_prior(reduction, root, theta), np.inf, 0, 0.0
    while done < iterations and step >= step_mm and damping < STUCK:
        delta = np.zeros(len(terms))
        delta[kept] = solve(_damped(full, damping), kept)[0]
        trial = theta + delta
        step, done = float(np.linalg.norm(reduction.R[:-1, :-1] @ delta)) / weight, done + 1
        ahead = reduce_scene(scene, terms, (terms, trial), only)
        there = _with_prior(ahead, root, trial)
        if _cost(there) <= _cost(full) * (1 + 1e-9) or step < step_mm or iterations == 1:
            theta, reduction, full = trial, ahead, there
            damping = damping / 10 if damping > 1e-8 else 0.0
        else:                                   # overshot: Levenberg-Marquardt from the same point
            damping, step = max(8 * damping, 1e-6), max(step, step_mm)
    if step > 1e3 * step_mm and iterations == ITERATIONS and damping < STUCK:
        raise NotEstimable(f"the fit of {' + '.join(model.names)} does not settle (last step {step:.3g} mm): the data hardly "
                           "determine some parameters; measure more widely spread configurations.")
    return Fit(model, theta, found, _factor(full, kept), _cost(reduction), reduction.rows, done, step, reduction, precision)


def _estimable(full: Reduction, nominal: Reduction, model: Model, weight: float, scene: Scene | Source,
               plain: bool) -> Identified:
    """What the data tell of a model at the nominal chain, `full` with its prior; `weight` [1/mm] of one coordinate."""
    found = identify(full)
    found = told(found, usual_sizes(model.terms), max(FAINT_MM * weight * np.sqrt(len(scene)), _linear_sigma(nominal, found)))
    found = as_drawn(found, scene, model.terms)
    if nominal.rows <= found.rank and plain:
        raise NotEstimable(f"{nominal.rows} measured coordinates cannot determine the {found.rank} estimable parameters of "
                           f"{' + '.join(model.names) or 'the model'}: measure more configurations.",
                           parameters=[t.symbol for t in model.terms])
    return found


def _factor(full: Reduction, kept: Sequence[int]) -> Array:
    """(p, rank) covariance factor of the kept terms, noughts for the others."""
    factor = np.zeros((full.p, len(kept)))
    factor[kept] = solve(full, kept)[1]
    return factor


@dataclass(frozen=True, eq=False)
class Step:
    """One linear step from a known point, from reductions alone: where it goes, and what it can tell. `fit` is the model there,
    once its reduction at theta is known."""

    model: Model
    theta: Array
    found: Identified
    size_mm: float

    def fit(self, reduction: Reduction) -> Fit:
        """The fit, from the reduction at theta."""
        factor, cost = _factor(reduction, list(self.found.kept)), _cost(reduction)
        return Fit(self.model, self.theta, self.found, factor, cost, reduction.rows, 1, self.size_mm, reduction)


def one_step(model: Model, start: Array, nominal: Reduction, here: Reduction, weight: float, scene: Scene) -> Step:
    """What `fit` with one iteration does from `start` (p,): `nominal` and `here` are the model's reductions at the nominal chain
    and at the start, `weight` [1/mm] of one coordinate of the `scene`. Raises NotEstimable."""
    found = _estimable(nominal, nominal, model, weight, scene, True)
    kept, theta = list(found.kept), start.copy()
    if theta[np.delete(np.arange(len(theta)), kept)].any():
        theta, here = np.zeros(len(theta)), nominal
    delta = np.zeros(len(theta))
    delta[kept] = solve(here, kept)[0]
    return Step(model, theta + delta, found, float(np.linalg.norm(here.R[:-1, :-1] @ delta)) / weight)
