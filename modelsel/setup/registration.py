"""Registration: where the tracker stands and where the targets sit, without a start value.

Several starts are minimised on the exact model (`placement`), and the one with the least robust
misfit is taken (`starting_values`). A linear solve for a free affine map from the tracker to frame 0
fails where the points lie on a line or a plane, and where the target may sit at a point that no
joint moves, as on a two-axis positioner; rigid fits and measured orientations are tried too. Groups
that share no target are placed apart. What the rows leave open is refused, or reported by
`note_undetermined`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .._linalg import connected_components
from .._typing import Array, Index, Mask
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
    compute_uncertainty,
    refine_robustly,
    refine_without_gross_rows,
)
from .starting_values import THIN, generate_starts, turn_about_lines

# configurations per placement
MIN_CONFIGURATIONS = 4
# rows on which starts are tried, spread over the data, and at least of every group and target
START_ROWS = 300
MIN_PAIR_ROWS = 30
# relative difference of misfits that are one minimum
SAME_MINIMUM = 1e-3
# share of the points' spread below which agreement of two starts ends the search
GOOD_SHARE = 0.01
# standard deviation of a placement's turn [rad] at which registration is refused, and from which it
# is reported, and of a target's place [mm] from which it is reported
MAX_TURN = 1.0
REPORTED_TURN = 0.035
REPORTED_MM = 100.0

SPREAD_ADVICE = "Measure points that spread in all directions of the room"


def register(problem: Problem, use: Mask, per_group: bool) -> Problem:
    """Find placement(s) and tools from the rows `use` (mask) of a problem.

    Raises DataError with too few rows, NotEstimable where the rows do not determine how the tracker
    stands."""
    if problem.data.gauges is not None:
        return _register_points(problem, use & problem.data.gauges.of("point"), per_group)
    selected = problem.take(use)
    group, count = _number_groups(selected, per_group)
    _require_configurations(selected, group, count, per_group)
    R, t = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
    tools = problem.tools.copy()
    turned = None if problem.tool_rotations is None else problem.tool_rotations.copy()
    for part in _split_independent(_build_sight(selected, group, count)):
        at, good = _find_placement(part.sight)
        _require_known_turns(part, at, good, selected, per_group)
        R[part.groups], t[part.groups], tools[part.targets] = at.R, at.t, at.tools
        if turned is not None:
            turned[part.targets] = at.turned
    rows = np.arange(count) if per_group else np.zeros(len(problem.data.groups), np.intp)
    return replace(problem, placement=(R[rows], t[rows]), tools=tools, tool_rotations=turned)


def _register_points(problem: Problem, use: Mask, per_group: bool) -> Problem:
    """Register a problem in which not every row is a point: from its points alone."""
    selected = problem.take(use)
    count = selected.data.configurations
    if count < MIN_CONFIGURATIONS:
        raise DataError(
            f"{count} estimation configurations have a measured point; registration needs "
            f"{MIN_CONFIGURATIONS}.",
            remedy="Measure more points, or leave register out: the other rows are evaluated in the robot's own frame.",
        )
    points = replace(selected, data=replace(selected.data, gauges=None))
    registered = register(points, np.ones(len(points), bool), per_group)
    return replace(
        problem,
        placement=registered.placement,
        tools=registered.tools,
        tool_rotations=registered.tool_rotations,
    )


def _require_configurations(problem: Problem, group: Index, count: int, per_group: bool) -> None:
    for g in range(count):
        configurations = len(np.unique(problem.data.configuration[group == g]))
        if configurations < MIN_CONFIGURATIONS:
            raise DataError(
                f"{_name_group(problem, g, per_group)} has {configurations} estimation "
                f"configurations; registration needs {MIN_CONFIGURATIONS} per placement.",
                remedy="Measure more, or choose another [split].",
            )


def note_undetermined(
    problem: Problem, use: Mask, per_group: bool, usual: Array
) -> tuple[Note, ...]:
    """Note what the rows `use` (mask) of a registered problem determine poorly: a placement's turn,
    a target's place; `usual` (T, 3): where the targets were expected."""
    gauges = problem.data.gauges
    selected = problem.take(use if gauges is None else use & gauges.of("point"))
    group, count = _number_groups(selected, per_group)
    sight = replace(_build_sight(selected, group, count), usual=usual)
    notes: list[Note] = []
    for part in _split_independent(sight):
        at = _read_placement(selected, part, group)
        size = compute_misfits(part.sight, at)
        good = size <= GROSS * compute_trimmed_median(size, part.sight.unknowns)
        turn, place = compute_uncertainty(part.sight, at, good)
        for g in np.flatnonzero(turn > REPORTED_TURN):
            name = _name_group(selected, int(part.groups[g]), per_group)
            notes.append(_note_weak_turn(part.sight, at, int(g), float(turn[g]), name))
        weak = part.targets[place > REPORTED_MM]
        if len(weak):
            notes.append(_note_weak_targets([selected.data.targets[k] for k in weak]))
    return tuple(notes)


