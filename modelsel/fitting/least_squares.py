"""Weighted, rank-revealing least squares, re-linearised on the exact chain until the step is below
0.1 µm.

`fit` chooses a strategy by the number of rows and makes its `Solver`; `begin` iterates and settles what
is fitted; `finish` reduces the rows at the solution."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from .._arguments import check_numbers, check_type, check_whole_number
from .._linalg import TINY
from .._typing import Array, Index
from ..exceptions import count_words
from ..mechanisms.terms import Mechanism, Term
from .design import MODEL_EXPECTED, Model, residuals
from .gauss_newton import WholeProblem
from .identifiability import Identified, solve
from .iteration import COARSE_MM, State
from .linearisation import Linearisation
from .prior import Shrinkage, WeakPrior, fitted_terms, prior_root, prior_rows, with_prior
from .problem import PROBLEM_EXPECTED, Problem
from .reduction import Reduction, Source, reduce_problem
from .sampled import SAMPLE_STEP_MM, SampledRows, draw_sample, takes_sample
from .solver import ITERATIONS, Held, Solver

STEP_MM = 1e-4  # 0.1 µm
UNSETTLED_MM = 0.1  # last step of all rows together from which a fit has not arrived
EACH_PARAMETER = "one number for each parameter of the model"


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """A fitted model.

    `theta` (p,): estimates in the terms' units, zero where a term is fixed; `found`: which terms are
    fitted and which are fixed, as judged at the solution; `factor` (p, fitted terms) with covariance =
    sigma² factor factorᵀ; `rss`, `rows`: residual sum of squares and number of whitened coordinates;
    `step_mm`: the last step; `reduced`: the rows, linearised at theta, or what reduces them when they
    are asked for; `precision` (p,) of shrunk terms; `weak`: the prior on what the data hardly
    determine."""

    model: Model
    theta: Array
    found: Identified
    factor: Array = field(repr=False)
    rss: float
    rows: int
    iterations: int
    step_mm: float
    reduced: Reduction | Callable[[], Reduction] = field(repr=False)
    precision: Array | None = field(default=None, repr=False)
    weak: WeakPrior = field(default_factory=WeakPrior, repr=False)

    @cached_property
    def reduction(self) -> Reduction:
        """The rows, linearised at theta and reduced."""
        if isinstance(self.reduced, Reduction):
            return self.reduced
        return self.reduced()

    @property
    def terms(self) -> tuple[Term, ...]:
        """The model's terms, in the order of theta."""
        return self.model.terms

    def locate(self, mechanism: Mechanism) -> list[int]:
        """Locate the terms of one of its mechanisms among the model's."""
        place = {term.key: k for k, term in enumerate(self.terms)}
        return [place[term.key] for term in mechanism.terms]

    @property
    def rank(self) -> int:
        """Number of parameters that the data determine: the fitted terms, less the combinations that
        the prior determines more."""
        fitted = self.found.rank
        return fitted - self.weak.held

    @property
    def settled(self) -> bool:
        """Whether the iteration has arrived at the minimum."""
        return self.step_mm <= UNSETTLED_MM

    @cached_property
    def freedom(self) -> float:
        """Rows minus what the fit has used: the fitted terms, or the trace of the hat matrix where
        a prior holds some."""
        kept = list(self.found.kept)
        held = self.root[:, kept] @ self.factor[kept]
        return float(self.rows - len(kept) + np.square(held).sum())

    @property
    def by_prior(self) -> int:
        """Number of fitted terms with rows of a prior: they take no degree of freedom from the noise."""
        precision = self.precision
        if precision is None:
            return self.weak.count
        kept = list(self.found.kept)
        is_shrunk = precision[kept] > 0
        count = int(is_shrunk.sum())
        return count + self.weak.count

    @cached_property
    def sigma(self) -> float:
        """Residual standard deviation of one whitened coordinate; above zero for a model that leaves
        nothing."""
        if self.freedom <= 0:
            return float("nan")
        mean_square = self.rss / self.freedom
        variance = max(mean_square, TINY)
        return float(np.sqrt(variance))

    @cached_property
    def standard_errors(self) -> Array:
        """Standard errors (p,) from the residual variance; zero where a term is not estimable."""
        factor = self.factor
        variance = (factor**2).sum(1)
        errors: Array = np.sqrt(variance) * self.sigma
        return errors

    @cached_property
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
        return prior_rows(self.root, self.theta)

    @property
    def representatives(self) -> tuple[int, ...]:
        """Fitted terms that do not depend on earlier ones."""
        return tuple(k for k in self.found.exact if k in self.found.kept)

    @cached_property
    def beyond(self) -> float:
        """Degrees of freedom beyond all that the model can explain at any size: rows minus the trace
        of the hat matrix of its representatives, shrunk terms with their variance."""
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

    def __repr__(self) -> str:
        settled = "settled" if self.settled else "not settled"
        coordinates = count_words(self.rows, "coordinate")
        lines = [
            f"Fit of {self.model.describe()}, rank {self.rank}",
            f"  {coordinates}, residual standard deviation {self.sigma:.4g} (whitened)",
            f"  {settled} after {count_words(self.iterations, 'iteration')}",
        ]
        return "\n".join(lines)

    def at(self) -> Linearisation:
        """Return the point to linearise other models at."""
        return Linearisation(self.terms, self.theta)

    def residuals(self, problem: Problem) -> Array:
        """Compute the exact residuals (m, c) [mm, rad] of a problem under this fit."""
        check_type("problem", problem, (Problem, Source), PROBLEM_EXPECTED)
        return residuals(problem, self.terms, self.theta)


