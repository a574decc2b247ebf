"""Gauss-Newton on all rows of a problem, whose squares are expanded seldom: steps by the triangle of
a point nearby and the exact gradient.

`WholeProblem` judges what is fitted and iterates in turns. An iteration ends where steps are short. A
step that does not lower the cost asks for an expansion where it began, then for damping. Data too large
for memory (`Source`) have no rows to evaluate: there every step expands."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from .._typing import Array
from .expansion import Expansion
from .identifiability import Identified
from .iteration import COARSE_MM, SLOW, Before, State, compute_direction, extrapolate
from .linearisation import Linearisation
from .prior import Shrinkage, WeakPrior
from .problem import Problem
from .reduction import PROBE, Reduction, Source, multiply_problem
from .solver import ROUNDS, STUCK, Solver

ROUNDING = 1e-9  # of the cost: smaller gains may be rounding
LEAST_DAMPING = 1e-9  # of a column's square
# all rows together: as far does the triangle change by nothing that counts, in the last fit and in
# intermediate ones
NEAR_MM, NEAR_COARSE_MM = 1e-5, 1.0


@dataclass(frozen=True)
class WholeProblem:
    """Strategy of fits that go over all rows."""

    must_settle: ClassVar[bool] = True

    def find_dependences(self, solver: Solver) -> Identified:
        """Find what the data determine, by all rows at the nominal chain."""
        return solver.identified(solver.nominal)

    def begin(self, solver: Solver, theta: Array, prior: Shrinkage, found: Identified) -> State:
        """Begin at parameters theta (p,)."""
        expansion = expand_squares(solver, theta)
        return solver.start(expansion, prior, found)

    def solve(self, solver: Solver, state: State, iterations: int, step_mm: float) -> State:
        """Iterate Gauss-Newton over the kept terms, damped where it overshoots."""
        count = 0
        state = replace(state, step_mm=np.inf, share=0.0, own=False, damping=0.0, before=None)
        while count < iterations and state.damping < STUCK and not state.rests(step_mm):
            count += 1
            state = _step(solver, state, step_mm)
        return replace(state, iterations=state.iterations + count)

    def settle(self, solver: Solver, state: State, iterations: int, step_mm: float) -> State:
        """Judge what is fitted and solve again, until the judgement stays at the point of an
        expansion."""
        earlier: list[WeakPrior] = []
        for _ in range(ROUNDS):
            judged = solver.judge(state)
            stays = judged.stays(state, earlier)
            has_arrived = state.step_mm < step_mm or state.damping >= STUCK
            if stays and has_arrived:
                if _is_near(solver, state, step_mm):
                    break
                expanded = _expand_here(solver, state)
                judged, earlier = solver.judge(expanded), []
            earlier.append(state.weak)
            state = self.solve(solver, judged, iterations, step_mm)
        return state

    def conclude(self, solver: Solver, state: State, step_mm: float) -> tuple[State, Reduction]:
        """Reduce the rows at the solution, which exact gradients have confirmed."""
        theta, many = state.theta, len(solver.problem) > PROBE[1]
        only = list(state.found.kept) if theta.any() and many else None
        return state, solver.reduce(theta, only)


def expand_squares(solver: Solver, theta: Array) -> Expansion:
    """Expand the squares of all rows about theta (p,): by products where that is cheaper."""
    problem, terms = solver.problem, solver.model.terms
    is_nominal = not theta.any() and not solver.shrunk.any()
    if isinstance(problem, Source) or is_nominal:
        return Expansion.of_reduction(theta, solver.reduce(theta))
    only = solver.free if solver.arm.is_far(theta) else ()
    products, free = multiply_problem(problem, terms, Linearisation(terms, theta), only)
    return Expansion.of_products(theta, products, free=free if only else None)


def _expand_here(solver: Solver, state: State) -> State:
    """Expand the squares anew, where the iteration stands."""
    expansion = expand_squares(solver, state.theta)
    return solver.renewed(state, expansion)


def _is_near(solver: Solver, state: State, step_mm: float) -> bool:
    """Whether the expansion is as good as one about theta."""
    near_mm = NEAR_COARSE_MM if step_mm >= COARSE_MM else NEAR_MM
    return state.expansion.distance(state.theta) < near_mm * solver.weight


def _step(solver: Solver, state: State, step_mm: float) -> State:
    """Take a step, or find that it is none: then by a triangle of this point, or damped."""
    own = _is_near(solver, state, step_mm)
    delta, size = compute_direction(state)
    step = size / solver.weight
    there = _reach(solver, state, delta)
    least = state.cost * (1 + ROUNDING)
    lower = there.cost <= least
    if step < step_mm and there.cost > least + size**2:
        # what should move no row does: data without noise hold such steps by nothing but rounding
        return replace(state, damping=STUCK, step_mm=step)
    if lower or step < step_mm:
        share = step / state.step_mm
        there = replace(there, step_mm=step, share=share, own=own, growth=2.0)
        there = replace(there, damping=_relax_damping(state, delta, state.cost - there.cost))
        is_slow = share > SLOW and not there.rests(step_mm)
        return _expand_here(solver, there) if is_slow else there
    if not own:
        return _expand_here(solver, state)
    if _expect_gain(state, delta) <= ROUNDING * state.cost:
        _, following = compute_direction(there)
        if following < size:
            # the cost is too rough to tell, but there the next step is shorter
            return replace(there, step_mm=step, share=step / state.step_mm, own=own)
        # the minimum, to rounding: no shorter step can be told from none
        return replace(state, damping=STUCK, step_mm=max(step, step_mm))
    # overshot: Levenberg-Marquardt from the same point
    damping = max(state.growth * state.damping, LEAST_DAMPING)
    growth = 2 * state.growth
    return replace(state, damping=damping, growth=growth, step_mm=max(step, step_mm))


def _expect_gain(state: State, delta: Array) -> float:
    """Return by how much the expansion expects a step (p,) to lower the cost."""
    order = list(state.triangle.order)
    moved = state.factor @ delta[order]
    return float(2 * state.uphill @ delta - moved @ moved)


def _relax_damping(state: State, delta: Array, gained: float) -> float:
    """Return the damping after a step (p,) that lowered the cost by `gained`.

    It is reduced where the gain is what the expansion predicted (Nielsen 1999, IMM-REP-1999-05)."""
    expected = _expect_gain(state, delta)
    is_told = expected > ROUNDING * state.cost
    ratio = max(gained / expected, 0.0) if is_told else 1.0
    damping = state.damping * max(0.1, 1 - (2 * ratio - 1) ** 3)
    return damping if damping > LEAST_DAMPING else 0.0


def _reach(solver: Solver, state: State, delta: Array) -> State:
    """Go by a step (p,), accelerated where steps do not get shorter quickly; where it overshoots,
    by what the step from beyond says."""
    can_evaluate = isinstance(solver.problem, Problem) and not state.damping
    if can_evaluate and state.before is not None and state.share > SLOW:
        there = _move(solver, state, delta, extrapolate(state, delta))
        if there.cost <= state.cost:
            return there
    there = _move(solver, state, delta, delta)
    if can_evaluate and there.cost > state.cost * (1 + ROUNDING):
        back, _ = compute_direction(there)
        turned = _move(solver, there, back, extrapolate(there, back))
        if turned.cost <= state.cost:
            return turned
    return there


def _move(solver: Solver, state: State, delta: Array, change: Array) -> State:
    """Evaluate at theta changed by (p,), which the step `delta` (p,) asked for; without rows to
    evaluate, expand there."""
    theta = state.theta + change
    before = Before(state.theta, delta)
    if isinstance(solver.problem, Problem):
        slope = solver.rows.at(theta)
        return replace(state, theta=theta, slope=slope, before=before)
    expansion = expand_squares(solver, theta)
    there = solver.moved(state, expansion)
    return replace(there, before=before)
