"""Gauss-Newton with few reductions of the rows: steps by the triangle of a point nearby and the
exact gradient, and judgements of what is fitted where they have led."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .._typing import Array
from ..exceptions import NotEstimable
from .design import Model
from .expansion import Expansion, Triangle, Unsafe
from .gradient import Rows
from .identifiability import Identified, as_drawn, identify, without
from .iteration import (
    LEAST_DAMPING,
    ROUNDING,
    SLOW,
    Before,
    Far,
    State,
    compute_direction,
    extrapolate,
    relax_damping,
)
from .linearisation import Linearisation
from .nominal_arm import PLENTY, NominalArm
from .prior import Shrinkage, Usual, WeakPrior, faint, fitted_terms, usual_sizes, weigh_usual
from .problem import Problem
from .reduction import PROBE, Reduction, Source, multiply_problem, reduce_problem

Held = Literal["nothing", "geometry", "all"]
ITERATIONS = 60
STUCK = 1e8  # damping at which no step lowers the cost: the minimum, to rounding
ROUNDS = 30  # of judging again what is fitted, where the fit has gone
QUIET_MM = 1e-6  # no measurement is better
# rms: combinations that move the target less at their usual sizes wait until the others have
# converged
UNSEEN_MM = 0.01
COARSE_MM = 1e-2  # step at which intermediate fits have converged
# all rows together: as far does the triangle change by nothing that counts, in the last fit and in
# intermediate ones
NEAR_MM, NEAR_COARSE_MM = 1e-5, 1.0


@dataclass(frozen=True, eq=False)
class Solver:
    """What stays the same in fits of a model that differ in the precision of its shrunk terms;
    `shrunk` (p,): which those are; `weight` [1/mm] of one coordinate."""

    problem: Problem | Source
    model: Model
    shrunk: NDArray[np.bool_]
    weight: float
    held: Held

    @cached_property
    def rows(self) -> Rows:
        """The rows, to be evaluated."""
        assert isinstance(self.problem, Problem)
        return Rows(self.problem, self.model.terms)

    @cached_property
    def usual(self) -> Usual:
        """Usual sizes, of mechanisms' terms where these are held, too."""
        return Usual.of(self.model, self.held == "all")

    @cached_property
    def sizes(self) -> Array:
        """Usual sizes (p,) of the constant parameters alone."""
        return usual_sizes(self.model)

    @cached_property
    def arm(self) -> NominalArm:
        """The nominal arm, and how far from it parameters are."""
        sees_more = self.count > PLENTY * len(self.sizes)
        triangle = self.exact.triangle if sees_more else None
        return NominalArm(self.sizes, triangle)

    @cached_property
    def nominal(self) -> Reduction:
        """The reduction, at the nominal chain, of the terms that have no variance of their own."""
        return reduce_problem(self.problem, [self.model.terms[k] for k in self.free])

    @cached_property
    def count(self) -> int:
        """Count of the measured numbers of all rows."""
        problem = self.problem
        if isinstance(problem, Problem):
            return problem.coordinates
        return self.nominal.rows

    @cached_property
    def free(self) -> list[int]:
        """Terms that have no variance of their own."""
        return np.flatnonzero(~self.shrunk).tolist()

    @cached_property
    def exact(self) -> Identified:
        """What the data determine at the nominal chain, where dependences are exact."""
        return self.identified(self.nominal)

    def identified(self, reduction: Reduction) -> Identified:
        """Identify what a reduction of the free terms says of all; a term that has a variance of
        its own depends on no other."""
        found, p = identify(reduction), len(self.model.terms)
        scale = np.full(p, found.scale.max(initial=0.0) or 1.0)
        triangle = np.diag(scale)
        scale[self.free] = found.scale
        triangle[np.ix_(self.free, self.free)] = found.triangle
        fitted = {self.free[k] for k in found.kept}
        kept = tuple(k for k in range(p) if self.shrunk[k] or k in fitted)
        every = Identified(kept, scale, triangle, kept)
        return as_drawn(every, self.problem, self.model.terms)

    def at_nominal(self) -> Identified:
        """`exact`, less what hardly moves the target at its usual size: it waits until the rest has
        converged."""
        least = UNSEEN_MM * self.weight * np.sqrt(len(self.problem))
        lost = faint(self.exact.triangle, self.exact.kept, self.sizes, least)
        return without(self.exact, lost)

    # -- the problem at a point
    # ----------------------------------------------------------------------------------------------

    def reduce(self, theta: Array, only: Sequence[int] | None = None) -> Reduction:
        """Reduce the rows at theta (p,)."""
        is_nominal = not theta.any()
        if is_nominal and not self.shrunk.any():
            return self.nominal
        terms = self.model.terms
        at = None
        if not is_nominal:
            at = Linearisation(terms, theta)
        return reduce_problem(self.problem, terms, at, only)

    def expand(self, theta: Array) -> Expansion:
        """Expand the squares about theta (p,)."""
        is_nominal = not theta.any() and not self.shrunk.any()
        if isinstance(self.problem, Source) or is_nominal:
            return Expansion.of_reduction(theta, self.reduce(theta))
        terms = self.model.terms
        only = self.free if self.arm.is_far(theta) else ()
        products, free = multiply_problem(self.problem, terms, Linearisation(terms, theta), only)
        return Expansion.of_products(theta, products, free=free if only else None)

    def begin(
        self,
        theta: Array,
        precision: Array | None,
        found: Identified,
        expansion: Expansion | None = None,
    ) -> State:
        """Begin at parameters theta (p,), the fixed terms at zero; the expansion is one there."""
        theta = np.where(np.isin(np.arange(len(theta)), found.kept), theta, 0.0)
        if expansion is None:
            expansion = self.expand(theta)
        slope = expansion.slope
        shrinkage = Shrinkage.of(self.model.terms, precision)
        expansion, triangle = self.factorise(expansion, found, shrinkage)
        return State(
            theta,
            slope,
            shrinkage,
            found,
            WeakPrior(),
            shrinkage.rows,
            expansion,
            triangle,
            triangle.held(None),
        )

    def weighed(self, state: State, precision: Array) -> State:
        """Give the shrunk terms other precisions (p,)."""
        shrinkage = Shrinkage.of(self.model.terms, precision)
        expansion, triangle = self.factorise(state.expansion, state.found, shrinkage)
        factor = triangle.held(state.weak.rows)
        root = shrinkage.root(state.weak)
        state = replace(state, shrinkage=shrinkage, root=root, step_mm=np.inf)
        return replace(state, expansion=expansion, triangle=triangle, factor=factor)

    def factorise(
        self, expansion: Expansion, found: Identified, shrinkage: Shrinkage, exactly: bool = False
    ) -> tuple[Expansion, Triangle]:
        """Factorise an expansion over what is fitted, `exactly` or where products do not do by
        reducing the rows."""
        sized = self.usual.sized(found.kept)
        others = sorted(set(found.kept) - set(sized))
        if not exactly or expansion.reduction is not None:
            try:
                return expansion, expansion.triangle(others, sized, shrinkage)
            except Unsafe:
                pass
        expansion = Expansion.of_reduction(expansion.theta, self.reduce(expansion.theta))
        return expansion, expansion.triangle(others, sized, shrinkage)

    # -- steps
    # ----------------------------------------------------------------------------------------------

    def settle(self, state: State, iterations: int, step_mm: float) -> State:
        """Judge what is fitted and solve again, until the judgement stays, or goes to and fro: then
        the prior stays that has a say in more."""
        earlier: list[WeakPrior] = []
        for _ in range(ROUNDS):
            judged = self.judge(state)
            same_terms = judged.found.kept == state.found.kept
            has_more = judged.weak.count > state.weak.count
            returns = not has_more and any(judged.weak.like(weak) for weak in earlier)
            stays = returns or judged.weak.like(state.weak)
            if same_terms and stays and state.step_mm < step_mm:
                if self.is_near(state, step_mm):
                    break
                judged, earlier = self.judge(self.expanded(state)), []
            earlier.append(state.weak)
            state = self.solve(judged, iterations, step_mm)
        return state

    def is_near(self, state: State, step_mm: float) -> bool:
        """Return whether the expansion is as good as one about theta."""
        near_mm = NEAR_COARSE_MM if step_mm >= COARSE_MM else NEAR_MM
        return state.expansion.distance(state.theta) < near_mm * self.weight

    def expanded(self, state: State) -> State:
        """Expand the squares anew, where the iteration stands."""
        expansion = self.expand(state.theta)
        expansion, triangle = self.factorise(expansion, state.found, state.shrinkage)
        factor = triangle.held(state.weak.rows)
        return replace(state, expansion=expansion, triangle=triangle, factor=factor)

    def solve(self, state: State, iterations: int, step_mm: float) -> State:
        """Iterate Gauss-Newton over the kept terms, damped where it overshoots."""
        count = 0
        state = replace(state, step_mm=np.inf, share=0.0, own=False, damping=0.0, before=None)
        while count < iterations and state.damping < STUCK and not state.rests(step_mm):
            count += 1
            state = self.step(state, step_mm, iterations == 1)
        return replace(state, iterations=state.iterations + count)

    def step(self, state: State, step_mm: float, only_one: bool) -> State:
        """Take a step, or find that it is none: then by a triangle of this point, or damped."""
        own = self.is_near(state, step_mm)
        delta, size = compute_direction(state)
        step = size / self.weight
        there = self.reach(state, delta)
        lower = there.cost <= state.cost * (1 + ROUNDING)
        if lower or step < step_mm or only_one:
            share = step / state.step_mm
            there = replace(there, step_mm=step, share=share, own=own, growth=2.0)
            there = replace(there, damping=relax_damping(state, delta, state.cost - there.cost))
            is_slow = share > SLOW and not there.rests(step_mm)
            return self.expanded(there) if is_slow else there
        if not own:
            return self.expanded(state)
        # overshot: Levenberg-Marquardt from the same point
        damping = max(state.growth * state.damping, LEAST_DAMPING)
        growth = 2 * state.growth
        return replace(state, damping=damping, growth=growth, step_mm=max(step, step_mm))

    def reach(self, state: State, delta: Array) -> State:
        """Go by a step (p,), accelerated where steps do not get shorter quickly; where it overshoots,
        by what the step from beyond says."""
        can_evaluate = isinstance(self.problem, Problem) and not state.damping
        if can_evaluate and state.before is not None and state.share > SLOW:
            there = self.turn(state, delta)
            if there.cost <= state.cost:
                return there
        there = self.move(state, state.theta + delta)
        there = replace(there, before=Before(state.theta, delta))
        if can_evaluate and there.cost > state.cost * (1 + ROUNDING):
            back, _ = compute_direction(there)
            turned = self.turn(there, back)
            if turned.cost <= state.cost:
                return turned
        return there

    def turn(self, state: State, delta: Array) -> State:
        """Go where this step (p,) and the one before, along their difference, come to rest."""
        there = self.move(state, state.theta + extrapolate(state, delta))
        return replace(there, before=Before(state.theta, delta))

    def move(self, state: State, theta: Array) -> State:
        """Evaluate at theta (p,); without rows to evaluate, expand there."""
        if isinstance(self.problem, Problem):
            return replace(state, theta=theta, slope=self.rows.at(theta))
        expansion = self.expand(theta)
        state = replace(state, theta=theta, slope=expansion.slope)
        expansion, triangle = self.factorise(expansion, state.found, state.shrinkage)
        factor = triangle.held(state.weak.rows)
        return replace(state, expansion=expansion, triangle=triangle, factor=factor)

    # -- judgement
    # ----------------------------------------------------------------------------------------------

    def judge(self, state: State) -> State:
        """Judge what is fitted and what the prior holds, at the solution and by the noise it leaves.
        Every constant parameter that moves a measured coordinate is fitted; of the other terms,
        those that no earlier one represents."""
        was_held = state.weak.rows is not None and not state.firm
        if was_held and self.arm.is_loose(state.theta):
            state = self.hold(state)
        theta, expansion, triangle = state.theta, state.expansion, state.triangle
        found, far = self.fitted(state)
        if found.kept != state.found.kept:
            expansion, triangle = self.factorise(expansion, found, state.shrinkage)
        sigma = self.sigma(state)
        weak = weigh_usual(triangle.seen, self.usual, theta, sigma)
        if triangle.blurs(weak, sigma):
            expansion, triangle = self.factorise(expansion, found, state.shrinkage, exactly=True)
            weak = weigh_usual(triangle.seen, self.usual, theta, sigma)
        root = state.shrinkage.root(weak)
        state = replace(state, found=found, weak=weak, root=root, far=far)
        factor = triangle.held(weak.rows)
        return replace(state, expansion=expansion, triangle=triangle, factor=factor)

    def hold(self, state: State) -> State:
        """Begin again with the parameters that others represent left at zero."""
        represented = self.represent(state.theta)
        firm = self.begin(represented, state.shrinkage.precision, self.exact)
        return replace(firm, firm=True, iterations=state.iterations)

    def represent(self, theta: Array) -> Array:
        """Return the parameters that move the nominal arm as theta (p,) does, with what others
        represent at zero."""
        out = np.zeros(len(theta))
        out[list(self.exact.exact)] = self.exact.relation.T @ theta
        return out

    def fitted(self, state: State) -> tuple[Identified, Far | None]:
        """Judge what is fitted: by the dependences at the nominal chain, or, far from it, by those
        where the expansion is, which are returned, too."""
        if state.firm:
            return self.exact, None
        if not self.arm.is_far(state.theta):
            nominal = fitted_terms(self.exact, self.model)
            return nominal, None
        expansion = state.expansion
        point = expansion.theta
        far = state.far
        if far is not None and far.point is point:
            return far.found, far
        reduction = expansion.free
        if reduction is None:
            reduction = self.reduce_free(expansion)
        identified = self.identified(reduction)
        found = fitted_terms(identified, self.model)
        return found, Far(point, found)

    def reduce_free(self, expansion: Expansion) -> Reduction:
        """Reduce the rows at an expansion's point, of the terms that have no variance of their
        own."""
        terms = self.model.terms
        free = [terms[k] for k in self.free]
        return reduce_problem(self.problem, free, Linearisation(terms, expansion.theta))

    def confirm(self, state: State, step_mm: float) -> State:
        """Return the state where the iteration has ended: its steps were by exact slopes."""
        return state

    def conclude(self, state: State) -> Reduction:
        """Reduce the rows at the solution."""
        theta, many = state.theta, len(self.problem) > PROBE[1]
        only = list(state.found.kept) if theta.any() and many else None
        return self.reduce(theta, only)

    def sigma(self, state: State) -> float:
        """Residual standard deviation of one whitened coordinate; terms that a prior holds cost no
        degree of freedom."""
        count = sum(not self.shrunk[k] for k in state.found.kept) - state.weak.count
        variance = state.slope.squares / max(self.count - count, 1.0)
        return max(float(np.sqrt(variance)), QUIET_MM * self.weight)

    def refuse(self, state: State, settled: bool, step_mm: float) -> None:
        """Raise NotEstimable where the data have no more coordinates than the model has parameters,
        or where the iteration should have `settled` and has not."""
        names = " + ".join(self.model.names) or "the model"
        rows = self.count
        rank = state.found.rank - state.weak.held
        if rows <= rank and state.shrinkage.precision is None:
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
