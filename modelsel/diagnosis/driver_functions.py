"""Functions of one driver over the range that was measured: what an error may do with it."""

from __future__ import annotations

from ..fitting.problem import Problem
from ..mechanisms.causes import Applied, Cause, Named

# how far a driver goes beyond the linear part of what levels off, at the ends of its range
LEVELS_OFF = 2.0


def scale_driver(problem: Problem, name: str) -> Cause:
    """A driver from -1 to 1 over its range."""
    values = problem.state.value(name)
    low, high = float(values.min()), float(values.max())
    middle, half = float(f"{(low + high) / 2:.6g}"), float(f"{(high - low) / 2:.6g}")
    unit = problem.names().get(name, "1")
    return (Named(name, unit) - middle) * (1 / half)


def level_off(problem: Problem, name: str, strength: float = LEVELS_OFF) -> Cause:
    """A function of a driver that is linear in the middle of its range and levels off at the ends."""
    return Applied("tanh", strength * scale_driver(problem, name))
