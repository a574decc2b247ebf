"""Clocks of a campaign, and what drifts or warms up by them: from the campaign's beginning, or afresh
whenever the arm has stood for long."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ...fitting.problem import Problem
from ...measurements.campaign.clock_history import REST
from ...mechanisms.causes import Applied, Cause, Named
from ...mechanisms.environment import PROGRESS

Causes = tuple[Cause, ...]
# what tells the time, and how long that was
Clock = tuple[Cause, float]
# time constants of a warm-up, in shares of the campaign
WARM_UP_SHARES = (0.05, 0.1, 0.25, 0.5)


def build_warming_causes(problem: Problem) -> Causes:
    """List drift and exponential warm-up.

    They follow the clock where the data have one, else the place in the order of motion."""
    clock, _ = choose_clock(problem)
    warm_ups = build_warm_ups(problem, WARM_UP_SHARES)
    rested = choose_rest_clock(problem)
    if rested is not None:
        warm_ups += build_warm_ups(problem, WARM_UP_SHARES, rested)
    if clock != PROGRESS:
        return warm_ups
    return (clock, *warm_ups)


def build_warm_ups(problem: Problem, shares: Iterable[float], by: Clock | None = None) -> Causes:
    """List exponential warm-ups whose time constants are some shares of what a clock covers, by default
    the campaign."""
    clock, duration = by or choose_clock(problem)
    if not duration:
        return ()
    warm_ups = []
    for share in shares:
        constant = float(f"{share * duration:.6g}")
        since = clock / -constant
        warm_up = Applied("exp", since)
        warm_ups.append(warm_up)
    return tuple(warm_ups)


def choose_clock(problem: Problem) -> Clock:
    """Choose what tells the time since the campaign began, and how long that was.

    It is the clock where the data have one, else the place in the order of motion."""
    covariates = problem.data.covariates
    if "time_s" not in covariates:
        return PROGRESS, 1.0
    time = covariates["time_s"]
    start = float(time.min())
    clock: Cause = Named("time_s", "s")
    if start:
        clock = clock - start
    return clock, float(np.ptp(time))


def choose_rest_clock(problem: Problem) -> Clock | None:
    """Choose what tells how long the arm has been at work since it last stood for long, and the longest
    time that it was. None where it never stood for long."""
    since = problem.data.since_rest
    _, duration = choose_clock(problem)
    if since is None or "time_s" not in problem.data.covariates:
        return None
    longest = float(since.max())
    if not 0 < longest <= duration - REST:
        return None
    return Named("since_rest_s", "s"), longest
