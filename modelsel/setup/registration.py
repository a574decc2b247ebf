"""Registration from scratch: where the tracker stands and where the targets sit, without a start
value.

Several starts are descended on the exact model (`placing`) and the one with the least robust misfit
is taken: a linear solve for a free affine map tracker -> frame 0 per placement and every target's
offset (methods.md N), rigid fits with the targets where the study says, where the flange pivots and
around, and the measured orientations where there are any: the affine map is lost where the points
lie on a line or a plane, and where the target may sit at a point that no joint moves, as on a
two-axis positioner. Groups that share no target are placed apart. What the rows leave open is
refused, or said by `undetermined`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .._typing import Array, Index
from ..exceptions import DataError, NotEstimable, sentence_list
from ..fitting.problem import Problem
from ..notices import Note
from .placement import (
    GROSS,
    MEDIAN_3,
    Placed,
    Sight,
    compute_misfits,
    compute_trimmed_median,
    refine_robustly,
    refine_without_gross_rows,
    spread,
)
from .starting_values import THIN, about_lines, starts

LEAST = 4  # configurations per placement
# rows on which starts are tried, spread over the data, or LEAST_ROWS of every group and target
ROWS = 300
MIN_PAIR_ROWS = 30
ALIKE = 1e-3  # relative difference of misfits that are one minimum
SAME_MINIMUM = (
    0.01  # share of the points' spread below which agreement of two starts ends the search
)
GOOD_SHARE = 1.0  # rad: standard deviation of a placement's turn at which registration is refused,
DOUBT = 0.035  # from which it is said,
OPEN_MM = 100.0  # and that of a target's place from which it is


def register(problem: Problem, use: NDArray[np.bool_], per_group: bool) -> Problem:
    """The problem with placement(s) and tools found from the rows `use` (mask). Raises DataError with
    too few rows, NotEstimable where the rows do not tell how the tracker stands."""
    if problem.data.gauges is not None:
        return _by_points(problem, use & problem.data.gauges.of("point"), per_group)
    some = problem.take(use)
    group, count = _groups(some, per_group)
    for g in range(count):
        seen = len(np.unique(some.data.configuration[group == g]))
        if seen < LEAST:
            raise DataError(
                f"{_where(some, g, per_group)} has {seen} estimation configurations; registration needs {LEAST} per "
                "placement.",
                remedy="Measure more, or choose another [split].",
            )
    sight = _sight(some, group, count)
    R, t = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
    tools, turned = (
        problem.tools.copy(),
        None if problem.tool_rotations is None else problem.tool_rotations.copy(),
    )
    for part, groups, targets in _parts(sight):
        at, good = _found(part)
        sure = spread(part, at, good)[0]
        if sure.max() > GOOD_SHARE:
            raise _lost(
                part,
                at,
                int(sure.argmax()),
                _where(some, int(groups[sure.argmax()]), per_group),
                float(sure.max()),
            )
        R[groups], t[groups], tools[targets] = at.R, at.t, at.tools
        if turned is not None:
            turned[targets] = at.turned
    rows = np.arange(count) if per_group else np.zeros(len(problem.data.groups), np.intp)
    return replace(problem, placement=(R[rows], t[rows]), tools=tools, tool_rotations=turned)


def note_undetermined(
    problem: Problem, use: NDArray[np.bool_], per_group: bool, usual: Array
) -> tuple[Note, ...]:
    """What the rows `use` (mask) of a registered problem tell poorly: a placement's turn, a target's
    place; `usual` (T, 3) where the targets were expected."""
    some = problem.take(
        use if problem.data.gauges is None else use & problem.data.gauges.of("point")
    )
    group, count = _groups(some, per_group)
    notes: list[Note] = []
    whole = replace(_sight(some, group, count), usual=usual)
    for part, groups, targets in _parts(whole):
        first = np.array([np.flatnonzero(group == g)[0] for g in groups])
        at = Placed(
            some.placement[0][some.data.group[first]],
            some.placement[1][some.data.group[first]],
            some.tools[targets],
            None if some.tool_rotations is None else some.tool_rotations[targets],
        )
        size = compute_misfits(part, at)
        turn, place = spread(part, at, size <= GROSS * compute_trimmed_median(size, part.open))
        notes += [
            _weak(part, at, int(g), float(turn[g]), _where(some, int(groups[g]), per_group))
            for g in np.flatnonzero(turn > DOUBT)
        ]
        if (place > OPEN_MM).any():
            names = sentence_list([some.data.targets[k] for k in targets[place > OPEN_MM]])
            notes.append(
                Note(
                    "target-weak",
                    f"The rows do not determine in every direction where target {names} sits on the "
                    "flange, and it is taken to be near it: give tool_mm, or measure it with the flange turned other "
                    "ways.",
                )
            )
    return tuple(notes)


def _groups(problem: Problem, per_group: bool) -> tuple[Index, int]:
    return (
        (problem.data.group, len(problem.data.groups))
        if per_group
        else (np.zeros(len(problem), np.intp), 1)
    )


def _where(problem: Problem, g: int, per_group: bool) -> str:
    return f"group {problem.data.groups[g]}" if per_group else "the data"


def _by_points(problem: Problem, use: NDArray[np.bool_], per_group: bool) -> Problem:
    """The same where not every row is a point: from the points alone."""
    some = problem.take(use)
    seen = some.data.configurations
    if seen < LEAST:
        raise DataError(
            f"{seen} estimation configurations have a measured point; registration needs {LEAST}.",
            remedy="Measure more points, or leave register out: the rest is told in the robot's own frame.",
        )
    found = register(
        replace(some, data=replace(some.data, gauges=None)), np.ones(len(some), bool), per_group
    )
    return replace(
        problem, placement=found.placement, tools=found.tools, tool_rotations=found.tool_rotations
    )


def _sight(problem: Problem, group: Index, count: int) -> Sight:
    bare = replace(problem, tools=np.zeros_like(problem.tools)).pose(slice(None))
    flange = np.ascontiguousarray(
        bare.axes[-1, :3].transpose(2, 1, 0)
    )  # (m, 3, 3): columns are the flange's axes
    seen = None if problem.tool_rotations is None else np.asarray(problem.data.rotation)
    return Sight(
        problem.data.position,
        bare.target.T,
        flange,
        group,
        problem.data.target,
        count,
        problem.tools,
        seen,
    )


def _parts(sight: Sight) -> Iterator[tuple[Sight, Index, Index]]:
    """(rows, their groups, their targets), numbered anew, of placements and targets that no row
    joins to others."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    G, T = sight.groups, len(sight.usual)
    joined = coo_array(
        (np.ones(len(sight.x)), (sight.group, G + sight.target)), shape=(G + T, G + T)
    )
    label = connected_components(joined, directed=False)[1]
    for part in np.unique(label[sight.group]):
        rows, groups, targets = (
            np.flatnonzero(label[own] == part)
            for own in (sight.group, np.arange(G), G + np.arange(T))
        )
        some = sight.take(rows)
        yield (
            replace(
                some,
                group=np.searchsorted(groups, some.group),
                groups=len(groups),
                usual=sight.usual[targets],
                target=np.searchsorted(targets, some.target),
            ),
            groups,
            targets,
        )


