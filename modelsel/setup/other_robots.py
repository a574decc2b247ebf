"""Whether another robot fits the readings better, or the same readings a row earlier or later."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from .._typing import Index, Mask
from ..exceptions import write_rounded
from ..fitting.design import residuals
from ..fitting.problem import Problem
from ..measurements.campaign.visits import count_distinct
from ..robot.alignment import have_same_chain
from ..robot.kinematics import Robot
from .improvement import BAD_SHARE, MIN_IMPROVEMENT, describe_improvement
from .registration import register_each

# rows that are examined, spread over the file, and configurations that are needed
MAX_ROWS = 120
MIN_CONFIGURATIONS = 10
# the nominal arm fits to this share of its reach (median), where robot and columns are right
MAX_REACH_SHARE = 0.02
# rows in their order whose positions are compared with other rows' readings, and by how many rows
MAX_ORDERED_ROWS = 2000
SHIFTS = (1, -1, 2, -2)


def compute_registered_misfit(problem: Problem) -> float:
    """Compute the median distance [mm] of the positions from the nominal arm, with tracker and
    targets found from them; infinite where these cannot be found."""
    (misfit,) = _compute_registered_misfits([problem])
    return misfit


def _compute_registered_misfits(problems: Sequence[Problem]) -> list[float]:
    """Compute what is left of each of several problems."""
    misfits = []
    for registered in register_each(problems):
        misfit = float("inf") if registered is None else _compute_median(registered)
        misfits.append(misfit)
    return misfits


def _compute_median(problem: Problem) -> float:
    residual = residuals(problem)
    offset = residual[:, :3]
    distance = np.linalg.norm(offset, axis=1)
    median = np.median(distance)
    return float(median)


def sample_positions(problem: Problem, use: Mask, one_group: bool = True) -> Problem | None:
    """Sample at most MAX_ROWS measured positions of one target (and of `one_group`), spread over the
    rows `use` (mask); None where there are too few configurations."""
    rows = select_most_frequent(problem, use, one_group)
    count = len(rows)
    if count:
        chosen = min(count, MAX_ROWS)
        spread = np.linspace(0, count - 1, chosen)
        places = spread.astype(int)
        rows = rows[np.unique(places)]
    configurations = _count_configurations(problem, rows)
    if configurations < MIN_CONFIGURATIONS:
        return None
    sample = problem.take(rows)
    return sample.plain_points()


def select_most_frequent(problem: Problem, use: Mask, one_group: bool = True) -> Index:
    """Select the points among the rows `use` (mask) of the target, and of the group, that most of
    them have."""
    data = problem.data
    if data.gauges is not None:
        use = use & data.gauges.of("point")
    rows = np.flatnonzero(use)
    numbered = [data.target]
    if one_group:
        numbered.append(data.group)
    for numbers in numbered:
        if not len(rows):
            break
        of_rows = numbers[rows]
        counts = np.bincount(of_rows)
        most_frequent = counts.argmax()
        rows = rows[of_rows == most_frequent]
    return rows


def _count_configurations(problem: Problem, rows: Index) -> int:
    block = problem.data.block
    return count_distinct(block[rows])


def describe_other_robot(
    problem: Problem, use: Mask, robots: Callable[[], Mapping[str, Robot]], always: bool = False
) -> str | None:
    """Describe which of other `robots` fits the rows `use` (mask) of a problem better than its own,
    with the median distance before and after, tracker and target found for each.

    None where its own leaves little (unless `always`), or no other fits."""
    sample = sample_positions(problem, use)
    if sample is None:
        return None
    own = problem.robot
    before = compute_registered_misfit(sample)
    if before < BAD_SHARE * problem.reach_mm and not always:
        return None
    others = {
        name: robot
        for name, robot in robots().items()
        if robot.prismatic == own.prismatic and not have_same_chain(robot, own)
    }
    replaced = [replace(sample, robot=robot) for robot in others.values()]
    misfits = _compute_registered_misfits(replaced)
    reaches = [robot.reach for robot in others.values()]
    tried = zip(misfits, others, reaches, strict=True)
    after, name, reach = min(tried, default=(np.inf, "", 0.0))
    if after > before / MIN_IMPROVEMENT or after > MAX_REACH_SHARE * reach:
        return None
    fit = f'robot "{name}"'
    than = f'"{own.name}"'
    remedy = "check the robot's name or file in the study"
    if name == own.name:
        fit = f'the built-in robot "{name}"'
        than = "the given robot of that name"
        remedy = "check the convention, the units and the rows of the robot file"
    improvement = describe_improvement(before, after)
    return (
        f"The readings fit {fit} {improvement} than {than} "
        f"({write_rounded(after, 2)} mm instead of {write_rounded(before)} mm, median, instrument and target found for each): "
        f"{remedy}."
    )


def describe_shifted_rows(problem: Problem, use: Mask) -> str | None:
    """Describe by how many rows positions and readings are shifted against each other; None where no
    shift fits better."""
    rows = select_most_frequent(problem, use)
    configurations = _count_configurations(problem, rows)
    if configurations < MIN_CONFIGURATIONS:
        return None
    first_rows = rows[:MAX_ORDERED_ROWS]
    ordered = problem.take(first_rows).plain_points()
    least = BAD_SHARE * problem.reach_mm
    if _compute_median(ordered) < least:
        return None
    before = compute_registered_misfit(ordered)
    if before < least:
        return None
    shifted = [_shift_positions(ordered, shift) for shift in SHIFTS]
    misfits = _compute_registered_misfits(shifted)
    tried = zip(misfits, SHIFTS, strict=True)
    after, k = min(tried, key=lambda trial: trial[0])
    if not after <= before / MIN_IMPROVEMENT:
        return None
    plural = "s" if abs(k) > 1 else ""
    direction = "down" if k > 0 else "up"
    return (
        f"The positions fit {describe_improvement(before, after)} ({write_rounded(after, 2)} mm instead of "
        f"{write_rounded(before)} mm, median) if each row's readings go with the position {abs(k)} "
        f"row{plural} further {direction}: check how the two were joined."
    )


def _shift_positions(problem: Problem, k: int) -> Problem:
    """Give every row the position k rows further down, without the rows that have none."""
    count = len(problem)
    position = np.roll(problem.data.position, -k, axis=0)
    data = replace(problem.data, position=position)
    shifted = replace(problem, data=data)
    source = np.arange(count) + k
    exists = (source >= 0) & (source < count)
    return shifted.take(exists)
