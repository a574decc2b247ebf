"""Functions of one driver over the range that was measured: what an error may do with it."""

from __future__ import annotations

from ...fitting.problem import Problem
from ...mechanisms.causes import Applied, Cause, Named

# names of the course of a campaign
IN_TIME = frozenset(("progress", "time_s", "since_rest_s"))
# how far a driver goes beyond the linear part of what levels off, at the ends of its range
LEVELS_OFF = 2.0
# range of readings [rad, mm] of a joint that stands still: what changes there is the encoder's noise
STILL = 1e-3
# covariates with which a shape may change, at most, in the order of the file
MOST_COVARIATES = 8


def list_varying(problem: Problem) -> list[str]:
    """List the covariates that vary, but for the clock."""
    covariates = problem.data.covariates
    varying = []
    for name, values in covariates.items():
        varies = values.max() > values.min()
        if varies and name not in IN_TIME:
            varying.append(name)
    return varying[:MOST_COVARIATES]


def scale_driver(problem: Problem, name: str) -> Cause:
    """A driver from -1 to 1 over its range."""
    values = problem.state.value(name)
    low = float(values.min())
    high = float(values.max())
    middle = _round(0.5 * (low + high))
    half = _round(0.5 * (high - low))
    units = problem.names()
    unit = units.get(name, "1")
    driver = Named(name, unit)
    return (driver - middle) * (1 / half)


def _round(value: float) -> float:
    """Round to six digits, as formulas print them."""
    return float(f"{value:.6g}")


def level_off(
    problem: Problem, name: str, strength: float = LEVELS_OFF, centre: float = 0.0
) -> Cause:
    """A function of a driver that is linear around a part of its range, by default the middle, and
    levels off towards the ends."""
    scaled = scale_driver(problem, name)
    argument = strength * (scaled - centre) if centre else strength * scaled
    return Applied("tanh", argument)