def _read_placement(problem: Problem, part: _Part, group: Index) -> Placed:
    """Read the placement of a part from a registered problem."""
    first = np.array([np.flatnonzero(group == g)[0] for g in part.groups])
    R, t = problem.placement
    of_group = problem.data.group[first]
    rotations = problem.tool_rotations
    turned = None if rotations is None else rotations[part.targets]
    return Placed(R[of_group], t[of_group], problem.tools[part.targets], turned)


def _number_groups(problem: Problem, per_group: bool) -> tuple[Index, int]:
    """Number the groups that have a placement each: (group of every row (m,), their count)."""
    if per_group:
        return problem.data.group, len(problem.data.groups)
    return np.zeros(len(problem), np.intp), 1


def _name_group(problem: Problem, g: int, per_group: bool) -> str:
    return f"group {problem.data.groups[g]}" if per_group else "the data"


def _build_sight(problem: Problem, group: Index, count: int) -> Sight:
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


class _Part(NamedTuple):
    """Rows whose placements and targets no row joins to others: their sight with groups and targets
    numbered anew, and the original numbers of the groups and targets."""

    sight: Sight
    groups: Index
    targets: Index


def _split_independent(sight: Sight) -> Iterator[_Part]:
    """Split the rows into parts that share neither a group nor a target."""
    G, T = sight.groups, len(sight.usual)
    pairs = np.column_stack([sight.group, G + sight.target])
    label = connected_components(G + T, pairs)
    of_group, of_target = label[:G], label[G:]
    for k in np.unique(of_group[sight.group]):
        rows = np.flatnonzero(of_group[sight.group] == k)
        groups, targets = np.flatnonzero(of_group == k), np.flatnonzero(of_target == k)
        part = sight.take(rows)
        renumbered = replace(
            part,
            group=np.searchsorted(groups, part.group),
            groups=len(groups),
            usual=sight.usual[targets],
            target=np.searchsorted(targets, part.target),
        )
        yield _Part(renumbered, groups, targets)


def _find_placement(sight: Sight) -> tuple[Placed, Mask]:
    """Find (the placement with the least robust misfit over all starts, mask of the rows that are
    not gross)."""
    sample = _thin(sight)
    good_mm = GOOD_SHARE * _compute_extent(sample)
    tried: list[Placed] = []
    for start in generate_starts(sample):
        tried.append(refine_robustly(sample, start))
        if len(tried) > 1 and _agree(sample, tried, good_mm):
            break
    best = tried[_find_least(sample, tried)]
    turned = [refine_robustly(sample, start) for start in turn_about_lines(sample, best)]
    candidates = [best, *turned]
    best = candidates[_find_least(sample, candidates)]
    return refine_without_gross_rows(sight, refine_robustly(sight, best))


