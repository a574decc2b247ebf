"""The rows of a problem as sights, in parts whose placements and targets no row joins."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .._linalg import connected_components
from .._typing import Index
from ..fitting.problem import Problem
from .placement import Sight


def number_groups(problem: Problem, per_group: bool) -> tuple[Index, int]:
    """Number the groups that have a placement each: (group of every row (m,), their count)."""
    if per_group:
        groups = problem.data.groups
        return problem.data.group, len(groups)
    count = len(problem)
    one_group = np.zeros(count, np.intp)
    return one_group, 1


def name_group(problem: Problem, g: int, per_group: bool) -> str:
    """Name a group that has a placement, for a message."""
    if not per_group:
        return "the data"
    name = problem.data.groups[g]
    return f"group {name}"


def build_sight(problem: Problem, group: Index, count: int) -> Sight:
    """Build the sight of a problem's rows, for `count` placements."""
    flange = replace(problem, tools=np.zeros_like(problem.tools)).pose(slice(None))
    has_orientations = problem.tool_rotations is not None
    return Sight(
        x=problem.data.position,
        o=flange.target.T,
        F=np.ascontiguousarray(flange.axes[-1, :3].transpose(2, 1, 0)),
        group=group,
        target=problem.data.target,
        groups=count,
        usual=problem.tools,
        seen=np.asarray(problem.data.rotation) if has_orientations else None,
    )


class Part(NamedTuple):
    """Rows whose placements and targets no row joins to others: their sight with groups and targets
    numbered anew, and the original numbers of the groups and targets."""

    sight: Sight
    groups: Index
    targets: Index


def split_independent(sight: Sight) -> Iterator[Part]:
    """Split the rows into parts that share neither a group nor a target."""
    G = sight.groups
    T = len(sight.usual)
    after_groups = G + sight.target
    pairs = np.column_stack([sight.group, after_groups])
    label = connected_components(G + T, pairs)
    of_group = label[:G]
    of_target = label[G:]
    of_row = of_group[sight.group]
    for k in np.unique(of_row):
        rows = np.flatnonzero(of_row == k)
        groups = np.flatnonzero(of_group == k)
        targets = np.flatnonzero(of_target == k)
        part = sight.take(rows)
        renumbered = replace(
            part,
            group=np.searchsorted(groups, part.group),
            groups=len(groups),
            usual=sight.usual[targets],
            target=np.searchsorted(targets, part.target),
        )
        yield Part(renumbered, groups, targets)