def _found(sight: Sight) -> tuple[Placed, NDArray[np.bool_]]:
    """(the placement with the least robust misfit over all starts, the rows that are not gross)."""
    pairs = [rows for *_, rows in sight.pairs()]
    most = max(ROWS // len(pairs), MIN_PAIR_ROWS)
    some = sight.take(
        np.sort(
            np.concatenate(
                [
                    rows[np.linspace(0, len(rows) - 1, min(len(rows), most)).astype(int)]
                    for rows in pairs
                ]
            )
        )
    )
    extent = float(
        np.median(
            np.concatenate(
                [
                    np.linalg.norm(some.x[rows] - np.median(some.x[rows], axis=0), axis=1)
                    for rows in (np.flatnonzero(some.group == g) for g in range(some.groups))
                ]
            )
        )
    )
    tried: list[Placed] = []
    for start in starts(some):
        tried.append(refine_robustly(some, start))
        if len(tried) > 1 and _agreed(some, tried, SAME_MINIMUM * extent):
            break
    best = tried[_least(some, tried)]
    tried = [best, *(refine_robustly(some, start) for start in about_lines(some, best))]
    return refine_without_gross_rows(sight, refine_robustly(sight, tried[_least(some, tried)]))


def _misfits(sight: Sight, tried: list[Placed]) -> Array:
    """Squares cut off at a common length, and how far targets are from where they are expected."""
    size = np.array([compute_misfits(sight, at) for at in tried])
    scale = float(compute_trimmed_median(size, sight.open).min())
    away = (
        np.array([np.square((at.tools - sight.usual) / sight.trust).sum() for at in tried])
        * (scale / MEDIAN_3) ** 2
    )
    return np.asarray(np.minimum(np.square(size), (GROSS * scale) ** 2).sum(1) + away)


def _least(sight: Sight, tried: list[Placed]) -> int:
    return int(_misfits(sight, tried).argmin())


def _agreed(sight: Sight, tried: list[Placed], well: float) -> bool:
    """Whether two starts have ended in the best minimum, and it explains the points."""
    misfit = _misfits(sight, tried)
    best = int(misfit.argmin())
    return (
        int((misfit <= misfit[best] * (1 + ALIKE)).sum()) > 1
        and float(np.median(compute_misfits(sight, tried[best]))) < well
    )


def _shape(sight: Sight, at: Placed, g: int) -> str:
    """What keeps a placement from being told, of its points' extents."""
    x = sight.x[sight.group == g]
    extent = np.linalg.svd(x - np.median(x, axis=0), compute_uv=False) / np.sqrt(len(x))
    off = float(np.median(compute_misfits(sight, at)[sight.group == g]))
    if extent[1] < THIN * extent[0]:
        return f"the points lie along a line, {extent[1]:.2g} mm off it where {off:.2g} mm are left (rms, median)"
    return f"the points lie within {extent[0]:.2g} mm of their middle where {off:.2g} mm are left (rms, median)"


def _weak(sight: Sight, at: Placed, g: int, turn: float, where: str) -> Note:
    return Note(
        "registration-weak",
        f"How the tracker is turned is known to {np.degrees(turn):.2g} degrees only (one standard "
        f"deviation, {where}): {_shape(sight, at, g)}. Measure points that spread in all directions of the room.",
    )


def _lost(sight: Sight, at: Placed, g: int, where: str, turn: float) -> NotEstimable:
    free = (
        "not at all"
        if turn > np.pi
        else f"to {np.degrees(turn):.0f} degrees only (one standard deviation)"
    )
    return NotEstimable(
        f"registration: how the tracker is turned is told {free} by {where}: {_shape(sight, at, g)}. Measure "
        "points that spread in all directions of the room, give tool_mm, or convert the positions to the robot's "
        "base and leave register out."
    )
