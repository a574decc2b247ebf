"""Registration: where the tracker stands and where the targets sit, without a start value.

Several starts (`starting_values`) are minimised on the exact model (`adjustment`), and the one with
the least robust misfit is taken (`placement_search`). A linear solve for a free affine map from the tracker to frame 0
fails where the points lie on a line or a plane, and where the target may sit at a point that no
joint moves, as on a two-axis positioner; rigid fits and measured orientations are tried too. Groups
that share no target are placed apart. What the rows leave open is refused, or reported by
`note_undetermined`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .._typing import Array, Index, Mask
from ..exceptions import DataError, NotEstimable, count_words, sentence_list, write_rounded
from ..fitting.problem import Problem
from ..notices import Note
from .adjustment import GROSS
from .independent_parts import Part, build_sight, name_group, number_groups, split_independent
from .placement import Placed, Sight, compute_misfits, compute_trimmed_median
from .placement_search import Found, find_placements
from .placement_uncertainty import compute_uncertainty
from .starting_values import THIN

# configurations per placement
MIN_CONFIGURATIONS = 4
# standard deviation of a placement's turn [rad] at which registration is refused, and from which it
# is reported, and of a target's place [mm] from which it is reported
MAX_TURN = 1.0
REPORTED_TURN = 0.035
REPORTED_MM = 100.0

SPREAD_ADVICE = "Measure points that spread in all directions of the room"


def register(problem: Problem, use: Mask, per_group: bool) -> Problem:
    """Find placement(s) and tools from the rows `use` (mask) of a problem.

    Raises NotEstimable with too few rows, or where these do not determine how the tracker stands."""
    task = _prepare(problem, use, per_group)
    parts = task.parts
    sights = [part.sight for part in parts]
    found = find_placements(sights)
    return task.place(found)


def register_each(problems: Sequence[Problem]) -> list[Problem | None]:
    """Find one placement, and tools, of each of several problems from all of its rows; None of those
    that `register` refuses."""
    tasks = [_try_to_prepare(problem) for problem in problems]
    sights = []
    for task in tasks:
        if task is not None:
            sights += [part.sight for part in task.parts]
    found = iter(find_placements(sights))
    registered = []
    for task in tasks:
        placed = None
        if task is not None:
            own = [next(found) for _ in task.parts]
            placed = _try_to_place(task, own)
        registered.append(placed)
    return registered


def _try_to_prepare(problem: Problem) -> _Task | None:
    every_row = np.ones(len(problem), bool)
    try:
        return _prepare(problem, every_row, per_group=False)
    except (DataError, NotEstimable):
        return None


def _try_to_place(task: _Task, found: Sequence[Found]) -> Problem | None:
    try:
        return task.place(found)
    except NotEstimable:
        return None


@dataclass(frozen=True, eq=False)
class _Task:
    """A problem to register, its rows that tell the placements, and the parts of these that no row
    joins."""

    problem: Problem
    selected: Problem
    parts: tuple[Part, ...]
    count: int
    per_group: bool

    def place(self, found: Sequence[Found]) -> Problem:
        """Return the problem with what was found of every part. Raises NotEstimable where that is not
        certain."""
        problem = self.problem
        count = self.count
        R = np.tile(np.eye(3), (count, 1, 1))
        t = np.zeros((count, 3))
        tools = problem.tools.copy()
        turned = None
        if problem.tool_rotations is not None:
            turned = problem.tool_rotations.copy()
        for part, (at, good) in zip(self.parts, found, strict=True):
            _require_known_turns(part, at, good, self.selected, self.per_group)
            R[part.groups] = at.R
            t[part.groups] = at.t
            tools[part.targets] = at.tools
            if turned is not None:
                turned[part.targets] = at.turned
        groups = len(problem.data.groups)
        placed = np.arange(count) if self.per_group else np.zeros(groups, np.intp)
        return replace(
            problem, placement=(R[placed], t[placed]), tools=tools, tool_rotations=turned
        )


def _prepare(problem: Problem, use: Mask, per_group: bool) -> _Task:
    """Prepare a registration. Raises NotEstimable with too few rows."""
    selected = _select_points(problem, use)
    group, count = number_groups(selected, per_group)
    _require_configurations(selected, group, count, per_group)
    sight = build_sight(selected, group, count)
    parts = tuple(split_independent(sight))
    return _Task(problem, selected, parts, count, per_group)


def _select_points(problem: Problem, use: Mask) -> Problem:
    """Select the rows `use` (mask) that are points. Raises NotEstimable where too few are."""
    gauges = problem.data.gauges
    if gauges is None:
        return problem.take(use)
    selected = problem.take(use & gauges.of("point"))
    count = selected.data.configurations
    if count < MIN_CONFIGURATIONS:
        verb = "has" if count == 1 else "have"
        raise NotEstimable(
            f"{count_words(count, 'estimation configuration')} {verb} a measured point; registration needs "
            f"{MIN_CONFIGURATIONS}. Measure more points, or leave register out: the other rows are "
            "evaluated in the robot's own frame."
        )
    return replace(selected, data=replace(selected.data, gauges=None))


def _require_configurations(problem: Problem, group: Index, count: int, per_group: bool) -> None:
    for g in range(count):
        configurations = len(np.unique(problem.data.configuration[group == g]))
        if configurations < MIN_CONFIGURATIONS:
            counted = count_words(configurations, "estimation configuration")
            verb = "has" if per_group else "have"
            raise NotEstimable(
                f"{name_group(problem, g, per_group)} {verb} {counted}; registration needs "
                f"{MIN_CONFIGURATIONS} per placement. Measure more, or choose another [split]."
            )


def note_undetermined(
    problem: Problem, use: Mask, per_group: bool, usual: Array
) -> tuple[Note, ...]:
    """Note what the rows `use` (mask) of a registered problem determine poorly: a placement's turn,
    a target's place; `usual` (T, 3): where the targets were expected."""
    gauges = problem.data.gauges
    if gauges is not None:
        points = gauges.of("point")
        use = use & points
    selected = problem.take(use)
    group, count = number_groups(selected, per_group)
    sight = build_sight(selected, group, count)
    expected = replace(sight, usual=usual)
    notes: list[Note] = []
    for part in split_independent(expected):
        at = _read_placement(selected, part, group)
        weak = _note_weak_part(part, at, selected, per_group)
        notes += weak
    return tuple(notes)


