"""Whether the names of targets are exchanged in a part of the file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .._typing import Array, Index, Mask
from ..exceptions import DataError, NotEstimable, sentence_list
from ..fitting.problem import Problem
from ..robot.kinematics import pose
from .other_robots import describe_improvement
from .registration import register

MAX_ROUNDS = 8
# rows of another name below which nothing is reported: single rows are outliers, and treated as such
MIN_ROWS = 2
# other names explain the positions where they reduce the mean distance by this factor
MIN_IMPROVEMENT = 4.0
# mean distance, as a share of the reach, from which names exchanged half-way are tried too
BAD_SHARE = 3e-3


class _Labelling(NamedTuple):
    """Names of the targets (m,) and the mean distance [mm] that they leave."""

    left: float
    label: Index


def describe_swapped_labels(
    problem: Problem, use: Mask, registered: bool, per_group: bool = False
) -> str | None:
    """Describe in which of the rows `use` (mask) targets have each other's names, with the mean
    distance before and after; None where the names are as the positions have them.

    Where the targets were found from the rows (`registered`), they are found again with every new
    guess."""
    gauges = problem.data.gauges
    use = use if gauges is None else use & gauges.of("point")
    if len(np.unique(problem.data.target[use])) < 2:
        return None
    points = problem.take(use).plain_points()
    given = points.data.target
    before = _compute_mean(points, given)
    left, label = _find_labels(points, before, registered, per_group)
    if registered:
        label = _prefer_given(given, label)
    is_other = label != given
    if is_other.sum() < MIN_ROWS or left > before / MIN_IMPROVEMENT:
        return None
    return _describe(points, label, before, left)


def _find_labels(problem: Problem, before: float, registered: bool, per_group: bool) -> _Labelling:
    """Find the names that leave least, from several starts."""
    best = _Labelling(np.inf, problem.data.target)
    for start in _generate_starts(problem, before):
        labelling = _settle_labels(problem, start, registered, per_group)
        if labelling.left < best.left:
            best = labelling
        if best.left <= before / MIN_IMPROVEMENT:
            break
    return best


def _prefer_given(given: Index, label: Index) -> Index:
    """Exchange the names of two targets if most rows then have the given one: for targets that were
    found from the rows, which of the two is which is a choice."""
    names = np.unique(given)
    most_differ = (label != given).mean() > 0.5
    return names.sum() - label if len(names) == 2 and most_differ else label


def _describe(problem: Problem, label: Index, before: float, after: float) -> str:
    data, given = problem.data, problem.data.target
    rows = label != given
    moves = sorted({(int(a), int(b)) for a, b in zip(given[rows], label[rows], strict=True)})
    names = sentence_list([f'"{data.targets[a]}" is "{data.targets[b]}"' for a, b in moves])
    return (
        f"In {int(rows.sum())} of {len(given)} rows targets have each other's names "
        f"({data.where.spans(data.row[rows])}): {names} there. With the names changed the positions "
        f"fit {describe_improvement(before, after)} ({after:.2g} mm instead of {before:.3g} mm, "
        "mean): correct the column target."
    )


def _generate_starts(problem: Problem, before: float) -> Iterator[Index]:
    """Generate the names as given and, where they leave much, those of two targets exchanged from
    the middle of the file on."""
    given = problem.data.target
    yield given
    names = np.unique(given)
    if before > BAD_SHARE * problem.reach_mm and len(names) == 2:
        is_late = problem.data.row > np.median(problem.data.row)
        yield np.where(is_late, names.sum() - given, given)


def _settle_labels(problem: Problem, label: Index, registered: bool, per_group: bool) -> _Labelling:
    """Give every row the name that it fits best, until none changes any more."""
    names = np.unique(label)
    is_given = (label == problem.data.target).all()
    at = problem if is_given else _relabel(problem, label, registered, per_group)
    best = _compute_mean(at, label)
    for _ in range(MAX_ROUNDS):
        again = names[_compute_distances(at)[:, names].argmin(1)]
        if (again == label).all():
            break
        relabelled = _relabel(problem, again, registered, per_group)
        left = _compute_mean(relabelled, again)
        if left >= best:
            break
        at, label, best = relabelled, again, left
    return _Labelling(best, label)


def _relabel(problem: Problem, label: Index, registered: bool, per_group: bool) -> Problem:
    """Give the rows other names, and find the targets again where they were found before."""
    relabelled = replace(problem, data=replace(problem.data, target=label))
    if not registered:
        return relabelled
    try:
        return register(relabelled, np.ones(len(problem), bool), per_group)
    except (DataError, NotEstimable):
        return relabelled


def _compute_mean(problem: Problem, label: Index) -> float:
    """Compute the mean distance [mm] of the measured positions from the targets named (m,)."""
    distances = _compute_distances(problem)
    to_named = distances[np.arange(len(label)), label]
    return float(to_named.mean())


def _compute_distances(problem: Problem) -> Array:
    """Compute (m, T) distances [mm] from every measured position to where each target would be."""
    distances = np.empty((len(problem), len(problem.tools)))
    R, t = problem.placement
    for rows in problem.blocks():
        flange = pose(problem.robot, problem.data.q[rows], np.zeros(3))
        rotation, group = flange.axes[-1, :3].transpose(2, 1, 0), problem.data.group[rows]
        offset = problem.data.position[rows] - t[group]
        base = np.einsum("mji,mj->mi", R[group], offset)
        tools = np.einsum("mij,tj->mti", rotation, problem.tools)
        places = flange.target.T[:, None] + tools
        distances[rows] = np.linalg.norm(base[:, None] - places, axis=2)
    return distances
