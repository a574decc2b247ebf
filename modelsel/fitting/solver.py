"""What stays the same in fits of a model: its problem, and the judgement of what is fitted where an
iteration has led.

A fit calls the methods of a `Strategy` in the order in which they stand there. There are three:
`WholeProblem` iterates on all rows, `SampledRows` begins where the fit to a sample of very many rows
ended, and `NestedModel` uses rows that were reduced for a larger model. Each computes its steps from an
`Expansion` of the squares, and asks the `Solver` what is fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from .._typing import Array
from ..exceptions import NotEstimable, write_rounded
from .design import Model
from .expansion import Expansion, Triangle, Unsafe
from .gradient import Rows
from .identifiability import Identified, as_drawn, identify, without
from .iteration import Far, State, minimise_expanded
from .linearisation import Linearisation
from .nominal_arm import PLENTY, NominalArm
from .prior import Shrinkage, Usual, WeakPrior, faint, fitted_terms, usual_sizes, weigh_usual
from .problem import Problem
from .reduction import Reduction, Source, reduce_problem

Held = Literal["nothing", "geometry", "all"]
ITERATIONS = 60
# what to do where the data have too few coordinates
MORE_ROWS = "measure more configurations or, where some are held out, let more estimate ([split] estimation)."
STUCK = 1e8  # damping at which no step lowers the cost: the minimum, to rounding
ROUNDS = 30  # of judging again what is fitted, where the fit has gone
QUIET_MM = 1e-6  # no measurement is better
# rms: combinations that move the target less at their usual sizes wait until the others have
# converged
UNSEEN_MM = 0.01


class Strategy(Protocol):
    """How a fit goes about the rows; its methods in the order in which they are called.

    `must_settle`: whether a last step that is too long is an error."""

    must_settle: ClassVar[bool]

    def find_dependences(self, solver: Solver) -> Identified:
        """Find what the data determine at the nominal chain, where dependences are exact."""

    def begin(self, solver: Solver, theta: Array, prior: Shrinkage, found: Identified) -> State:
        """Begin at parameters theta (p,), or near the solution; terms not in `found` are zero."""

    def solve(self, solver: Solver, state: State, iterations: int, step_mm: float) -> State:
        """Minimise the cost over the kept terms, with what the prior holds as it is."""

    def settle(self, solver: Solver, state: State, iterations: int, step_mm: float) -> State:
        """Judge what is fitted and solve again, until the judgement stays."""

    def conclude(self, solver: Solver, state: State, step_mm: float) -> tuple[State, Reduction]:
        """Return the confirmed solution, and the rows reduced there."""


@dataclass(frozen=True, eq=False)
class Solver:
    """What stays the same in fits of a model that differ in the precision of its shrunk terms;
    `shrunk` (p,): which those are; `weight` [1/mm] of one coordinate."""

    problem: Problem | Source
    model: Model
    shrunk: NDArray[np.bool_]
    weight: float
    held: Held
    strategy: Strategy

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
    def free(self) -> list[int]:
        """Terms that have no variance of their own."""
        return np.flatnonzero(~self.shrunk).tolist()

    @cached_property
    def nominal(self) -> Reduction:
        """The reduction, at the nominal chain, of the free terms."""
        return self.reduce_free(None)

    @cached_property
    def count(self) -> int:
        """Count of the measured numbers of all rows."""
        problem = self.problem
        if isinstance(problem, Problem):
            return problem.coordinates
        return self.nominal.rows

    @cached_property
    def exact(self) -> Identified:
        """What the data determine at the nominal chain, where dependences are exact."""
        return self.strategy.find_dependences(self)

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

    def reduce(self, theta: Array, only: Sequence[int] | None = None) -> Reduction:
        """Reduce all rows at theta (p,); the columns of `only` some terms."""
        is_nominal = not theta.any()
        if is_nominal and not self.shrunk.any():
            return self.nominal
        terms = self.model.terms
        at = None
        if not is_nominal:
            at = Linearisation(terms, theta)
        return reduce_problem(self.problem, terms, at, only)

    def reduce_free(self, theta: Array | None) -> Reduction:
        """Reduce all rows at theta (p,), or at the nominal chain, of the free terms alone."""
        terms = self.model.terms
        at = None if theta is None else Linearisation(terms, theta)
        return reduce_problem(self.problem, [terms[k] for k in self.free], at)

    # -- states, and the expansions that their steps are computed from

    def start(self, expansion: Expansion, prior: Shrinkage, found: Identified) -> State:
        """Return the state at an expansion's point, without a prior of usual sizes."""
        expanded, triangle = self.factorise(expansion, found, prior)
        return State(
            theta=expansion.theta,
            slope=expansion.slope,
            shrinkage=prior,
            found=found,
            weak=WeakPrior(),
            root=prior.rows,
            expansion=expanded,
            triangle=triangle,
            factor=triangle.held(None),
        )

    def weighed(self, state: State, precision: Array) -> State:
        """Give the shrunk terms other precisions (p,)."""
        shrinkage = Shrinkage.of(self.model.terms, precision)
        root = shrinkage.root(state.weak)
        state = replace(state, shrinkage=shrinkage, root=root, step_mm=np.inf)
        return self.renewed(state, state.expansion)

    def renewed(self, state: State, expansion: Expansion) -> State:
        """Compute the next steps from an expansion about the present theta."""
        expansion, triangle = self.factorise(expansion, state.found, state.shrinkage)
        factor = triangle.held(state.weak.rows)
        return replace(state, expansion=expansion, triangle=triangle, factor=factor)

    def moved(self, state: State, expansion: Expansion) -> State:
        """Go to an expansion's point, with its gradient."""
        theta, slope = expansion.theta, expansion.slope
        there = replace(state, theta=theta, slope=slope, far=None)
        return self.renewed(there, expansion)

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

    # -- judgement

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

    def settle_expanded(self, state: State, step_mm: float) -> State:
        """Judge what is fitted and minimise the expanded squares, until the judgement stays."""
        earlier: list[WeakPrior] = []
        for _ in range(ROUNDS):
            judged = self.judge(state)
            if judged.stays(state, earlier) and state.step_mm < step_mm:
                break
            earlier.append(state.weak)
            state = minimise_expanded(judged)
        return state

    def hold(self, state: State) -> State:
        """Begin again with the parameters that others represent left at zero."""
        represented = self.exact.confine(self.represent(state.theta))
        firm = self.strategy.begin(self, represented, state.shrinkage, self.exact)
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
            reduction = self.reduce_free(point)
        identified = self.identified(reduction)
        found = fitted_terms(identified, self.model)
        return found, Far(point, found)

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
                f"{names}: {MORE_ROWS}",
                parameters=[t.symbol for t in self.model.terms],
            )
        if settled and state.step_mm > 1e3 * step_mm and state.damping < STUCK:
            raise NotEstimable(
                f"the fit of {names} does not settle (last step {write_rounded(state.step_mm)} mm): the data hardly "
                "determine some parameters; measure more widely spread configurations."
            )
