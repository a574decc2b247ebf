"""Weighted, rank-revealing least squares, re-linearised on the exact chain until the step is below
0.1 µm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from .._typing import Array
from ..exceptions import NotEstimable
from ..mechanisms.terms import Term
from .design import Model, residuals
from .identifiability import Identified, as_drawn, identify, solve, without
from .linearisation import Linearisation
from .prior import WeakPrior, faint, fitted_terms, usual_sizes, weak_prior
from .problem import Problem
from .reduction import PROBE, Reduction, Source, reduce_problem
from .splines import penalty

Held = Literal["nothing", "geometry", "all"]
STEP_MM = 1e-4  # 0.1 µm
ITERATIONS = 60
STUCK = 1e8  # damping at which no step lowers the cost: the minimum, to rounding
ROUNDS = 30  # of judging again what is fitted, where the fit has gone
FAR = 10.0  # usual sizes from the nominal arm, within which the nominal chain's dependences hold
QUIET_MM = 1e-6  # no measurement is better
# rms: combinations that move the target less at their usual sizes wait until the others have
# converged
UNSEEN_MM = 0.01


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted model: theta (p,) in the terms' units, zero where a term is fixed; `factor` (p,
    fitted terms) with covariance = sigma² factor factorᵀ; rss and rows in whitened coordinates;
    `reduction` linearised at theta; `precision` (p,) of shrunk terms; `weak`: the prior on what the
    data hardly determine.

    What is fitted and what is fixed, `found`, is judged at the solution; sentences, tables, exports
    and the posterior take it from here."""

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
    weak: WeakPrior = field(default_factory=WeakPrior, repr=False)

    @property
    def terms(self) -> tuple[Term, ...]:
        """The model's terms, in the order of theta."""
        return self.model.terms

    @property
    def rank(self) -> int:
        """Parameters that the data determine: those fitted, less the combinations of which the
        prior says more."""
        fitted = self.found.rank
        return fitted - self.weak.held

    @cached_property
    def freedom(self) -> float:
        """Rows minus what the fit has used: the fitted terms, or the trace of the hat matrix where
        a prior holds some."""
        kept = list(self.found.kept)
        if self.prior is None:
            return float(self.rows - len(kept))
        hat_root = self.reduction.R[:-1, kept] @ self.factor[kept]
        return float(self.rows - np.square(hat_root).sum())

    @property
    def by_prior(self) -> int:
        """Fitted terms that a prior has a say in, whose rows stand with the data's: they cost the
        noise no degree of freedom."""
        precision = self.precision
        if precision is None:
            return self.weak.count
        kept = list(self.found.kept)
        is_shrunk = precision[kept] > 0
        count = int(is_shrunk.sum())
        return count + self.weak.count

    @cached_property
    def sigma(self) -> float:
        """Residual standard deviation of one whitened coordinate."""
        if self.freedom <= 0:
            return float("nan")
        variance = self.rss / self.freedom
        return float(np.sqrt(variance))

    @cached_property
    def standard_errors(self) -> Array:
        """Standard errors (p,) from the residual variance; zero where a term is not estimable."""
        factor = self.factor
        variance = (factor**2).sum(1)
        errors: Array = np.sqrt(variance) * self.sigma
        return errors

    @property
    def covariance(self) -> Array:
        """Covariance (p, p) of the parameters, from the residual variance."""
        variance = self.sigma**2
        unscaled = self.factor @ self.factor.T
        covariance: Array = unscaled * variance
        return covariance

    @cached_property
    def root(self) -> Array:
        """Root (k, p) of the prior's precision matrix: root · theta ~ N(0, 1) times the noise, of
        shrunk terms and of what the data hardly determine; no rows for plain least squares."""
        return prior_root(self.terms, self.precision, self.weak)

    @cached_property
    def prior(self) -> Array | None:
        """Rows (k, p+1) [columns | response] of the prior at theta; None for plain least
        squares."""
        if not len(self.root):
            return None
        return _rows(self.root, self.theta)

    @property
    def representatives(self) -> tuple[int, ...]:
        """Fitted terms that do not depend on earlier ones."""
        return tuple(k for k in self.found.exact if k in self.found.kept)

    @cached_property
    def beyond(self) -> float:
        """Degrees of freedom beyond all that the model can do at any size: rows minus the trace of
        the hat matrix of its representatives, shrunk terms with their variance."""
        columns = list(self.representatives)
        full = with_prior(self.reduction, prior_root(self.terms, self.precision), self.theta)
        _, factor, _ = solve(full, columns)
        hat_root = self.reduction.R[:-1, columns] @ factor
        return float(self.rows - np.square(hat_root).sum())

    @cached_property
    def leaning(self) -> tuple[int, ...]:
        """Fitted terms whose standard error is above half of their usual size: the prior holds them
        as much as the data."""
        sizes = self.weak.sizes
        if sizes is None:
            return ()
        errors = self.standard_errors
        leans = errors > 0.5 * sizes
        return tuple(k for k in self.found.kept if leans[k])

    def at(self) -> Linearisation:
        """Return the point to linearise other models at."""
        return Linearisation(self.terms, self.theta)

    def residuals(self, problem: Problem) -> Array:
        """Compute the exact residuals (m, c) [mm, rad] of a problem under this fit."""
        return residuals(problem, self.terms, self.theta)


