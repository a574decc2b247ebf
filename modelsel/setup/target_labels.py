"""Whether the names of targets change places in a part of the file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .._typing import Array, Index
from ..exceptions import DataError, NotEstimable, sentence_list
from ..fitting.problem import Problem
from ..robot.kinematics import pose
from .other_robots import describe_improvement
from .registration import register

ROUNDS = 8
# rows of another name, below which nothing is said: single rows are outliers, and looked at as such
LEAST = 2
FACTOR = 4.0  # other names explain the positions if with them they fit so much better (mean)
# of the reach: a mean distance from which names that change places half-way are tried, too
BAD = 3e-3


def describe_swapped_labels(
    problem: Problem, use: NDArray[np.bool_], registered: bool, per_group: bool = False
) -> str | None:
    """A sentence that says in which of the rows `use` (mask) targets have each other's names, with
    the mean distance before and after; None where the names are as the positions have them. Where
    the targets were found from the rows (`registered`), they are found again with every new
    guess."""
    data = problem.data
    use = use if data.gauges is None else use & data.gauges.of("point")
    if len(np.unique(data.target[use])) < 2:
        return None
    some = problem.take(use).plain_points()
    given = some.data.target
    before, found = _mean(some, given), (np.inf, given)
    for start in _starts(some, before):
        found = min(found, _settled(some, start, registered, per_group), key=lambda each: each[0])
        if found[0] <= before / FACTOR:
            break
    label = found[1]
    if (
        registered and len(np.unique(given)) == 2 and (label != given).mean() > 0.5
    ):  # which of the two is which is a choice
        label = np.unique(given).sum() - label
    other = label != given
    if other.sum() < LEAST or found[0] > before / FACTOR:
        return None
    moves = sorted({(int(a), int(b)) for a, b in zip(given[other], label[other], strict=True)})
    words = sentence_list([f'"{data.targets[a]}" is "{data.targets[b]}"' for a, b in moves])
    return (
        f"In {int(other.sum())} of {len(given)} rows targets have each other's names "
        f"({some.data.where.spans(some.data.row[other])}): {words}"
        f" there. With the names changed the positions fit {describe_improvement(before, found[0])} ({found[0]:.2g} mm in place of "
        f"{before:.3g} mm, mean): correct the column target."
    )


def _starts(problem: Problem, before: float) -> Iterator[Index]:
    """The names as given; where they leave much, those of two targets changed from the middle of
    the file on."""
    given = problem.data.target
    yield given
    if before > BAD * problem.reach_mm and len(np.unique(given)) == 2:
        late = problem.data.row > np.median(problem.data.row)
        yield np.where(late, np.unique(given).sum() - given, given)


def _settled(
    problem: Problem, label: Index, registered: bool, per_group: bool
) -> tuple[float, Index]:
    """(mean distance [mm], names (m,)) where every row takes the name that it fits best, until none
    changes any more."""
    present, given = np.unique(label), problem.data.target
    at = problem if (label == given).all() else _placed(problem, label, registered, per_group)
    best = _mean(at, label)
    for _ in range(ROUNDS):
        again = present[_distances(at)[:, present].argmin(1)]
        if (again == label).all():
            break
        other = _placed(problem, again, registered, per_group)
        left = _mean(other, again)
        if left >= best:
            break
        at, label, best = other, again, left
    return best, label


def _placed(problem: Problem, label: Index, registered: bool, per_group: bool) -> Problem:
    """The problem under other names, its targets found again where they were found before."""
    other = replace(problem, data=replace(problem.data, target=label))
    try:
        return register(other, np.ones(len(problem), bool), per_group) if registered else other
    except (DataError, NotEstimable):
        return other


def _mean(problem: Problem, label: Index) -> float:
    return float(_distances(problem)[np.arange(len(label)), label].mean())


def _distances(problem: Problem) -> Array:
    """(m, T) mm from every measured position to where each target would be."""
    out = np.empty((len(problem), len(problem.tools)))
    for rows in problem.blocks():
        at = pose(problem.robot, problem.data.q[rows], np.zeros(3))
        flange, group = at.axes[-1, :3].transpose(2, 1, 0), problem.data.group[rows]
        base = np.einsum(
            "mji,mj->mi",
            problem.placement[0][group],
            problem.data.position[rows] - problem.placement[1][group],
        )
        place = at.target.T[:, None] + np.einsum("mij,tj->mti", flange, problem.tools)
        out[rows] = np.linalg.norm(base[:, None] - place, axis=2)
    return out