def _thin(sight: Sight) -> Sight:
    """Thin every pair of group and target to rows spread over the data."""
    pairs = [rows for *_, rows in sight.pairs()]
    most = max(START_ROWS // len(pairs), MIN_PAIR_ROWS)
    chosen = [
        rows[np.linspace(0, len(rows) - 1, min(len(rows), most)).astype(int)] for rows in pairs
    ]
    return sight.take(np.sort(np.concatenate(chosen)))


def _compute_extent(sight: Sight) -> float:
    """Compute the median distance [mm] of points from the middle of their group."""
    middle = np.array([sight.middle(g) for g in range(sight.groups)])
    return float(np.median(np.linalg.norm(sight.x - middle[sight.group], axis=1)))


def _compute_losses(sight: Sight, tried: list[Placed]) -> Array:
    """Compute (k,) sums of squares, cut off at a common length, with the prior of the targets."""
    size = np.array([compute_misfits(sight, at) for at in tried])
    scale = float(compute_trimmed_median(size, sight.unknowns).min())
    offsets = [np.square((at.tools - sight.usual) / sight.prior_sigma).sum() for at in tried]
    prior = np.array(offsets) * (scale / MEDIAN_3) ** 2
    return np.asarray(np.minimum(np.square(size), (GROSS * scale) ** 2).sum(1) + prior)


def _find_least(sight: Sight, tried: list[Placed]) -> int:
    return int(_compute_losses(sight, tried).argmin())


def _agree(sight: Sight, tried: list[Placed], good_mm: float) -> bool:
    """Return whether two starts have ended in the best minimum, and it explains the points."""
    loss = _compute_losses(sight, tried)
    best = int(loss.argmin())
    in_best = int((loss <= loss[best] * (1 + SAME_MINIMUM)).sum())
    return in_best > 1 and float(np.median(compute_misfits(sight, tried[best]))) < good_mm


def _describe_shape(sight: Sight, at: Placed, g: int) -> str:
    """Describe what keeps a placement from being determined: the extents of its points."""
    in_group = sight.group == g
    x = sight.x[in_group]
    extent = np.linalg.svd(x - np.median(x, axis=0), compute_uv=False) / np.sqrt(len(x))
    left = float(np.median(compute_misfits(sight, at)[in_group]))
    if extent[1] < THIN * extent[0]:
        shape = f"the points lie along a line, {extent[1]:.2g} mm off it"
    else:
        shape = f"the points lie within {extent[0]:.2g} mm of their middle"
    return f"{shape}, where {left:.2g} mm remain unexplained (rms, median)"


def _note_weak_turn(sight: Sight, at: Placed, g: int, turn: float, name: str) -> Note:
    return Note(
        "registration-weak",
        f"The orientation of the tracker is known to {np.degrees(turn):.2g} degrees only (one "
        f"standard deviation, {name}): {_describe_shape(sight, at, g)}. {SPREAD_ADVICE}.",
    )


def _note_weak_targets(names: list[str]) -> Note:
    return Note(
        "target-weak",
        f"The rows do not determine in every direction where target {sentence_list(names)} sits on "
        "the flange, so it is taken to be near it: give tool_mm, or measure it with the flange "
        "turned in other ways.",
    )


def _require_known_turns(
    part: _Part, at: Placed, good: Mask, problem: Problem, per_group: bool
) -> None:
    """Raise NotEstimable where the rows leave a placement's turn open."""
    turn = compute_uncertainty(part.sight, at, good)[0]
    g = int(turn.argmax())
    if turn[g] <= MAX_TURN:
        return
    name = _name_group(problem, int(part.groups[g]), per_group)
    degrees = f"to {np.degrees(turn[g]):.0f} degrees only (one standard deviation)"
    verb = "s" if per_group else ""
    known = "not at all" if turn[g] > np.pi else degrees
    raise NotEstimable(
        f"registration: {name} determine{verb} the orientation of the tracker {known}: "
        f"{_describe_shape(part.sight, at, g)}. {SPREAD_ADVICE}, give tool_mm, or convert the "
        "positions to the robot's base and leave register out."
    )