def _rows(root: Array, theta: Array) -> Array:
    return np.column_stack([root, -root @ theta])


def prior_root(
    terms: Sequence[Term], precision: Array | None, weak: WeakPrior | None = None
) -> Array:
    """Compute the root (k, p) of the prior's precision, of shrunk terms and of what the data hardly
    determine."""
    shrunk = np.zeros((0, len(terms)))
    if precision is not None:
        shrunk = penalty(terms, precision)
    weak_rows = None if weak is None else weak.rows
    if weak_rows is None:
        return shrunk
    return np.vstack([shrunk, weak_rows])


def with_prior(reduction: Reduction, root: Array, theta: Array) -> Reduction:
    """Return the reduction with the prior's rows, root · (theta + delta) = 0, stacked on; its count stays
    that of the data."""
    if not len(root):
        return reduction
    stacked = reduction.add(_rows(root, theta))
    return Reduction(stacked.R, reduction.rows)


def _damped(reduction: Reduction, damping: float) -> Reduction:
    """Add Marquardt's damping: a row per column, in proportion to its norm, that holds the step
    back."""
    if not damping:
        return reduction
    rows = np.diag(np.sqrt(damping) * np.linalg.norm(reduction.R, axis=0))
    rows[-1, -1] = 0.0
    return Reduction(reduction.add(rows).R, reduction.rows)


def cost(reduction: Reduction) -> float:
    """Return the sum of squares of the response."""
    return float(np.square(reduction.R[:, -1]).sum())


def fit(
    problem: Problem | Source,
    model: Model,
    *,
    precision: Array | None = None,
    iterations: int = ITERATIONS,
    start: Array | None = None,
    step_mm: float = STEP_MM,
    held: Held = "geometry",
) -> Fit:
    """Fit a model to a problem by least squares. precision (p,): prior 1/variance of each term in
    whitened units, about zero, the terms of a free function correlated (`smooth`). `held`: what the
    prior of usual sizes holds where the data hardly determine it: the "geometry", "all"
    (mechanisms' terms, too, which must have no say in what they are named), or "nothing", where
    terms that depend on earlier ones are fixed at zero.

    Gauss-Newton on the exact chain, until all rows together move less than `step_mm`; then what is
    fitted, what is fixed and what the prior of usual sizes holds is judged at the solution, and the
    fit goes on until that stays. `iterations=1` is one linear step. Raises NotEstimable where the
    data have no more coordinates than the model has estimable parameters, or the iteration does not
    settle."""
    solver = _Solver(problem, model, precision, problem.whitening.typical_weight(), held)
    if held == "nothing" or start is None or not start.any():
        theta = np.zeros(len(model.terms)) if start is None else start
        state = solver.state(theta, solver.at_nominal(), WeakPrior())
        state = solver.solve(state, iterations, step_mm)
    else:
        state = solver.state(start, solver.exact, WeakPrior())
    if held != "nothing":
        state = solver.settle(state, iterations, step_mm)
    solver.refuse(state, iterations == ITERATIONS, step_mm)
    return Fit(
        model,
        state.theta,
        state.found,
        factor_of(state.full, state.found.kept),
        cost(state.reduction),
        state.reduction.rows,
        state.iterations,
        state.step_mm,
        state.reduction,
        precision,
        state.weak,
    )


@dataclass(frozen=True, eq=False)
class _State:
    """Where the iteration stands: reductions at theta, without and with the prior's rows; the last
    step, and its damping."""

    theta: Array
    found: Identified
    weak: WeakPrior
    reduction: Reduction
    full: Reduction
    iterations: int = 0
    step_mm: float = np.inf
    damping: float = 0.0


