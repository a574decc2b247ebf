"""Fits to very many rows, starting from the fit to a sample of them.

Which terms depend on others is found on the sample and checked on all rows. The sample's products,
scaled up, are so close to those of all rows that a few steps, with the exact gradient of all rows,
lead to the solution. The rows are reduced there once, and the remaining steps are linear."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .._typing import Array, Index
from .design import Model
from .expansion import Expansion
from .gradient import Slope
from .identifiability import Identified
from .iteration import Before, State, compute_direction, extrapolate
from .linearisation import Linearisation
from .prior import WeakPrior
from .problem import Problem
from .reduction import TOLERANCE, Reduction, merged, mix_dependent, reduce_folds
from .solver import ROUNDS, STUCK, Held, Solver

# rows, of which a sample is fitted first
MANY_ROWS = 50_000
# share of them that is the sample; of many rows it is itself fitted from a sample
SHARE = 1 / 8
GOLDEN = (np.sqrt(5) - 1) / 2
# distance from a point [mm, rms of a coordinate] at which its columns have changed by 1e-7
NEAR_MM = 1e-4
# step at which the sample's own fit ends [mm]: its solution is off by far more, by chance
SAMPLE_STEP_MM = 1e-2
# largest number of steps by the sample's products; largest ratio of a step to the one before; and the
# ratio to expect from the sampling of the products, in their standard errors
STEPS = 8
QUICK = 0.2
SPREAD = 3.0
# relative gain of the cost that changes no reported figure
GAIN = 1e-7
# damping of a step that overshoots, relative to the columns' squares, and its growth if that fails
FIRST_DAMPING, MORE_DAMPING = 1e-6, 100.0
# largest number of times that the rows are reduced for one fit
EXPANSIONS = 3


def takes_sample(problem: Problem, model: Model, held: Held) -> bool:
    """Return whether a model is fitted from the fit to a sample of the rows.

    Not where rows share errors: a sample would tear these apart."""
    may_judge = bool(model.terms) and held != "nothing"
    is_plain = problem.only_points and problem.whitening.shared is None
    return may_judge and is_plain and len(problem) > MANY_ROWS


def draw_sample(problem: Problem) -> Problem:
    """Return the problem of a share of the rows, spread evenly over all, at no fixed distance."""
    count = int(SHARE * len(problem))
    number = np.arange(count)
    place = number + np.mod(number * GOLDEN, 1.0)
    rows = (place * len(problem) / count).astype(np.intp)
    return problem.take(rows)


def respond(reduction: Reduction, slope: Slope) -> Reduction:
    """Return a reduction with the response that gives it an exact gradient, `slope`."""
    columns = reduction.R[:, :-1]
    norm = np.linalg.norm(columns, axis=0)
    norm = np.where(norm > 0, norm, 1.0)
    response, *_ = np.linalg.lstsq((columns / norm).T, slope.products / norm, rcond=TOLERANCE)
    left = slope.squares - float(response @ response)
    response[-1] = np.sqrt(max(left, 0.0))
    return Reduction(np.column_stack([columns, response]), reduction.rows)


@dataclass(frozen=True, eq=False)
class SampledSolver(Solver):
    """Fits a model to very many rows.

    sample: the solver of a sample of the rows.
    reduction: the sample's rows, reduced at its solution.
    fold_of: (m,) the folds by which the rows are reduced."""

    sample: Solver
    reduction: Reduction
    fold_of: Index | None = None

    @cached_property
    def exact(self) -> Identified:
        """What the data determine at the nominal chain: as found on the sample if all rows agree."""
        found = self.sample.exact
        if not self.agrees(found):
            return self.identified(self.nominal)
        return replace(
            found, scale=self.growth * found.scale, triangle=self.growth * found.triangle
        )

    @property
    def growth(self) -> float:
        """Ratio of a column's norm over all rows to that over the sample."""
        return float(np.sqrt(len(self.problem) / len(self.sample.problem)))

    def agrees(self, found: Identified) -> bool:
        """Return whether terms that depend on others in the sample do so in every row.

        A random mixture of the differences between these terms and the combinations that represent
        them must be zero up to rounding."""
        kept = list(found.exact)
        lost = [k for k in self.free if k not in kept]
        if not lost:
            return True
        relation = found.relation[lost].T
        rows = len(self.sample.problem)
        mixture, bound = mix_dependent(found.scale, kept, lost, relation, rows)
        nominal = np.zeros(len(mixture))
        return all(
            np.abs(change).max() <= bound / self.weight
            for _, _, change in self.rows.along(nominal, mixture)
        )

    def begin(
        self,
        theta: Array,
        precision: Array | None,
        found: Identified,
        expansion: Expansion | None = None,
    ) -> State:
        """Begin near the solution, where steps by the exact gradient and the sample's products lead
        from theta (p,); at theta itself where the sample lacks a fitted column."""
        shown = np.flatnonzero(self.reduction.R.any(axis=0))
        if not np.isin(found.kept, shown).all():
            return super().begin(theta, precision, found, expansion)
        theta = np.where(np.isin(np.arange(len(theta)), found.kept), theta, 0.0)
        slope = self.rows.at(theta)
        state = super().begin(theta, precision, found, self.expand_sample(theta, slope))
        return self.expanded(self.approach(replace(state, slope=slope)))

    def approach(self, state: State) -> State:
        """Approach the solution by the exact gradient and the sample's products, as long as that
        lowers the cost.

        Far from the nominal arm the sample may not determine a direction along which the rows do
        change, so steps that overshoot are damped."""
        size, share = np.inf, SPREAD * np.sqrt(len(state.theta) / self.sample.count)
        for _ in range(STEPS):
            state = self.judge(state)
            if state.far is not None and not state.damping:
                state = replace(state, damping=FIRST_DAMPING)
            delta, step = compute_direction(state)
            if np.isfinite(size):
                share = step / size
            there = replace(state, theta=state.theta + delta)
            if step * share < self.near and not state.damping:
                return there
            there = replace(there, slope=self.rows.at(there.theta))
            gained = state.cost - there.cost
            if gained < 0:
                damping = max(MORE_DAMPING * state.damping, FIRST_DAMPING)
                state, size = replace(state, damping=damping), np.inf
                continue
            state, size = there, step
            if gained < GAIN * state.cost or share > QUICK:
                break
        return replace(state, damping=0.0)

    def expand_sample(self, theta: Array, slope: Slope) -> Expansion:
        """Expand about theta (p,) with the exact gradient there and the products of the sample's
        columns, scaled up to all rows."""
        grown = Reduction(self.growth * self.reduction.R, self.count)
        return Expansion.of_reduction(theta, respond(grown, slope))

    def reduce(self, theta: Array, only: object = None) -> Reduction:
        """Reduce the rows at theta (p,), fold by fold."""
        assert isinstance(self.problem, Problem)
        terms = self.model.terms
        at = Linearisation(terms, theta) if theta.any() else None
        folds = self.fold_of
        if folds is None:
            folds = np.zeros(len(self.problem), dtype=np.intp)
        parts = reduce_folds(self.problem, terms, folds, at)
        whole = merged(parts)
        return whole if self.fold_of is None else replace(whole, parts=tuple(parts))

    def reduce_free(self, expansion: Expansion) -> Reduction:
        """Return the reduction of the terms without a prior variance, at an expansion's point."""
        assert expansion.reduction is not None
        return expansion.reduction.select(self.free)

    def expand(self, theta: Array) -> Expansion:
        """Expand the squares about theta (p,)."""
        return Expansion.of_reduction(theta, self.reduce(theta))

    def expanded(self, state: State) -> State:
        """Expand the squares about the present theta, with the exact gradient there."""
        expanded = super().expanded(state)
        return replace(expanded, slope=expanded.expansion.slope)

    @property
    def near(self) -> float:
        """Largest distance, whitened and over all rows, from the point of an expansion that is used."""
        return NEAR_MM * self.weight * float(np.sqrt(self.count))

    def is_near(self, state: State, step_mm: float) -> bool:
        """Return whether the expansion is as good as one about theta, whatever the step."""
        return state.expansion.distance(state.theta) < self.near

    def settle(self, state: State, iterations: int, step_mm: float) -> State:
        """Judge what is fitted and solve, until that stays the same.

        The rows are reduced again if the solution is far from the point of the last reduction. If the
        exact cost is higher at the solution, the fit ends at that point."""
        if state.damping:
            return self.judge(state)
        for _ in range(EXPANSIONS):
            state = self.settle_linear(state, iterations, step_mm)
            if self.is_near(state, step_mm):
                return state
            start = self.restart(state)
            there = replace(state, slope=self.rows.at(state.theta))
            if there.cost > start.cost:
                return replace(start, damping=STUCK)
            state = self.expanded(there)
        return state

    def settle_linear(self, state: State, iterations: int, step_mm: float) -> State:
        """Judge what is fitted and solve, about the point of one expansion."""
        earlier: list[WeakPrior] = []
        for _ in range(ROUNDS):
            judged = self.judge(state)
            has_more = judged.weak.count > state.weak.count
            returns = not has_more and any(judged.weak.like(weak) for weak in earlier)
            stays = returns or judged.weak.like(state.weak)
            if judged.found.kept == state.found.kept and stays and state.step_mm < step_mm:
                break
            earlier.append(state.weak)
            state = self.solve(judged, iterations, step_mm)
        return state

    def restart(self, state: State) -> State:
        """Return to the point of the expansion."""
        expansion = state.expansion
        step = expansion.distance(state.theta) / self.weight
        return replace(state, theta=expansion.theta, slope=expansion.slope, step_mm=step)

    def confirm(self, state: State, step_mm: float) -> State:
        """Step on by the exact gradient, until a step is shorter than `step_mm` or no shorter than
        the one before.

        If that leads far, the rows are reduced once more. Steps that do not get shorter quickly are
        accelerated."""
        size, again, before = np.inf, True, None
        for _ in range(STEPS):
            exact = replace(state, slope=self.rows.at(state.theta), before=before)
            delta, step = compute_direction(replace(exact, damping=0.0))
            exact = replace(exact, step_mm=step / self.weight)
            if state.damping or step < step_mm * self.weight or step > size:
                return exact
            if not self.is_near(exact, step_mm) and again:
                state = self.settle(self.expanded(exact), 1, step_mm)
                size, again, before = np.inf, False, None
                continue
            is_slow = before is not None and step > QUICK * size
            move = extrapolate(exact, delta) if is_slow else delta
            state, size, before = (
                replace(exact, theta=exact.theta + move),
                step,
                Before(exact.theta, delta),
            )
        return state

    def refuse(self, state: State, settled: bool, step_mm: float) -> None:
        """Raise NotEstimable where the data have no more coordinates than the model has parameters.

        A fit that did not settle, but whose cost gets no lower, is accepted."""
        super().refuse(state, False, step_mm)

    def solve(self, state: State, iterations: int, step_mm: float) -> State:
        """Go to the minimum of the expanded squares, which takes one step."""
        delta, _ = compute_direction(replace(state, damping=0.0))
        theta = state.theta + delta
        slope = state.expansion.slope_at(theta)
        count = state.iterations + 1
        return replace(state, theta=theta, slope=slope, step_mm=0.0, iterations=count)

    def conclude(self, state: State) -> Reduction:
        """Return the expansion's reduction, which is near the solution, shifted to it."""
        expansion = state.expansion
        reduction = expansion.reduction
        assert reduction is not None
        return reduction.shift(state.theta - expansion.theta)
