"""Fits of smaller models to very many rows that were already reduced for a larger one.

`NestedModel` begins at the parameters of the larger model. The products of the columns are taken from
that reduction, since they hardly change with the parameters. Each step goes to the minimum of the
expanded squares; the rows are visited there for the exact gradient alone, so that the end is the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from .._typing import Array
from ..mechanisms.terms import Term
from .design import Model
from .expansion import Expansion
from .folded_rows import FoldedProblem, Point, measure_slopes
from .identifiability import Identified
from .iteration import State, minimise_expanded
from .least_squares import STEP_MM, Fit, begin, finish, solver_of
from .prior import Shrinkage
from .problem import Problem
from .reduction import Reduction, merged
from .sampled import QUICK, draw_sample, respond, takes_sample
from .shrinkage import weigh_groups, wide_groups
from .solver import ITERATIONS, Held, Solver

# steps by the known products, each a pass over the rows
STEPS = 6


class TooFar(ArithmeticError):
    """The minimum is too far from where the rows were reduced for the products there to be used."""


@dataclass(frozen=True, eq=False)
class Reduced:
    """Rows that were reduced fold by fold, linearised at theta (p,) of some terms.

    `exact`: indices of the terms that depend on no earlier one; `folded`: the rows; `precision` (p,):
    of shrunk terms, None without any."""

    terms: Sequence[Term]
    theta: Array
    reduction: Reduction
    exact: frozenset[int]
    folded: FoldedProblem
    precision: Array | None = None

    @staticmethod
    def by(fitted: Fit, folded: FoldedProblem) -> Reduced:
        """Return the rows as a fit reduced them, fold by fold."""
        reduction = fitted.reduction
        exact = frozenset(fitted.found.exact)
        return Reduced(fitted.terms, fitted.theta, reduction, exact, folded, fitted.precision)

    def select(self, model: Model) -> Reduced | None:
        """Select the terms of a smaller model; None where one of its terms was not reduced."""
        place = {term.key: k for k, term in enumerate(self.terms)}
        chosen = [place.get(term.key, -1) for term in model.terms]
        if -1 in chosen:
            return None
        reduction = self.reduction.select(chosen)
        exact = frozenset(k for k, number in enumerate(chosen) if number in self.exact)
        precision = None if self.precision is None else self.precision[chosen]
        return Reduced(model.terms, self.theta[chosen], reduction, exact, self.folded, precision)


@dataclass(frozen=True, eq=False)
class NestedModel:
    """Strategy of fits to rows that are already reduced, linearised at a point nearby.

    sample: the solver of a sample of the rows; reduced: the rows, reduced on the model's terms."""

    must_settle: ClassVar[bool] = False  # a last step by an exact gradient is accepted
    sample: Solver
    reduced: Reduced

    def find_dependences(self, solver: Solver) -> Identified:
        """Find what the data determine: as the sample says, where what depends on other terms there
        did so in every row when all were reduced."""
        found = self.sample.exact
        lost = set(solver.free) - set(found.exact)
        wrongly = lost & self.reduced.exact
        if wrongly:
            return solver.identified(solver.nominal)
        return found

    def begin(self, solver: Solver, theta: Array, prior: Shrinkage, found: Identified) -> State:
        """Begin near where the rows were reduced, with represented parameters at zero: along a
        combination that moves the arm by products of errors alone, the columns change too much."""
        point = solver.represent(self.reduced.theta)
        expansion = self._expand(solver, point)
        state = solver.start(expansion, prior, solver.exact)
        return replace(state, firm=True)

    def _expand(self, solver: Solver, theta: Array) -> Expansion:
        """Expand about theta (p,) with the columns as they were reduced and the exact gradient."""
        reduction = self.reduced.reduction
        at = Point(solver.model.terms, theta)
        (slopes,) = measure_slopes(self.reduced.folded, [at])
        parts = tuple(map(respond, reduction.parts, slopes))
        responding = Reduction(merged(parts).R, reduction.rows, parts)
        return Expansion.of_reduction(theta, responding)

    def solve(self, solver: Solver, state: State, iterations: int, step_mm: float) -> State:
        """Go to the minimum of the expanded squares."""
        return minimise_expanded(state)

    def settle(self, solver: Solver, state: State, iterations: int, step_mm: float) -> State:
        """Judge what is fitted and solve, until a step by the exact gradient is shorter than `step_mm`,
        or the next one would be. Raises TooFar where steps do not get shorter quickly."""
        size = np.inf
        for _ in range(STEPS):
            state = solver.settle_expanded(state, step_mm)
            expansion = state.expansion
            moved = expansion.distance(state.theta)
            step = moved / solver.weight
            leaves_less = step < step_mm or step * step < step_mm * size
            is_last = leaves_less and np.isfinite(size)
            if is_last:
                return replace(state, step_mm=step)
            if step > QUICK * size:
                break
            size = step
            expansion = self._expand(solver, state.theta)
            there = solver.moved(state, expansion)
            state = replace(there, step_mm=np.inf)
        raise TooFar

    def conclude(self, solver: Solver, state: State, step_mm: float) -> tuple[State, Reduction]:
        """Return the reduction shifted to the solution, which exact gradients have confirmed."""
        expansion = state.expansion
        reduction = expansion.reduction_at(state.theta)
        return state, reduction


def fit_within(problem: Problem, model: Model, reduced: Reduced, held: Held) -> Fit | None:
    """Fit a model whose terms are some of those that the rows were reduced on.

    `held` as in `fit`. None where the reduction cannot be used: a term is missing, there are too few
    rows for it, or the minimum is too far away."""
    own = reduced.select(model)
    groups = wide_groups(model)
    if own is None or (groups and own.precision is None):
        return None
    if not takes_sample(problem, model, held):
        return None
    precision = own.precision if groups else None
    sample = draw_sample(problem)
    of_sample = solver_of(sample, model, precision, held)
    strategy = NestedModel(of_sample, own)
    solver = replace(of_sample, problem=problem, strategy=strategy)
    try:
        state = begin(solver, own.theta, precision, ITERATIONS, STEP_MM)
        if groups and precision is not None:
            state = weigh_groups(solver, state, groups, precision, STEP_MM)
    except TooFar:
        return None
    return finish(solver, state, STEP_MM)
