"""Where the iteration of a fit stands, and the steps it takes from there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .._typing import Array
from .expansion import Expansion, Triangle
from .gradient import Slope
from .identifiability import Identified
from .prior import Shrinkage, WeakPrior

ROUNDING = 1e-9  # of the cost: smaller gains are not told from rounding
LEAST_DAMPING = 1e-9  # of a column's square
SLOW = 0.2  # of the last step: more asks for a triangle at the point reached
LAST = 1e-5  # of the step asked for: steps cost little once there is a triangle


class Far(NamedTuple):
    """What is fitted far from the nominal arm, by the dependences at a point (p,)."""

    point: Array
    found: Identified


class Before(NamedTuple):
    """Where a step began (p,), and the step (p,) of Gauss-Newton there."""

    theta: Array
    delta: Array


@dataclass(frozen=True, eq=False)
class State:
    """Where the iteration stands: parameters theta (p,) and the slope there; the prior of shrunk
    terms, what is fitted, the prior on what the data hardly determine, and `root` (k, p) of
    both priors; the expansion that steps are taken from, and the factor (k, k) of its products with
    the prior's, in the triangle's order.

    Of the last step: its size, its share of the one before, its damping, and whether the expansion
    was about the point where it began, or one as good; `growth`: what the damping grows by where
    the next one overshoots; `before`: where it began, and where it went without acceleration;
    `far`: see there; `firm`: whether what others represent is left at zero."""

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
        """Squares of the residual and of what the prior says of theta."""
        return self.slope.squares + float(np.square(self.root @ self.theta).sum())

    @property
    def uphill(self) -> Array:
        """Minus half the slope (p,) of the cost."""
        return np.asarray(self.slope.products - self.root.T @ (self.root @ self.theta))

    def rests(self, step_mm: float) -> bool:
        """Return whether the iteration has arrived, or steps by the triangle of the very point do
        not get shorter any more."""
        if self.damping:
            return False
        as_far_as_can_be = self.own and self.share > SLOW
        longest = step_mm if as_far_as_can_be else LAST * step_mm
        return self.step_mm < longest


def relax_damping(state: State, delta: Array, gained: float) -> float:
    """Return the damping after a step (p,) that lowered the cost by `gained`: less where that is what
    the squares said (Nielsen 1999, IMM-REP-1999-05)."""
    order = list(state.triangle.order)
    moved = state.factor @ delta[order]
    expected = float(2 * state.uphill @ delta - moved @ moved)
    is_told = expected > ROUNDING * state.cost
    ratio = max(gained / expected, 0.0) if is_told else 1.0
    damping = state.damping * max(0.1, 1 - (2 * ratio - 1) ** 3)
    return damping if damping > LEAST_DAMPING else 0.0


def extrapolate(state: State, delta: Array) -> Array:
    """Return the step (p,) to where this step and the one before would rest, along their difference
    (Anderson 1965, J. ACM 12, 547, of depth one)."""
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
    """(step (p,) from theta, how far it moves all rows together, whitened)."""
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