@dataclass(frozen=True, eq=False)
class _Solver:
    """What stays the same in a fit; `weight` [1/mm] of one coordinate."""

    problem: Problem | Source
    model: Model
    precision: Array | None
    weight: float
    held: Held

    @cached_property
    def nominal(self) -> Reduction:
        """The reduction at the nominal chain."""
        terms = self.model.terms
        return reduce_problem(self.problem, terms)

    @cached_property
    def exact(self) -> Identified:
        """What the data determine at the nominal chain, where dependences are exact."""
        root = prior_root(self.model.terms, self.precision)
        found = identify(with_prior(self.nominal, root, np.zeros(len(self.model.terms))))
        return as_drawn(found, self.problem, self.model.terms)

    def at_nominal(self) -> Identified:
        """`exact`, less what hardly moves the target at its usual size: it waits until the rest has
        converged."""
        least = UNSEEN_MM * self.weight * np.sqrt(len(self.problem))
        sizes = usual_sizes(self.model)
        return without(self.exact, faint(self.exact.triangle, self.exact.kept, sizes, least))

    def sigma(self, rss: float, fitted: Sequence[int], by_prior: float = 0.0) -> float:
        """Residual standard deviation of one whitened coordinate; terms that a prior holds cost no
        degree of freedom."""
        free = sum(self.precision is None or self.precision[k] == 0 for k in fitted) - by_prior
        return float(np.sqrt(rss / max(self.nominal.rows - free, 1.0)))

    def state(self, theta: Array, found: Identified, weak: WeakPrior) -> _State:
        """Begin the iteration at parameters theta, the fixed terms at zero."""
        theta = np.where(np.isin(np.arange(len(theta)), found.kept), theta, 0.0)
        return _State(theta, found, weak, *self.reduced(theta, found, weak))

    def reduced(
        self, theta: Array, found: Identified, weak: WeakPrior
    ) -> tuple[Reduction, Reduction]:
        """Reduce at theta: (the reduction, the same with the prior's rows)."""
        terms = self.model.terms
        if theta.any():
            only = list(found.kept) if len(self.problem) > PROBE[1] else None
            reduction = reduce_problem(self.problem, terms, Linearisation(terms, theta), only)
        else:
            reduction = self.nominal
        return reduction, with_prior(reduction, prior_root(terms, self.precision, weak), theta)

    def settle(self, state: _State, iterations: int, step_mm: float) -> _State:
        """Judge what is fitted and solve again, until the judgement stays."""
        for _ in range(ROUNDS):
            found, weak = self.judge(state)
            fitted = state.found.kept
            same_terms = found.kept == fitted
            same_prior = weak.like(state.weak)
            is_settled = state.step_mm < step_mm
            if same_terms and same_prior and is_settled:
                break
            start = self.state(state.theta, found, weak)
            state = self.solve(start, iterations, step_mm)
        return state

    def solve(self, state: _State, iterations: int, step_mm: float) -> _State:
        """Iterate Gauss-Newton over the kept terms, damped where it overshoots."""
        kept, count = list(state.found.kept), 0
        state = replace(state, step_mm=np.inf, damping=0.0)
        while count < iterations and state.step_mm >= step_mm and state.damping < STUCK:
            count += 1
            delta = np.zeros(len(state.theta))
            delta[kept], _, _ = solve(_damped(state.full, state.damping), kept)
            step = float(np.linalg.norm(state.full.R[:-1, :-1] @ delta)) / self.weight
            trial = state.theta + delta
            reduction, full = self.reduced(trial, state.found, state.weak)
            lower = cost(full) <= cost(state.full) * (1 + 1e-9)
            if lower or step < step_mm or iterations == 1:
                damping = state.damping / 10 if state.damping > 1e-8 else 0.0
                state = replace(state, theta=trial, reduction=reduction, full=full)
                state = replace(state, step_mm=step, damping=damping)
            else:  # overshot: Levenberg-Marquardt from the same point
                damping = max(8 * state.damping, 1e-6)
                state = replace(state, damping=damping, step_mm=max(step, step_mm))
        return replace(state, iterations=state.iterations + count)

    def judge(self, state: _State) -> tuple[Identified, WeakPrior]:
        """Judge what is fitted and what the prior holds, at the solution and by the noise it leaves.
        Every constant parameter that moves a measured coordinate is fitted; of the other terms,
        those that no earlier one represents."""
        theta, terms, reduction = state.theta, self.model.terms, state.reduction
        if len(self.problem) > PROBE[1]:  # it holds the kept terms alone
            reduction = reduce_problem(self.problem, terms, Linearisation(terms, theta))
        full = with_prior(reduction, prior_root(terms, self.precision), theta)
        found = self.exact
        is_far = np.abs(theta) > FAR * usual_sizes(self.model)
        if is_far.any():  # other terms depend on one another there
            found = as_drawn(identify(full), self.problem, terms)
        found = fitted_terms(found, self.model)
        sigma = self.sigma(cost(state.reduction), state.found.kept, state.weak.count)
        sigma = max(sigma, QUIET_MM * self.weight)
        catalogue = self.held == "all"
        return found, weak_prior(full, found.kept, self.model, theta, sigma, catalogue)

    def refuse(self, state: _State, settled: bool, step_mm: float) -> None:
        """Raise NotEstimable where the data have no more coordinates than the model has parameters,
        or where the iteration should have `settled` and has not."""
        names = " + ".join(self.model.names) or "the model"
        rows = self.nominal.rows
        rank = state.found.rank - state.weak.held
        if rows <= rank and self.precision is None:
            raise NotEstimable(
                f"{rows} measured coordinates cannot determine the {rank} estimable parameters of "
                f"{names}: measure more configurations.",
                parameters=[t.symbol for t in self.model.terms],
            )
        if settled and state.step_mm > 1e3 * step_mm and state.damping < STUCK:
            raise NotEstimable(
                f"the fit of {names} does not settle (last step {state.step_mm:.3g} mm): the data hardly "
                "determine some parameters; measure more widely spread configurations."
            )


def factor_of(full: Reduction, kept: Sequence[int]) -> Array:
    """Compute the covariance factor (p, rank) of the kept terms, zeros for the others."""
    shape = full.p, len(kept)
    factor = np.zeros(shape)
    columns = list(kept)
    _, solved, _ = solve(full, columns)
    factor[columns] = solved
    return factor