def cost(reduction: Reduction) -> float:
    """Return the sum of squares of the response."""
    return float(np.square(reduction.R[:, -1]).sum())


def fit(  # noqa: PLR0913  all but two have defaults
    problem: Problem | Source,
    model: Model,
    *,
    precision: Array | None = None,
    iterations: int = ITERATIONS,
    start: Array | None = None,
    step_mm: float = STEP_MM,
    held: Held = "geometry",
    fold_of: Index | None = None,
) -> Fit:
    """Fit a model to a problem by least squares.

    `precision` (p,): prior 1/variance of each term in whitened units, about zero, the terms of a free
    function correlated (`splines`). `held`: what the prior of usual sizes holds where the data hardly
    determine it: "geometry"; "all", the terms of mechanisms too (not while these are being named, where
    usual sizes must have no influence); or "nothing", where terms that depend on earlier ones are fixed
    at zero. `start`: parameters to start from. `fold_of` (m,): keep the reduction of very many rows
    fold by fold.

    Gauss-Newton on the exact chain, until the norm of a step over all rows is below `step_mm`. Then what is
    fitted, fixed, and held by the prior is judged at the solution, and the iteration continues until
    that stays the same, each time by at most so many `iterations`. To very many rows the model is fitted
    from the fit to a sample.

    Raises NotEstimable where the data have no more coordinates than the model has estimable
    parameters, or the iteration does not settle; StudyError for a model that is none."""
    check_type("problem", problem, (Problem, Source), PROBLEM_EXPECTED)
    check_type("model", model, Model, MODEL_EXPECTED)
    check_whole_number("iterations", iterations, 1)
    check_numbers("step_mm", step_mm, (), "a length [mm]")
    check_type("held", held, str, '"geometry", "all" or "nothing"')
    size = (len(model.terms),)
    if precision is not None:
        precision = check_numbers("precision", precision, size, EACH_PARAMETER)
    if start is not None:
        start = check_numbers("start", start, size, EACH_PARAMETER)
    if isinstance(problem, Problem) and takes_sample(problem, model, held):
        sample = draw_sample(problem)
        first = fit(
            sample, model, precision=precision, start=start, step_mm=SAMPLE_STEP_MM, held=held
        )
        start = first.theta
        solver = sampled_solver(problem, sample, first, held, fold_of)
    else:
        if start is None and isinstance(problem, Problem) and problem.whitening.stated is not None:
            # far from the solution an error of the arm resembles what rows share
            start = fit(problem.as_stated(), model, precision=precision, held=held).theta
        solver = solver_of(problem, model, precision, held)
    theta = np.zeros(len(model.terms)) if start is None else start
    state = begin(solver, theta, precision, iterations, step_mm)
    return finish(solver, state, step_mm)


