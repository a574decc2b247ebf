"""Gauss-Newton with few reductions of the rows: steps by the triangle of a point nearby and the
exact gradient, and judgements of what is fitted where they have led."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._typing import Array
from ..exceptions import NotEstimable
from .design import Model
from .expansion import Expansion, Triangle, Unsafe
from .gradient import Rows, Slope
from .identifiability import Identified, as_drawn, identify, without
from .linearisation import Linearisation
from .prior import Usual, WeakPrior, faint, fitted_terms, prior_root, usual_sizes, weigh_usual
from .problem import Problem
from .reduction import Reduction, Source, multiply_problem, reduce_problem

Held = Literal["nothing", "geometry", "all"]
ITERATIONS = 60
STUCK = 1e8  # damping at which no step lowers the cost: the minimum, to rounding
ROUNDS = 30  # of judging again what is fitted, where the fit has gone
FAR = 10.0  # usual sizes from the nominal arm, within which the nominal chain's dependences hold
QUIET_MM = 1e-6  # no measurement is better
# rms: combinations that move the target less at their usual sizes wait until the others have
# converged
UNSEEN_MM = 0.01
SLOW = 0.2  # of the last step: more asks for a triangle at the point reached
LAST = 1e-5  # of the step asked for: steps cost little once there is a triangle
NEAR_MM = 1e-5  # all rows together: as far does the triangle change by nothing that counts


class Far(NamedTuple):
    """What is fitted far from the nominal arm, by the dependences at a point (p,)."""

    point: Array
    found: Identified


@dataclass(frozen=True, eq=False)
class State:
    """Where the iteration stands: parameters theta (p,) and the slope there; the precision (p,) of
    shrunk terms, what is fitted, the prior on what the data hardly determine, and `root` (k, p) of
    both priors; the expansion that steps are taken from, and the factor (k, k) of its products with
    the prior's, in the triangle's order.

    Of the last step: its size, its share of the one before, its damping, and whether the expansion
    was about the point where it began, or one as good; `far`: see there."""

    theta: Array
    slope: Slope
    precision: Array | None
    found: Identified
    weak: WeakPrior
    root: Array
    expansion: Expansion
    triangle: Triangle
    factor: Array
    iterations: int = 0
    step_mm: float = np.inf
    share: float = 0.0
    own: bool = False
    damping: float = 0.0
    far: Far | None = None

    @property
    def cost(self) -> float:
        """Squares of the residual and of what the prior says of theta."""
        return self.slope.squares + float(np.square(self.root @ self.theta).sum())

    def rests(self, step_mm: float) -> bool:
        """Return whether the iteration has arrived, or steps by the triangle of the very point do
        not get shorter any more."""
        as_far_as_can_be = self.own and self.share > SLOW
        return self.step_mm < (step_mm if as_far_as_can_be else LAST * step_mm)


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
    def nominal(self) -> Reduction:
        """The reduction, at the nominal chain, of the terms that have no variance of their own."""
        return reduce_problem(self.problem, [self.model.terms[k] for k in self.free])

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
        if not theta.any() and not self.shrunk.any():
            return self.nominal
        terms = self.model.terms
        at = Linearisation(terms, theta) if theta.any() else None
        return reduce_problem(self.problem, terms, at, only)

    def expand(self, theta: Array) -> Expansion:
        """Expand the squares about theta (p,)."""
        is_nominal = not theta.any() and not self.shrunk.any()
        if isinstance(self.problem, Source) or is_nominal:
            return Expansion.of_reduction(theta, self.reduce(theta))
        at = Linearisation(self.model.terms, theta)
        return Expansion.of_products(theta, multiply_problem(self.problem, self.model.terms, at))

    def begin(
        self,
        theta: Array,
        precision: Array | None,
        found: Identified,
        expansion: Expansion | None = None,
    ) -> State:
        """Begin at parameters theta (p,), the fixed terms at zero; the expansion is of a point
        nearby."""
        theta = np.where(np.isin(np.arange(len(theta)), found.kept), theta, 0.0)
        if expansion is None:
            expansion = self.expand(theta)
        slope = expansion.slope
        if isinstance(self.problem, Problem) and expansion.theta is not theta:
            slope = self.rows.at(theta)
        expansion, triangle = self.factorise(expansion, found, precision)
        return State(
            theta,
            slope,
            precision,
            found,
            WeakPrior(),
            prior_root(self.model.terms, precision),
            expansion,
            triangle,
            triangle.held(None),
        )

    def weighed(self, state: State, precision: Array) -> State:
        """Give the shrunk terms other precisions (p,)."""
        root = prior_root(self.model.terms, precision, state.weak)
        expansion, triangle = self.factorise(state.expansion, state.found, precision)
        factor = triangle.held(state.weak.rows)
        state = replace(state, precision=precision, root=root, step_mm=np.inf)
        return replace(state, expansion=expansion, triangle=triangle, factor=factor)

    def factorise(
        self,
        expansion: Expansion,
        found: Identified,
        precision: Array | None,
        exactly: bool = False,
    ) -> tuple[Expansion, Triangle]:
        """Factorise an expansion over what is fitted, `exactly` or where products do not do by
        reducing the rows."""
        sized = self.usual.sized(found.kept)
        others = sorted(set(found.kept) - set(sized))
        root = prior_root(self.model.terms, precision)
        if not exactly or expansion.reduction is not None:
            try:
                return expansion, expansion.triangle(others, sized, root)
            except Unsafe:
                pass
        expansion = Expansion.of_reduction(expansion.theta, self.reduce(expansion.theta))
        return expansion, expansion.triangle(others, sized, root)

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
                if self.is_near(state):
                    break
                judged, earlier = self.judge(self.expanded(state)), []
            earlier.append(state.weak)
            state = self.solve(judged, iterations, step_mm)
        return state

    def is_near(self, state: State) -> bool:
        """Return whether the expansion is as good as one about theta."""
        return state.expansion.distance(state.theta) < NEAR_MM * self.weight

    def expanded(self, state: State) -> State:
        """Expand the squares anew, where the iteration stands."""
        expansion = self.expand(state.theta)
        expansion, triangle = self.factorise(expansion, state.found, state.precision)
        factor = triangle.held(state.weak.rows)
        return replace(state, expansion=expansion, triangle=triangle, factor=factor)

    def solve(self, state: State, iterations: int, step_mm: float) -> State:
        """Iterate Gauss-Newton over the kept terms, damped where it overshoots."""
        count = 0
        state = replace(state, step_mm=np.inf, share=0.0, own=False, damping=0.0)
        while count < iterations and state.damping < STUCK and not state.rests(step_mm):
            count += 1
            state = self.step(state, step_mm, iterations == 1)
        return replace(state, iterations=state.iterations + count)

    def step(self, state: State, step_mm: float, only_one: bool) -> State:
        """Take a step, or find that it is none: then by a triangle of this point, or damped."""
        own = self.is_near(state)
        delta, size = _direction(state)
        step = size / self.weight
        there = self.move(state, state.theta + delta)
        lower = there.cost <= state.cost * (1 + 1e-9)
        if lower or step < step_mm or only_one:
            damping = state.damping / 10 if state.damping > 1e-8 else 0.0
            share = step / state.step_mm
            there = replace(there, step_mm=step, share=share, own=own, damping=damping)
            is_slow = share > SLOW and not there.rests(step_mm)
            return self.expanded(there) if is_slow else there
        if not own:
            return self.expanded(state)
        # overshot: Levenberg-Marquardt from the same point
        damping = max(8 * state.damping, 1e-6)
        return replace(state, damping=damping, step_mm=max(step, step_mm))

    def move(self, state: State, theta: Array) -> State:
        """Evaluate at theta (p,); without rows to evaluate, expand there."""
        if isinstance(self.problem, Problem):
            return replace(state, theta=theta, slope=self.rows.at(theta))
        expansion = self.expand(theta)
        return self.expanded(replace(state, theta=theta, slope=expansion.slope))

    # -- judgement
    # ----------------------------------------------------------------------------------------------

    def judge(self, state: State) -> State:
        """Judge what is fitted and what the prior holds, at the solution and by the noise it leaves.
        Every constant parameter that moves a measured coordinate is fitted; of the other terms,
        those that no earlier one represents."""
        theta, expansion, triangle = state.theta, state.expansion, state.triangle
        found, far = self.fitted(state)
        if found.kept != state.found.kept:
            expansion, triangle = self.factorise(expansion, found, state.precision)
        sigma = self.sigma(state)
        weak = weigh_usual(triangle.seen, self.usual, theta, sigma)
        if triangle.blurs(weak, sigma):
            expansion, triangle = self.factorise(expansion, found, state.precision, exactly=True)
            weak = weigh_usual(triangle.seen, self.usual, theta, sigma)
        root = prior_root(self.model.terms, state.precision, weak)
        state = replace(state, found=found, weak=weak, root=root, far=far)
        factor = triangle.held(weak.rows)
        return replace(state, expansion=expansion, triangle=triangle, factor=factor)

    def fitted(self, state: State) -> tuple[Identified, Far | None]:
        """Judge what is fitted: by the dependences at the nominal chain, or, far from it, by those
        where the expansion is, which are returned, too."""
        is_far = np.abs(state.theta) > FAR * self.sizes
        if not is_far.any():
            return fitted_terms(self.exact, self.model), None
        point, terms = state.expansion.theta, self.model.terms
        if state.far is not None and state.far.point is point:
            return state.far.found, state.far
        free = [terms[k] for k in self.free]
        reduction = reduce_problem(self.problem, free, Linearisation(terms, point))
        found = fitted_terms(self.identified(reduction), self.model)
        return found, Far(point, found)

    def sigma(self, state: State) -> float:
        """Residual standard deviation of one whitened coordinate; terms that a prior holds cost no
        degree of freedom."""
        count = sum(not self.shrunk[k] for k in state.found.kept) - state.weak.count
        variance = state.slope.squares / max(self.nominal.rows - count, 1.0)
        return max(float(np.sqrt(variance)), QUIET_MM * self.weight)

    def refuse(self, state: State, settled: bool, step_mm: float) -> None:
        """Raise NotEstimable where the data have no more coordinates than the model has parameters,
        or where the iteration should have `settled` and has not."""
        names = " + ".join(self.model.names) or "the model"
        rows = self.nominal.rows
        rank = state.found.rank - state.weak.held
        if rows <= rank and state.precision is None:
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


def _direction(state: State) -> tuple[Array, float]:
    """(step (p,) from theta, how far it moves all rows together, whitened)."""
    from scipy.linalg import solve_triangular

    order = list(state.triangle.order)
    factor = state.factor
    if state.damping:  # Marquardt's: a row per column, in proportion to its norm
        norm = np.linalg.norm(factor, axis=0)
        rows = np.diag(np.sqrt(state.damping) * norm)
        factor = np.asarray(np.linalg.qr(np.vstack([factor, rows]), mode="r"))
    uphill = state.slope.products - state.root.T @ (state.root @ state.theta)
    turned = solve_triangular(factor, uphill[order], trans="T", check_finite=False)
    delta = np.zeros(len(state.theta))
    delta[order] = solve_triangular(factor, turned, check_finite=False)
    return delta, float(np.linalg.norm(state.factor @ delta[order]))
