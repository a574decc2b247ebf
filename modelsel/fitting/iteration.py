"""The state of a fit's iteration, and the steps that it takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from .._typing import Array
from .expansion import Expansion, Triangle
from .gradient import Slope
from .identifiability import Identified
from .prior import Shrinkage, WeakPrior

SLOW = 0.2  # of the last step: a longer one asks for a triangle at the point reached
LAST = 1e-5  # of the step asked for: with a triangle at hand, more steps cost little
COARSE_MM = 1e-2  # step at which intermediate fits have converged
LAST_COARSE = 1e-2  # of the step asked for, in intermediate fits


class Far(NamedTuple):
    """What is fitted far from the nominal arm: the dependences of columns at a point (p,)."""

    point: Array
    found: Identified


class Before(NamedTuple):
    """The point (p,) where a step began, and the Gauss-Newton step (p,) there."""

    theta: Array
    delta: Array


@dataclass(frozen=True, eq=False)
class State:
    """The state of an iteration.

    theta, slope: the parameters (p,), and the gradient there.
    shrinkage, weak, root: the prior of shrunk terms, the prior on what the data hardly determine, and
        the root (k, p) of both together.
    found: which terms are fitted.
    expansion, triangle, factor: the expansion that steps are computed from, its factorisation, and
        that with the priors (k, k), in the triangle's order.
    step_mm, share, damping: size of the last step [mm], its ratio to the one before, and its damping.
    own: whether the expansion was about the point where the last step began, or one as good.
    growth: factor of the damping if the next step overshoots.
    before: where the last step began, and where it led without acceleration.
    far: the dependences far from the nominal arm, where they are used.
    firm: whether parameters that others represent are left at zero."""

    theta: Array
    slope: Slope
    shrinkage: Shrinkage
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
    growth: float = 2.0
    before: Before | None = None
    far: Far | None = None
    firm: bool = False

    @property
    def cost(self) -> float:
        """Sum of squares of the residual and of the prior's rows."""
        return self.slope.squares + float(np.square(self.root @ self.theta).sum())

    @property
    def uphill(self) -> Array:
        """Minus half the gradient (p,) of the cost."""
        return np.asarray(self.slope.products - self.root.T @ (self.root @ self.theta))

    def stays(self, before: State, earlier: Sequence[WeakPrior]) -> bool:
        """Return whether a judgement says what the one `before` said, or goes to and fro between
        `earlier` ones: then the prior stays that has a say in more."""
        if self.found.kept != before.found.kept:
            return False
        has_more = self.weak.count > before.weak.count
        returns = not has_more and any(self.weak.like(weak) for weak in earlier)
        return returns or self.weak.like(before.weak)

    def rests(self, step_mm: float) -> bool:
        """Return whether the iteration has converged: the last step is short, or steps from an
        expansion about the very point get no shorter."""
        if self.damping:
            return False
        as_far_as_can_be = self.own and self.share > SLOW
        if as_far_as_can_be:
            return self.step_mm < step_mm
        share = LAST if step_mm < COARSE_MM else LAST_COARSE
        return self.step_mm < share * step_mm


def extrapolate(state: State, delta: Array) -> Array:
    """Return the accelerated step (p,): along the difference to the step before, to where both would
    vanish (Anderson acceleration of depth one: Anderson 1965, J. ACM 12, 547)."""
    assert state.before is not None
    order = list(state.triangle.order)
    change = delta - state.before.delta
    in_rows = state.factor @ change[order]
    square = float(in_rows @ in_rows)
    if not square > 0:
        return delta
    share = float(in_rows @ (state.factor @ delta[order])) / square
    return np.asarray(delta - share * (state.theta - state.before.theta + change))


def compute_direction(state: State) -> tuple[Array, float]:
    """Compute the step (p,) from theta, and the length of the whitened change of all rows by it."""
    from scipy.linalg import solve_triangular

    order = list(state.triangle.order)
    factor = state.factor
    if state.damping:  # Marquardt's: a row per column, in proportion to its norm
        norm = np.linalg.norm(factor, axis=0)
        rows = np.diag(np.sqrt(state.damping) * norm)
        factor = np.asarray(np.linalg.qr(np.vstack([factor, rows]), mode="r"))
    turned = solve_triangular(factor, state.uphill[order], trans="T", check_finite=False)
    delta = np.zeros(len(state.theta))
    delta[order] = solve_triangular(factor, turned, check_finite=False)
    return delta, float(np.linalg.norm(state.factor @ delta[order]))


def minimise_expanded(state: State) -> State:
    """Go to the minimum of the expanded squares, which takes one step."""
    delta, _ = compute_direction(replace(state, damping=0.0))
    theta = state.theta + delta
    slope = state.expansion.slope_at(theta)
    count = state.iterations + 1
    return replace(state, theta=theta, slope=slope, step_mm=0.0, iterations=count)