def solver_of(
    problem: Problem | Source, model: Model, precision: Array | None, held: Held
) -> Solver:
    """Return the solver of a model's fits to all rows; terms of positive `precision` are shrunk."""
    shrunk = np.zeros(len(model.terms), dtype=bool) if precision is None else precision > 0
    weight = problem.whitening.typical_weight()
    return Solver(problem, model, shrunk, weight, held, WholeProblem())


def sampled_solver(
    problem: Problem, sample: Problem, first: Fit, held: Held, fold_of: Index | None
) -> Solver:
    """Return the solver of very many rows that starts from the `first` fit, to a sample of them."""
    of_sample = solver_of(sample, first.model, first.precision, held)
    strategy = SampledRows(of_sample, first.reduction, fold_of)
    return replace(of_sample, problem=problem, strategy=strategy)


def begin(
    solver: Solver, theta: Array, precision: Array | None, iterations: int, step_mm: float
) -> State:
    """Solve from parameters theta (p,). Raises NotEstimable."""
    strategy = solver.strategy
    from_nominal = solver.held == "nothing" or not theta.any()
    found = solver.at_nominal() if from_nominal else fitted_terms(solver.exact, solver.model)
    prior = Shrinkage.of(solver.model.terms, precision)
    state = strategy.begin(solver, found.confine(theta), prior, found)
    if from_nominal:
        state = strategy.solve(solver, state, iterations, step_mm)
    return go_on(solver, state, iterations, step_mm)


def go_on(solver: Solver, state: State, iterations: int, step_mm: float) -> State:
    """Continue an iteration until what is fitted stays the same. Raises NotEstimable."""
    strategy = solver.strategy
    if solver.held != "nothing":
        state = strategy.settle(solver, state, iterations, step_mm)
    is_whole = iterations == ITERATIONS
    should_settle = is_whole and strategy.must_settle
    solver.refuse(state, should_settle, step_mm)
    return state


def finish(solver: Solver, state: State, step_mm: float) -> Fit:
    """Confirm the end of an iteration, and return the fit there.

    Of an intermediate fit the rows are not reduced: its uncertainty is that of the triangle that the
    last step was computed from."""
    if step_mm >= COARSE_MM and isinstance(solver.strategy, WholeProblem):
        return _finish_coarse(solver, state)
    state, reduction = solver.strategy.conclude(solver, state, step_mm)
    model, theta, kept = solver.model, state.theta, state.found.kept
    full = with_prior(reduction, state.root, theta)
    return Fit(
        model,
        theta,
        state.found,
        factor_of(full, kept),
        cost(reduction),
        reduction.rows,
        state.iterations,
        state.step_mm,
        reduction,
        state.shrinkage.precision,
        state.weak,
    )


def _finish_coarse(solver: Solver, state: State) -> Fit:
    """Return an intermediate fit; its rows are reduced when they are asked for."""
    from scipy.linalg import solve_triangular

    theta = state.theta
    terms = solver.model.terms
    order = list(state.triangle.order)
    count = len(order)
    factor = np.zeros((len(theta), count))
    factor[order] = solve_triangular(state.factor, np.eye(count), check_finite=False)
    reduce = partial(reduce_problem, solver.problem, terms, Linearisation(terms, theta))
    return Fit(
        solver.model,
        theta,
        state.found,
        factor,
        state.slope.squares,
        solver.count,
        state.iterations,
        state.step_mm,
        reduce,
        state.shrinkage.precision,
        state.weak,
    )


def factor_of(full: Reduction, kept: Sequence[int]) -> Array:
    """Compute the covariance factor (p, rank) of the kept terms, zeros for the others."""
    shape = full.p, len(kept)
    factor = np.zeros(shape)
    columns = list(kept)
    _, solved, _ = solve(full, columns)
    factor[columns] = solved
    return factor
