"""Whether another robot fits the readings better, or the same readings a row earlier or later."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .._typing import Index
from ..exceptions import DataError, NotEstimable
from ..fitting.design import residuals
from ..fitting.problem import Problem
from ..robot.kinematics import Robot
from .registration import register

ROWS = 120  # that are looked at, spread over the file
LEAST = 10  # configurations
BAD = 3e-3  # of the reach: a median residual from which other robots are tried
FACTOR = 4.0  # another robot explains the positions if with it they fit so much better,
MAX_REACH_SHARE = 0.02  # and to this share of the reach (median)
MOST = 2000  # rows in their order, when positions are held against other rows' readings
SHIFTS = (1, -1, 2, -2)


def describe_improvement(before: float, after: float) -> str:
    """How much better something fits, in words."""
    return f"{before / after:.0f} times better" if before < 1e4 * after else "far better"


def compute_registered_misfit(problem: Problem) -> float:
    """Median distance [mm] of the positions from the nominal arm, tracker and targets found from
    them; infinite where these cannot be found."""
    try:
        at = register(problem, np.ones(len(problem), bool), per_group=False)
    except (DataError, NotEstimable):
        return float("inf")
    return float(np.median(np.linalg.norm(residuals(at)[:, :3], axis=1)))


def sample_positions(problem: Problem, use: NDArray[np.bool_]) -> Problem | None:
    """At most ROWS measured positions of one target and one group, spread over the rows `use`
    (mask); None where too few."""
    rows = _rows(problem, use)
    rows = (
        rows[np.unique(np.linspace(0, len(rows) - 1, min(len(rows), ROWS)).astype(int))]
        if len(rows)
        else rows
    )
    if len(np.unique(problem.data.block[rows])) < LEAST:
        return None
    return problem.take(rows).plain_points()


def _rows(problem: Problem, use: NDArray[np.bool_]) -> Index:
    data = problem.data
    rows = np.flatnonzero(use if data.gauges is None else use & data.gauges.of("point"))
    for index in (data.target, data.group):
        rows = rows[index[rows] == np.bincount(index[rows]).argmax()] if len(rows) else rows
    return rows


def describe_other_robot(
    problem: Problem,
    use: NDArray[np.bool_],
    robots: Callable[[], Mapping[str, Robot]],
    always: bool = False,
) -> str | None:
    """A sentence that says which of other `robots` fits the rows `use` (mask) of a problem better
    than its own, with the median distance before and after, tracker and target found for each; None
    where its own leaves little (unless `always`), or no other fits."""
    some = sample_positions(problem, use)
    if some is None:
        return None
    own, reach = problem.robot, problem.reach_mm
    before = compute_registered_misfit(some)
    if before < BAD * reach and not always:
        return None
    tried = [
        (compute_registered_misfit(replace(some, robot=robot)), name, robot.reach)
        for name, robot in robots().items()
        if robot.prismatic == own.prismatic and name != own.name
    ]
    if not tried:
        return None
    after, name, size = min(tried)
    if after > before / FACTOR or after > MAX_REACH_SHARE * size:
        return None
    return (
        f'The readings fit robot "{name}" {describe_improvement(before, after)} than "{own.name}" ({after:.2g} mm in '
        f"place of {before:.3g} mm, median, tracker and target found for each): check the robot's name or file in the study."
    )


def describe_shifted_rows(
    problem: Problem, use: NDArray[np.bool_], shifts: Iterable[int] = SHIFTS
) -> str | None:
    """A sentence that says by how many rows positions and readings stand apart; None where no shift
    fits better."""
    rows = _rows(problem, use)
    if len(np.unique(problem.data.block[rows])) < LEAST:
        return None
    whole = problem.take(rows[:MOST]).plain_points()
    reach = problem.reach_mm
    if (
        float(np.median(np.linalg.norm(residuals(whole), axis=1))) < BAD * reach
        or (before := compute_registered_misfit(whole)) < BAD * reach
    ):
        return None
    tried = []
    for k in shifts:
        keep = np.ones(len(rows), bool)
        keep[-k if k > 0 else 0 : None if k > 0 else -k] = (
            False  # the rows whose position comes round from the other end
        )
        data = replace(whole.data, position=np.roll(whole.data.position, -k, 0))
        tried.append((compute_registered_misfit(replace(whole, data=data).take(keep)), k))
    after, k = min(tried, key=lambda each: each[0])
    if not after <= before / FACTOR:
        return None
    words = f"{abs(k)} row{'s' * (abs(k) > 1)} further {'down' if k > 0 else 'up'}"
    return (
        f"The positions fit {describe_improvement(before, after)} ({after:.2g} mm in place of {before:.3g} mm, median) if each "
        f"row's readings go with the position {words}: check how the two were joined."
    )