def _note_weak_part(part: Part, at: Placed, problem: Problem, per_group: bool) -> Iterator[Note]:
    """Note which placements and targets of a part its rows determine poorly."""
    sight = part.sight
    misfits = compute_misfits(sight, at)
    median = compute_trimmed_median(misfits, sight.unknowns)
    good = misfits <= GROSS * median
    turn, place = compute_uncertainty(sight, at, good)
    for k in np.flatnonzero(turn > REPORTED_TURN):
        g = int(part.groups[k])
        yield _note_weak_turn(
            sight, at, int(k), float(turn[k]), name=name_group(problem, g, per_group)
        )
    weak = part.targets[place > REPORTED_MM]
    if len(weak):
        every = problem.data.targets
        names = [every[k] for k in weak]
        yield _note_weak_targets(names, len(every) == 1)


def _read_placement(problem: Problem, part: Part, group: Index) -> Placed:
    """Read the placement of a part from a registered problem."""
    rows = []
    for g in part.groups:
        of_group = np.flatnonzero(group == g)
        rows.append(of_group[0])
    first = np.array(rows)
    placed = problem.data.group[first]
    targets = part.targets
    rotations = problem.tool_rotations
    turned = None
    if rotations is not None:
        turned = rotations[targets]
    R, t = problem.placement
    return Placed(R[placed], t[placed], problem.tools[targets], turned)


def _describe_shape(sight: Sight, at: Placed, g: int) -> str:
    """Describe what keeps a placement from being determined: the extents of its points."""
    in_group = sight.group == g
    x = sight.x[in_group]
    middle = np.median(x, axis=0)
    singular = np.linalg.svd(x - middle, compute_uv=False)
    extent = singular / np.sqrt(len(x))
    longest, across = extent[0], extent[1]
    misfits = compute_misfits(sight, at)
    left = float(np.median(misfits[in_group]))
    if across < THIN * longest:
        shape = f"the points lie along a line, {write_rounded(across, 2)} mm off it"
    else:
        shape = f"the points lie within {write_rounded(longest, 2)} mm of their middle"
    return f"{shape}, where {write_rounded(left, 2)} mm remain unexplained (median)"


def _note_weak_turn(sight: Sight, at: Placed, g: int, turn: float, name: str) -> Note:
    return Note(
        "registration-weak",
        f"The orientation of the instrument is known to {np.degrees(turn):.2g} degrees only (one "
        f"standard deviation, {name}): {_describe_shape(sight, at, g)}. {SPREAD_ADVICE}.",
    )


def _note_weak_targets(names: list[str], is_only: bool) -> Note:
    which = "the target sits"
    if not is_only:
        which = f"target {sentence_list(names)} sits"
    return Note(
        "target-weak",
        f"The rows do not determine in every direction where {which} on the flange, so it is taken to be near it: give tool_mm, or measure it with the flange "
        "turned in other ways.",
    )


def _require_known_turns(
    part: Part, at: Placed, good: Mask, problem: Problem, per_group: bool
) -> None:
    """Raise NotEstimable where the rows leave a placement's turn open."""
    turn, _ = compute_uncertainty(part.sight, at, good)
    k = int(turn.argmax())
    least_certain = turn[k]
    if least_certain <= MAX_TURN:
        return
    g = int(part.groups[k])
    name = name_group(problem, g, per_group)
    degrees = np.degrees(least_certain)
    known = f"to {degrees:.0f} degrees only (one standard deviation)"
    if least_certain > np.pi:
        known = "not at all"
    verb = "determines" if per_group else "determine"
    raise NotEstimable(
        f"registration: {name} {verb} the orientation of the instrument {known}: "
        f"{_describe_shape(part.sight, at, k)}. {SPREAD_ADVICE}, give tool_mm, or convert the "
        "positions to the robot's base and leave register out."
    )
