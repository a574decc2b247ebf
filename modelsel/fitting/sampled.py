"""Fits of very many rows, from the fit of a sample of them.

What depends on what is seen on the sample, and checked on all rows. The sample's products, scaled,
are so much like those of all rows that a few steps by the exact slope lead to the solution; the
rows are reduced there once, and what is left to do is linear."""

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
# mm of a coordinate (rms): as far from a point do its columns change by a ten millionth
NEAR_MM = 1e-4
# step of the sample's own fit [mm]: chance moves its solution by far more
SAMPLE_STEP_MM = 1e-2
# steps by the sample's products at most, what a step should leave of the one before, and what it
# leaves by the sample's own chance, in standard errors of its products
STEPS = 8
QUICK = 0.2
SPREAD = 3.0
# share of the cost below which a gain shows in no figure
GAIN = 1e-7
# damping of a step that overshoots, of the columns' squares, and what it grows by if it still does
FIRST_DAMPING, MORE_DAMPING = 1e-6, 100.0
# times that the rows are reduced for one fit
EXPANSIONS = 3


def takes_sample(problem: Problem, model: Model, held: Held) -> bool:
    """Return whether a model is fitted from the fit of a sample of the rows: not where they share
    errors, which a sample cuts."""
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
    """Return a reduction's columns with another response: the one of an exact slope."""
    columns = reduction.R[:, :-1]
    norm = np.linalg.norm(columns, axis=0)
    norm = np.where(norm > 0, norm, 1.0)
    response, *_ = np.linalg.lstsq((columns / norm).T, slope.products / norm, rcond=TOLERANCE)
    left = slope.squares - float(response @ response)
    response[-1] = np.sqrt(max(left, 0.0))
    return Reduction(np.column_stack([columns, response]), reduction.rows)


@dataclass(frozen=True, eq=False)
class SampledSolver(Solver):
    """Fits of a model to very many rows.

    sample: the same of a sample of them.
    reduction: the sample's rows, reduced at its solution.
    fold_of: (m,) the folds that the rows are reduced by."""

    sample: Solver
    reduction: Reduction
    fold_of: Index | None = None

    @cached_property
    def exact(self) -> Identified:
        """What the data determine at the nominal chain: as the sample says, where no row objects."""
        found = self.sample.exact
        if not self.agrees(found):
            return self.identified(self.nominal)
        return replace(
            found, scale=self.growth * found.scale, triangle=self.growth * found.triangle
        )

    @property
    def growth(self) -> float:
        """What a column's norm is of that in the sample."""
        return float(np.sqrt(len(self.problem) / len(self.sample.problem)))

    def agrees(self, found: Identified) -> bool:
        """Return whether terms that depend on others in the sample do so in every row: a random
        mixture of what they lack of their combinations must stay at rounding."""
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
        """Begin near the solution: steps by the exact slope and the sample's products lead there
        from theta (p,), where the sample shows all that is fitted."""
        shown = np.flatnonzero(self.reduction.R.any(axis=0))
        if not np.isin(found.kept, shown).all():
            return super().begin(theta, precision, found, expansion)
        theta = np.where(np.isin(np.arange(len(theta)), found.kept), theta, 0.0)
        slope = self.rows.at(theta)
        state = super().begin(theta, precision, found, self.expand_sample(theta, slope))
        return self.expanded(self.approach(replace(state, slope=slope)))

    def approach(self, state: State) -> State:
        """Approach the solution by the exact slope and the sample's products, as long as that lowers
        the cost.

        Far from the nominal arm these products may say nothing of a direction along which the rows
        change: steps that overshoot are damped."""
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
        """Return the expansion about theta (p,) of the exact slope there and the products of the
        sample's columns, which are much like those of all rows."""
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
        """Return the reduction at an expansion's point, of the terms that have no variance of their
        own."""
        assert expansion.reduction is not None
        return expansion.reduction.select(self.free)

    def expand(self, theta: Array) -> Expansion:
        """Expand the squares about theta (p,)."""
        return Expansion.of_reduction(theta, self.reduce(theta))

    def expanded(self, state: State) -> State:
        """Expand the squares anew, where the iteration stands; the slope is exact there."""
        expanded = super().expanded(state)
        return replace(expanded, slope=expanded.expansion.slope)

    @property
    def near(self) -> float:
        """How far all rows together may move, whitened, from a point whose expansion is used."""
        return NEAR_MM * self.weight * float(np.sqrt(self.count))

    def is_near(self, state: State, step_mm: float) -> bool:
        """Return whether the expansion is as good as one about theta, whatever the step."""
        return state.expansion.distance(state.theta) < self.near

    def settle(self, state: State, iterations: int, step_mm: float) -> State:
        """Judge what is fitted and solve, until that stays. The rows are reduced again where the
        solution is far from where they were; where the exact cost is higher there, the fit ends
        where they were."""
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
        """Go on from where the iteration has ended, until a step by the exact slope is shorter than
        `step_mm` or no shorter than the one before; where that leads far, the rows are reduced
        again, once. Steps that do not get shorter quickly are accelerated."""
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
        """Raise NotEstimable where the data have no more coordinates than the model has parameters;
        a fit that ends where its cost gets no lower is taken."""
        super().refuse(state, False, step_mm)

    def solve(self, state: State, iterations: int, step_mm: float) -> State:
        """Go to the minimum of the squares about the expansion's point: one step leads there."""
        delta, _ = compute_direction(replace(state, damping=0.0))
        theta = state.theta + delta
        slope = state.expansion.slope_at(theta)
        count = state.iterations + 1
        return replace(state, theta=theta, slope=slope, step_mm=0.0, iterations=count)

    def conclude(self, state: State) -> Reduction:
        """Return the reduction at the solution: that of the expansion, which is near."""
        expansion = state.expansion
        reduction = expansion.reduction
        assert reduction is not None
        return reduction.shift(state.theta - expansion.theta)
