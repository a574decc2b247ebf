"""Whether the names of targets are exchanged in a part of the file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .._typing import Array, Index, Mask
from ..exceptions import DataError, NotEstimable, sentence_list, write_rounded
from ..fitting.problem import Problem
from ..robot.kinematics import pose
from .improvement import BAD_SHARE, MIN_IMPROVEMENT, describe_improvement
from .registration import register

MAX_ROUNDS = 8
# rows of another name below which nothing is reported: single rows are outliers, and treated as such
MIN_ROWS = 2


class _Labelling(NamedTuple):
    """Names of the targets (m,) and the mean distance [mm] that they leave."""

    left: float
    label: Index


class SwappedLabels(NamedTuple):
    """Targets that have each other's names: a sentence, and the rows of the file (0-based)."""

    sentence: str
    rows: tuple[int, ...]


def find_swapped_labels(
    problem: Problem, use: Mask, registered: bool, per_group: bool = False
) -> SwappedLabels | None:
    """Find in which of the rows `use` (mask) targets have each other's names, with the mean
    distance before and after; None where the names are as the positions have them.

    Where the targets were found from the rows (`registered`), they are found again with every new
    guess."""
    gauges = problem.data.gauges
    if gauges is not None:
        use = use & gauges.of("point")
    measured = np.unique(problem.data.target[use])
    if len(measured) < 2:
        return None
    points = problem.take(use).plain_points()
    given = points.data.target
    before = _compute_mean(points, given)
    left, label = _find_labels(points, before, registered, per_group)
    if registered:
        label = _prefer_given(given, label)
    is_other = label != given
    is_single = is_other.sum() < MIN_ROWS
    if is_single or left > before / MIN_IMPROVEMENT:
        return None
    rows = points.data.row[is_other].tolist()
    return SwappedLabels(_describe(points, label, before, left), tuple(rows))


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
    """Exchange the names of two targets if most rows then have the given one.

    For targets that were found from the rows, which of the two is which is a choice."""
    names = np.unique(given)
    if len(names) != 2:
        return label
    share = (label != given).mean()
    most_differ = share > 0.5
    return names.sum() - label if most_differ else label


def _describe(problem: Problem, label: Index, before: float, after: float) -> str:
    data = problem.data
    given = data.target
    is_other = label != given
    pairs = zip(given[is_other], label[is_other], strict=True)
    moves = sorted({(int(a), int(b)) for a, b in pairs})
    names = []
    for a, b in moves:
        other = data.targets[b]
        names.append(f'"{data.targets[a]}" is "{other}"')
    count = int(is_other.sum())
    spans = data.where.spans(data.row[is_other])
    exchanged = sentence_list(names)
    improvement = describe_improvement(before, after)
    return (
        f"In {count:,} of {len(given):,} rows targets have each other's names "
        f"({spans}): {exchanged} there. "
        "With the names changed the positions "
        f"fit {improvement} "
        f"({write_rounded(after, 2)} mm instead of {write_rounded(before)} mm, "
        "mean): correct the column target."
    )


def _generate_starts(problem: Problem, before: float) -> Iterator[Index]:
    """Generate the names as given and, where they leave much (mean), those of two targets exchanged
    from the middle of the file on."""
    data = problem.data
    given = data.target
    yield given
    names = np.unique(given)
    limit = BAD_SHARE * problem.reach_mm
    is_bad = before > limit
    if is_bad and len(names) == 2:
        middle = np.median(data.row)
        is_late = data.row > middle
        exchanged = names.sum() - given
        yield np.where(is_late, exchanged, given)


def _settle_labels(problem: Problem, label: Index, registered: bool, per_group: bool) -> _Labelling:
    """Give every row the name that it fits best, until none changes any more."""
    names = np.unique(label)
    is_given = (label == problem.data.target).all()
    at = problem
    if not is_given:
        at = _relabel(problem, label, registered, per_group)
    best = _compute_mean(at, label)
    for _ in range(MAX_ROUNDS):
        distances = _compute_distances(at)
        of_names = distances[:, names]
        nearest = of_names.argmin(1)
        again = names[nearest]
        if (again == label).all():
            break
        relabelled = _relabel(problem, again, registered, per_group)
        left = _compute_mean(relabelled, again)
        if left >= best:
            break
        at = relabelled
        label = again
        best = left
    return _Labelling(best, label)


def _relabel(problem: Problem, label: Index, registered: bool, per_group: bool) -> Problem:
    """Give the rows other names, and find the targets again where they were found before."""
    data = replace(problem.data, target=label)
    relabelled = replace(problem, data=data)
    if not registered:
        return relabelled
    every_row = np.ones(len(problem), bool)
    try:
        return register(relabelled, every_row, per_group)
    except (DataError, NotEstimable):
        return relabelled


def _compute_mean(problem: Problem, label: Index) -> float:
    """Compute the mean distance [mm] of the measured positions from the targets named (m,)."""
    distances = _compute_distances(problem)
    rows = np.arange(len(label))
    to_named = distances[rows, label]
    mean = to_named.mean()
    return float(mean)


def _compute_distances(problem: Problem) -> Array:
    """Compute (m, T) distances [mm] from every measured position to where each target would be."""
    shape = len(problem), len(problem.tools)
    distances = np.empty(shape)
    R, t = problem.placement
    for rows in problem.blocks():
        flange = pose(problem.robot, problem.data.q[rows], np.zeros(3))
        axes = flange.axes[-1, :3]
        rotation = axes.transpose(2, 1, 0)
        group = problem.data.group[rows]
        position = problem.data.position[rows]
        base = np.einsum("mji,mj->mi", R[group], position - t[group])
        offsets = np.einsum("mij,tj->mti", rotation, problem.tools)
        origin = flange.target.T
        places = origin[:, None] + offsets
        distances[rows] = np.linalg.norm(base[:, None] - places, axis=2)
    return distances
