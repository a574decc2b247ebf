"""Levenberg-Marquardt minimisation of any state that a step can move."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from .._linalg import TINY
from .._typing import Array

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

State = TypeVar("State")


def minimise(
    state: State,
    cost: Callable[[State], float],
    equations: Callable[[State], tuple[Array, Array]],
    move: Callable[[State, Array], State],
    tolerance: float = CONVERGED,
) -> State:
    """Minimise a cost by Levenberg-Marquardt from a state.

    `equations`: the normal equations (H (p, p), g (p,)) of a step (p,) that `move` takes;
    `tolerance`: relative reduction of the cost at which it ends."""
    current, damping = cost(state), FIRST_DAMPING
    for _ in range(MAX_STEPS):
        H, g = equations(state)
        has_fallen = False
        while damping < MAX_DAMPING and not has_fallen:
            trial = move(state, _solve(H, g, damping))
            new = cost(trial)
            has_fallen = new < current
            if has_fallen:
                damping = max(damping / 10, LEAST_LOWERED)
            else:
                damping = max(10 * damping, LEAST_RAISED)
        if not has_fallen:
            return state
        gain = current - new
        state, current = trial, new
        if gain <= tolerance * current:
            return state
    return state


def _solve(H: Array, g: Array, damping: float) -> Array:
    """Solve the damped normal equations, scaled to a unit diagonal."""
    diagonal = np.diag(H)
    size = np.sqrt(np.maximum(diagonal, TINY))
    scaled = H / np.outer(size, size)
    identity = np.eye(len(H))
    solution, *_ = np.linalg.lstsq(scaled + damping * identity, g / size, rcond=1e-15)
    step = solution / size
    return np.asarray(step)
