"""Fits of smaller models to very many rows that were already reduced for a larger one.

The products of the columns are taken from that reduction, since they hardly change with the
parameters. The rows are visited for the exact gradient alone, so that the minimum is the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .._typing import Array
from ..mechanisms.terms import Term
from .design import Model
from .expansion import Expansion
from .folded_rows import FoldedProblem, Point, measure_slopes
from .identifiability import Identified
from .iteration import State
from .least_squares import STEP_MM, Fit, begin, finish, solver_of
from .problem import Problem
from .reduction import Reduction, merged
from .sampled import QUICK, SampledSolver, draw_sample, respond, takes_sample
from .shrinkage import weigh_groups, wide_groups
from .solver import ITERATIONS, Held

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


@dataclass(frozen=True, eq=False, kw_only=True)
class NestedSolver(SampledSolver):
    """Fits a model to rows that are already reduced, linearised at a point nearby."""

    reduced: Reduced

    @cached_property
    def exact(self) -> Identified:
        """What the data determine at the nominal chain: as the sample says, where what depends on
        other terms there did so in every row when all were reduced."""
        found = self.sample.exact
        told = set(found.exact)
        lost = set(self.free) - told
        wrongly = lost & self.reduced.exact
        if wrongly:
            return self.identified(self.nominal)
        return found

    def begin(
        self,
        theta: Array,
        precision: Array | None,
        found: Identified,
        expansion: Expansion | None = None,
    ) -> State:
        """Begin near where the rows were reduced, with represented parameters at zero: along a
        combination that moves the arm by products of errors alone, the columns change too much."""
        point = self.represent(self.reduced.theta)
        start = self.expand(point)
        state = super(SampledSolver, self).begin(point, precision, self.exact, start)
        return replace(state, firm=True)

    def reduce(self, theta: Array, only: object = None) -> Reduction:
        """Return the columns as they were reduced, with the exact gradient at theta (p,)."""
        at = Point(self.model.terms, theta)
        (slopes,) = measure_slopes(self.reduced.folded, [at])
        parts = tuple(map(respond, self.reduction.parts, slopes))
        return Reduction(merged(parts).R, self.reduction.rows, parts)

    def settle(self, state: State, iterations: int, step_mm: float) -> State:
        """Judge what is fitted and solve, until a step by the exact gradient is shorter than `step_mm`,
        or the next one would be. Raises TooFar where steps do not get shorter quickly."""
        size = np.inf
        for _ in range(STEPS):
            state = self.settle_linear(state, iterations, step_mm)
            expansion = state.expansion
            moved = expansion.distance(state.theta)
            step = moved / self.weight
            leaves_less = step < step_mm or step * step < step_mm * size
            if leaves_less and np.isfinite(size):
                return replace(state, step_mm=step)
            if step > QUICK * size:
                break
            size = step
            there = self.expanded(state)
            state = replace(there, step_mm=np.inf)
        raise TooFar

    def confirm(self, state: State, step_mm: float) -> State:
        """Return the state as it is: the last steps were by exact gradients already."""
        return state


def fit_within(problem: Problem, model: Model, reduced: Reduced, held: Held) -> Fit | None:
    """Fit a model whose terms are some of those that the rows were reduced on.

    `held` as in `fit`. None where the reduction cannot be used: a term is missing, there are too few
    rows for it, or the minimum is too far away."""
    own = reduced.select(model)
    groups = wide_groups(model)
    if own is None or (groups and own.precision is None) or not takes_sample(problem, model, held):
        return None
    precision = own.precision if groups else None
    sample = draw_sample(problem)
    of_sample = solver_of(sample, model, precision, held)
    solver = NestedSolver(
        problem,
        model,
        of_sample.shrunk,
        of_sample.weight,
        held,
        of_sample,
        own.reduction,
        reduced=own,
    )
    try:
        state = begin(solver, own.theta, precision, ITERATIONS, STEP_MM)
        if groups and precision is not None:
            state = weigh_groups(solver, state, groups, precision, STEP_MM)
    except TooFar:
        return None
    return finish(solver, state)
