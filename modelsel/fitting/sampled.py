"""Fits to very many rows, starting from the fit to a sample of them.

In the order in which `SampledRows` does it: which terms depend on others is found on the sample and
checked on all rows. The sample's products, scaled up, are so close to those of all rows that a few
steps, with the exact gradient of all rows, lead near the solution. The rows are reduced there. The
steps that settle what is fitted are linear: each goes to the minimum of the expanded squares. Where they
lead far, the rows are reduced again. At the end, steps by exact gradients confirm the solution."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from .._typing import Array, Index
from .design import Model
from .expansion import Expansion
from .gradient import Slope
from .identifiability import Identified
from .iteration import Before, State, compute_direction, extrapolate, minimise_expanded
from .linearisation import Linearisation
from .prior import Shrinkage
from .problem import Problem
from .reduction import TOLERANCE, Reduction, merged, mix_dependent, reduce_folds
from .solver import STUCK, Held, Solver

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
class SampledRows:
    """Strategy of fits to very many rows.

    sample: the solver of a sample of the rows.
    reduction: the sample's rows, reduced at its solution.
    fold_of: (m,) the folds by which the rows are reduced."""

    must_settle: ClassVar[bool] = False  # a fit whose cost gets no lower is accepted
    sample: Solver
    reduction: Reduction
    fold_of: Index | None = None

    def find_dependences(self, solver: Solver) -> Identified:
        """Find what the data determine: as found on the sample if all rows agree."""
        found = self.sample.exact
        if not self._agrees(solver, found):
            return solver.identified(solver.nominal)
        growth = self._growth(solver)
        return replace(found, scale=growth * found.scale, triangle=growth * found.triangle)

    def _agrees(self, solver: Solver, found: Identified) -> bool:
        """Return whether terms that depend on others in the sample do so in every row.

        A random mixture of the differences between these terms and the combinations that represent
        them must be zero up to rounding."""
        kept = list(found.exact)
        lost = [k for k in solver.free if k not in kept]
        if not lost:
            return True
        relation = found.relation[lost].T
        rows = len(self.sample.problem)
        mixture, bound = mix_dependent(found.scale, kept, lost, relation, rows)
        nominal = np.zeros(len(mixture))
        return all(
            np.abs(change).max() <= bound / solver.weight
            for _, _, change in solver.rows.along(nominal, mixture)
        )

    def _growth(self, solver: Solver) -> float:
        """Ratio of a column's norm over all rows to that over the sample."""
        return float(np.sqrt(len(solver.problem) / len(self.sample.problem)))

    def begin(self, solver: Solver, theta: Array, prior: Shrinkage, found: Identified) -> State:
        """Begin near the solution, where steps by the exact gradient and the sample's products lead
        from theta (p,); at theta itself where the sample lacks a fitted column."""
        shown = np.flatnonzero(self.reduction.R.any(axis=0))
        if not np.isin(found.kept, shown).all():
            return solver.start(self.expand(solver, theta), prior, found)
        slope = solver.rows.at(theta)
        start = solver.start(self.expand_sample(solver, theta, slope), prior, found)
        state = self.approach(solver, replace(start, slope=slope))
        return solver.moved(state, self.expand(solver, state.theta))

    def expand_sample(self, solver: Solver, theta: Array, slope: Slope) -> Expansion:
        """Expand about theta (p,) with the exact gradient there and the products of the sample's
        columns, scaled up to all rows."""
        grown = Reduction(self._growth(solver) * self.reduction.R, solver.count)
        reduction = respond(grown, slope)
        return Expansion.of_reduction(theta, reduction, reduction.select(solver.free))

    def approach(self, solver: Solver, state: State) -> State:
        """Approach the solution by the exact gradient and the sample's products, as long as that
        lowers the cost.

        Far from the nominal arm the sample may not determine a direction along which the rows do
        change, so steps that overshoot are damped."""
        size, share = np.inf, SPREAD * np.sqrt(len(state.theta) / self.sample.count)
        for _ in range(STEPS):
            state = solver.judge(state)
            if state.far is not None and not state.damping:
                state = replace(state, damping=FIRST_DAMPING)
            delta, step = compute_direction(state)
            if np.isfinite(size):
                share = step / size
            there = replace(state, theta=state.theta + delta)
            if step * share < _near(solver) and not state.damping:
                return there
            there = replace(there, slope=solver.rows.at(there.theta))
            gained = state.cost - there.cost
            if gained < 0:
                damping = max(MORE_DAMPING * state.damping, FIRST_DAMPING)
                state, size = replace(state, damping=damping), np.inf
                continue
            state, size = there, step
            if gained < GAIN * state.cost or share > QUICK:
                break
        return replace(state, damping=0.0)

    def expand(self, solver: Solver, theta: Array) -> Expansion:
        """Expand the squares about theta (p,), from the rows reduced there fold by fold."""
        assert isinstance(solver.problem, Problem)
        terms = solver.model.terms
        at = Linearisation(terms, theta) if theta.any() else None
        one_fold = np.zeros(len(solver.problem), dtype=np.intp)
        fold_of = one_fold if self.fold_of is None else self.fold_of
        parts = reduce_folds(solver.problem, terms, fold_of, at)
        kept = () if self.fold_of is None else tuple(parts)
        reduction = replace(merged(parts), parts=kept)
        return Expansion.of_reduction(theta, reduction, reduction.select(solver.free))

    def solve(self, solver: Solver, state: State, iterations: int, step_mm: float) -> State:
        """Go to the minimum of the expanded squares."""
        return minimise_expanded(state)

    def settle(self, solver: Solver, state: State, iterations: int, step_mm: float) -> State:
        """Judge what is fitted and solve, until that stays the same.

        The rows are reduced again if the solution is far from the point of the last reduction. If the
        exact cost is higher at the solution, the fit ends at that point."""
        if state.damping:
            return solver.judge(state)
        near = _near(solver)
        for _ in range(EXPANSIONS):
            state = solver.settle_expanded(state, step_mm)
            expansion = state.expansion
            distance = expansion.distance(state.theta)
            if distance < near:
                return state
            slope = solver.rows.at(state.theta)
            there = replace(state, slope=slope)
            start = replace(state, theta=expansion.theta, slope=expansion.slope)
            if there.cost > start.cost:
                step = distance / solver.weight
                return replace(start, step_mm=step, damping=STUCK)
            anew = self.expand(solver, state.theta)
            state = solver.moved(there, anew)
        return state

    def conclude(self, solver: Solver, state: State, step_mm: float) -> tuple[State, Reduction]:
        """Confirm the solution, and return the reduction near it, shifted to it."""
        confirmed = self._confirm(solver, state, step_mm)
        expansion = confirmed.expansion
        reduction = expansion.reduction_at(confirmed.theta)
        return confirmed, reduction

    def _confirm(self, solver: Solver, state: State, step_mm: float) -> State:
        """Step on by the exact gradient, until a step is shorter than `step_mm` or no shorter than
        the one before.

        If that leads far, the rows are reduced once more. Steps that do not get shorter quickly are
        accelerated."""
        size, again, before = np.inf, True, None
        for _ in range(STEPS):
            exact = replace(state, slope=solver.rows.at(state.theta), before=before)
            delta, step = compute_direction(replace(exact, damping=0.0))
            exact = replace(exact, step_mm=step / solver.weight)
            if state.damping or step < step_mm * solver.weight or step > size:
                return exact
            is_near = exact.expansion.distance(exact.theta) < _near(solver)
            if again and not is_near:
                there = solver.moved(exact, self.expand(solver, exact.theta))
                state = self.settle(solver, there, 1, step_mm)
                size, again, before = np.inf, False, None
                continue
            is_slow = before is not None and step > QUICK * size
            move = extrapolate(exact, delta) if is_slow else delta
            before, size = Before(exact.theta, delta), step
            state = replace(exact, theta=exact.theta + move)
        return state


def _near(solver: Solver) -> float:
    """Largest distance, whitened and over all rows, from the point of an expansion that is used."""
    return NEAR_MM * solver.weight * float(np.sqrt(solver.count))
