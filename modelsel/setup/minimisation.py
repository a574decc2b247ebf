"""Levenberg-Marquardt minimisation of any states that a step can move, many of them together.

Every state has a damping of its own and ends by itself, so that it goes the way it would go alone;
the states that still go on are evaluated in one call."""

from __future__ import annotations

from typing import Generic, Protocol, Self, TypeVar

import numpy as np

from .._linalg import TINY
from .._typing import Array, Index, Mask

# relative reduction of the cost at which a minimisation ends, and where only minima are compared
CONVERGED = 1e-12
COARSE = 1e-5
MAX_STEPS = 40
# damping of scaled normal equations: at the start, at least when it is raised or lowered, and where
# the state is taken to be a minimum
FIRST_DAMPING = 1e-6
LEAST_RAISED = 1e-9
LEAST_LOWERED = 1e-12
MAX_DAMPING = 1e8


class States(Protocol):
    """States that are minimised together."""

    def take(self, which: Index) -> Self:
        """Select some of the states."""

    def put(self, which: Index, others: Self) -> Self:
        """Return the states with others in some places."""


AnyStates = TypeVar("AnyStates", bound=States)


class Objective(Protocol[AnyStates]):
    """What is minimised, of as many states as it is asked about."""

    def take(self, which: Index) -> Self:
        """Select the objective of some of the states."""

    def cost(self, states: AnyStates) -> Array:
        """Compute the cost (k,) of every state."""

    def equations(self, states: AnyStates) -> tuple[Array, Array]:
        """Compute the normal equations H (k, p, p), g (k, p) of a step of every state."""

    def move(self, states: AnyStates, steps: Array) -> AnyStates:
        """Take a step (k, p) of every state."""


def minimise(
    states: AnyStates, objective: Objective[AnyStates], tolerance: float = CONVERGED
) -> AnyStates:
    """Minimise a cost from every state; `tolerance`: relative reduction of the cost at which one
    ends."""
    found = states
    descent = _Descent(states, objective, tolerance)
    while len(descent.which):
        has_ended = descent.step()
        ended = np.flatnonzero(has_ended)
        if len(ended):
            places = descent.which[ended]
            minima = descent.states.take(ended)
            found = found.put(places, minima)
            going = np.flatnonzero(~has_ended)
            descent.keep(going)
    return found


class _Descent(Generic[AnyStates]):
    """The states that go on (`which`), their costs, dampings and normal equations; `is_new`: whose
    equations are out of date."""

    def __init__(
        self, states: AnyStates, objective: Objective[AnyStates], tolerance: float
    ) -> None:
        self.states = states
        self.objective = objective
        self.tolerance = tolerance
        cost = objective.cost(states)
        self.cost = cost
        count = len(cost)
        self.H, self.g = objective.equations(states)
        self.which = np.arange(count)
        self.damping = np.full(count, FIRST_DAMPING)
        self.steps = np.zeros(count, np.intp)
        self.is_new = np.zeros(count, bool)

    def step(self) -> Mask:
        """Try one step of every state, and keep those that reduce the cost; return which states have
        ended."""
        self._renew_equations()
        steps = _solve(self.H, self.g, self.damping)
        trial = self.objective.move(self.states, steps)
        cost = self.objective.cost(trial)
        has_fallen = cost < self.cost
        gain = self.cost - cost
        fallen = np.flatnonzero(has_fallen)
        if len(fallen):
            moved = trial.take(fallen)
            self.states = self.states.put(fallen, moved)
        self.cost = np.where(has_fallen, cost, self.cost)
        self.steps += has_fallen
        self.is_new = has_fallen
        tenth = self.damping / 10
        lowered = np.maximum(tenth, LEAST_LOWERED)
        tenfold = 10 * self.damping
        raised = np.maximum(tenfold, LEAST_RAISED)
        self.damping = np.where(has_fallen, lowered, raised)
        least_gain = self.tolerance * cost
        is_minimum = gain <= least_gain
        is_last = self.steps >= MAX_STEPS
        has_stalled = self.damping >= MAX_DAMPING
        has_arrived = is_minimum | is_last
        return np.where(has_fallen, has_arrived, has_stalled)

    def keep(self, which: Index) -> None:
        """Go on with some of the states."""
        self.states = self.states.take(which)
        self.objective = self.objective.take(which)
        self.which = self.which[which]
        self.cost = self.cost[which]
        self.H = self.H[which]
        self.g = self.g[which]
        self.damping = self.damping[which]
        self.steps = self.steps[which]
        self.is_new = self.is_new[which]

    def _renew_equations(self) -> None:
        """Compute the equations of the states that have moved."""
        if self.is_new.all():
            self.H, self.g = self.objective.equations(self.states)
            return
        new = np.flatnonzero(self.is_new)
        if len(new):
            objective = self.objective.take(new)
            moved = self.states.take(new)
            self.H[new], self.g[new] = objective.equations(moved)


def _solve(H: Array, g: Array, damping: Array) -> Array:
    """Solve damped normal equations (k, p, p), (k, p), scaled to a unit diagonal."""
    diagonal = np.diagonal(H, axis1=1, axis2=2)
    size = np.sqrt(np.maximum(diagonal, TINY))
    scaled = H / size[:, :, None]
    scaled /= size[:, None, :]
    unknowns = np.arange(H.shape[2])
    scaled[:, unknowns, unknowns] += damping[:, None]
    response = g / size
    solution = np.linalg.solve(scaled, response[:, :, None])
    steps = solution[:, :, 0] / size
    return np.asarray(steps)
