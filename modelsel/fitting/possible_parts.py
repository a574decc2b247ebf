"""The parts that the errors of a campaign may have, as far as its rows can identify them.

Each joint may not repeat, one draw a visit, shared by all targets; the instrument may err more in one
direction than in others, at one target or in one group; the rows of one visit, of one posture or of
one group may share an error; and an error may last along the order of motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .._linalg import TINY
from .._part_names import (
    ACROSS_LINE,
    ALONG_AXES,
    ALONG_LINE,
    AT_TARGET,
    IN_GROUP,
    INSTRUMENT_PARTS,
    is_named,
)
from .._typing import Array, Index, Mask
from ..measurements.measurements import Measurements
from ..mechanisms.causes import ONE
from ..mechanisms.terms import Screw, Term
from .design import assemble
from .error_sizes import Comparison
from .problem import Problem
from .shared_errors import MAX_BLOCK, SharedError

# what identifies a part: its scale is given, not estimated
GIVEN = "given"
# the directions of single rows' errors: those in which a joint moves one target, where no posture was
# measured again, and those in which the instrument errs most
DIRECTIONS = "directions"
# the sizes of single rows' errors, which are larger at one target or in one group than at others
SIZES = "sizes"
# what an effect that is not named yet may tell as well
UNSURE = (DIRECTIONS, SIZES)
# the differences between visits of one posture
BY_REPEATS = "repeats"
# the targets of one visit
BY_TARGETS = "targets"
# the order of motion, for an error that lasts
ORDER = "order"
# draws that a part needs, rows beyond the first of their configuration, and groups
MIN_LEVELS = 20
MIN_EXCESS = 10
MIN_GROUPS = 5
# rows of a target, or configurations of a group, that are compared with as many others at least, and
# targets or groups that are compared at most
MIN_COMPARED = 10
MAX_COMPARED = 12
# rows from which they are not compared: each of them keeps what moves every row
MAX_COMPARED_ROWS = 100_000
# correlation lengths of a lasting error, in visits, and how many of them count as one test each
LENGTHS = (0.7, 1.4, 3.0, 6.0, 12.0, 25.0, 50.0)
LASTING_TESTS = 3
# correlation lengths, and at least so many rows, after which a lasting error starts afresh
STRETCH = 8
FEWEST_ROWS = 16
# share of the largest loading below which a joint does not move the target
MIN_LOADING = 1e-3


@dataclass(frozen=True, eq=False)
class PossiblePart:
    """A part that the errors may have.

    name: "joint 2", "instrument z", "instrument target B", "configuration", "group" or "lasting";
    unit: that of its scale;
    square: mean square [mm²] over the rows of the target's displacement by one unit; told_by: what
    distinguishes it from others; tests: how many tests it counts for; even: noise alike in all rows,
    none of which share it, that must not tell the data as well; compared: the rows whose sizes tell it,
    and with which; repeating: the same with one draw a posture, which repeats must not show instead."""

    name: str
    unit: str
    error: SharedError
    square: float
    told_by: str
    tests: int = 1
    even: SharedError | None = None
    compared: Comparison | None = None
    repeating: SharedError | None = None

    @property
    def by_rows(self) -> bool:
        """Whether it is a joint that several rows of a visit or of a posture tell."""
        is_joint = self.name.startswith("joint ")
        return is_joint and self.told_by in (BY_TARGETS, BY_REPEATS)

    def take(self, rows: Index) -> PossiblePart:
        """Return the part of some rows."""
        even = None if self.even is None else self.even.take(rows)
        compared = None if self.compared is None else self.compared.take(rows)
        again = None if self.repeating is None else self.repeating.take(rows)
        error = self.error.take(rows)
        return replace(self, error=error, even=even, compared=compared, repeating=again)


def list_parts(problem: Problem, training: Mask) -> tuple[PossiblePart, ...]:
    """List the parts that the rows of a training mask (m,) can identify; their errors cover all rows.

    Distances, planes and wires identify none."""
    if not problem.only_points:
        return ()
    problem = problem.as_stated()
    data = problem.data.take(training)
    if data.configurations < MIN_LEVELS:
        return ()
    loading = _load_positions(problem)
    listed = (
        *_list_joints(problem, data),
        *_list_instrument(problem, loading),
        *_list_louder(problem.data, data, loading),
        *_list_shared(problem, data, loading),
        *_list_lasting(problem, data, training, loading),
    )
    if problem.whitening.uniform:
        return listed
    return _set_against_even_noise(listed, loading)


def _set_against_even_noise(
    listed: Sequence[PossiblePart], loading: Array
) -> tuple[PossiblePart, ...]:
    """Set parts against noise that is alike in all rows, where stated uncertainties are not: where
    these are not quite right, such noise gains much, and any part that resembles it.

    The joints that repeats or targets tell move every row otherwise, and stay as they are."""
    typical = float(np.square(loading).sum(axis=1).mean())
    own_level = np.arange(len(loading))
    even = SharedError(loading, own_level, variance=1 / max(typical, TINY))
    against = []
    for one in listed:
        is_alike = one.unit == "mm" and one.error.loading.shape[2] == 3
        rival = even if is_alike or one.told_by == DIRECTIONS else None
        against.append(replace(one, even=rival))
    return tuple(against)


def choose_parts(
    listed: Sequence[PossiblePart],
    allowed: Sequence[str] | None,
    fixed: Sequence[tuple[str, float]] = (),
) -> tuple[PossiblePart, ...]:
    """Choose the parts that may be looked for: the `allowed` names ("joints": all of them; None:
    every part). Those with a `fixed` scale are known, and stand first."""
    taken, known = [], []
    for name, scale in fixed:
        found = next((one for one in listed if one.name == name), None)
        if found is not None:
            error = replace(found.error, known=scale**2)
            known.append(replace(found, error=error, told_by=GIVEN))
            taken.append(found)
    sought = [one for one in listed if one not in taken]
    if allowed is not None:
        sought = [one for one in sought if is_named(one.name, allowed)]
    return (*known, *sought)


def _list_joints(problem: Problem, seen: Measurements) -> list[PossiblePart]:
    """List the joints that move the target; `seen`: the training rows."""
    prismatic = problem.robot.prismatic
    terms = [
        Term(f"joint {j}", (Screw(j, "tz" if slides else "rz", ONE),))
        for j, slides in enumerate(prismatic, 1)
    ]
    plain = problem.unweighted()
    moved = np.concatenate([assemble(p, terms, None)[:-1] for _, p in plain.parts()], axis=2)
    whitened = problem.whitening.apply_by_row(moved.copy())
    size = np.sqrt(np.square(whitened).sum(1).mean(1))
    told_by = DIRECTIONS
    if count_excess(seen.configuration, np.arange(len(seen))) >= MIN_EXCESS:
        told_by = BY_TARGETS
    if count_excess(seen.block, seen.configuration) >= MIN_EXCESS:
        told_by = BY_REPEATS
    moves = np.flatnonzero(size > MIN_LOADING * size.max(initial=TINY)).tolist()
    # each is as likely by chance as a direction of the instrument: they are one test together
    tests = len(moves) if told_by == DIRECTIONS else 1
    found = []
    for j in moves:
        loading = whitened[j].T[:, :, None]
        square = float(np.square(moved[j, :3]).sum(0).mean())
        error = SharedError(np.ascontiguousarray(loading), problem.data.configuration)
        unit = "mm" if prismatic[j] else "rad"
        own = PossiblePart(f"joint {j + 1}", unit, error, square, told_by, tests)
        if told_by == BY_REPEATS:
            own = replace(own, repeating=replace(error, level=problem.data.block))
        found.append(own)
    return found


def count_excess(coarse: Index, fine: Index) -> int:
    """Count the distinct `fine` numbers beyond one for each `coarse` number."""
    pairs = np.unique(np.stack([coarse, fine], axis=1), axis=0)
    return len(pairs) - len(np.unique(pairs[:, 0]))


def _load_positions(problem: Problem) -> Array:
    """Compute the whitened observations (m, c, 3) per mm of the target's displacement, row by row."""
    c, m = problem.components, len(problem)
    identity = np.zeros((3, c, m))
    for axis in range(3):
        identity[axis, axis] = 1.0
    whitened = problem.whitening.apply_by_row(identity)
    return np.ascontiguousarray(whitened.transpose(2, 1, 0))


def _list_instrument(problem: Problem, loading: Array) -> list[PossiblePart]:
    """List the directions in which the instrument may err more than in others, one test together."""
    found = [
        _build_own(name, "mm", loading[:, :, axis : axis + 1], 1.0)
        for axis, name in enumerate(ALONG_AXES)
    ]
    line = problem.data.position - np.array(problem.tracker)
    distance = np.linalg.norm(line, axis=1)
    if not distance.all() or not problem.stands_apart:
        return found
    u = line / distance[:, None]
    along = np.matmul(loading, u[:, :, None])
    across = np.matmul(loading, _span_across(u) * distance[:, None, None])
    typical = float(np.square(distance).mean())
    found.append(_build_own(ALONG_LINE, "mm", along, 1.0))
    found.append(_build_own(ACROSS_LINE, "rad", across, 2 * typical))
    return found


def _build_own(name: str, unit: str, loading: Array, square: float) -> PossiblePart:
    """Build a part of the instrument, a draw of its own for every row."""
    own_level = np.arange(len(loading))
    by_row = np.ascontiguousarray(loading)
    error = SharedError(by_row, own_level)
    tests = len(INSTRUMENT_PARTS)
    return PossiblePart(name, unit, error, square, DIRECTIONS, tests)


def _list_louder(data: Measurements, seen: Measurements, loading: Array) -> list[PossiblePart]:
    """List the targets and the groups at which the instrument may err more than at others; those of
    a kind are one test together. None where rows are very many."""
    if len(data) >= MAX_COMPARED_ROWS:
        return []
    _, visits = np.unique(seen.configuration, return_index=True)
    targets = _choose_compared(seen.target)
    groups = _choose_compared(seen.group[visits])
    every_row = np.arange(len(data))
    found = []
    for number in targets:
        name = AT_TARGET + data.targets[number]
        compared = Comparison(data.target == number, every_row, data.configuration)
        found.append(_build_louder(name, loading, compared, len(targets)))
    for number in groups:
        name = IN_GROUP + data.groups[number]
        compared = Comparison(data.group == number, data.configuration, data.block)
        found.append(_build_louder(name, loading, compared, len(groups)))
    return found


def _choose_compared(seen: Index) -> list[int]:
    """Choose the numbers among those `seen` of which there are enough, and enough others; none where
    they are many."""
    rows = len(seen)
    numbers, count = np.unique(seen, return_counts=True)
    if len(numbers) > MAX_COMPARED:
        return []
    others = rows - count
    fewer = np.minimum(count, others)
    is_compared = fewer >= MIN_COMPARED
    chosen: list[int] = numbers[is_compared].tolist()
    return chosen


def _build_louder(name: str, loading: Array, compared: Comparison, tests: int) -> PossiblePart:
    """Build more noise in the rows that are compared, a draw of its own for each."""
    own_level = np.arange(len(loading))
    is_louder = compared.is_larger
    by_row = loading * is_louder[:, None, None]
    error = SharedError(by_row, own_level)
    square = 3 * float(is_louder.mean())
    return PossiblePart(name, "mm", error, square, SIZES, tests, compared=compared)


def _span_across(u: Array) -> Array:
    """Return two unit vectors (m, 3, 2) across unit vectors (m, 3), and across one another."""
    size = np.abs(u)
    least = size.argmin(axis=1)
    axes = np.eye(3)
    apart = axes[least]
    first = np.cross(u, apart)
    length = np.linalg.norm(first, axis=1, keepdims=True)
    first /= length
    second = np.cross(u, first)
    return np.stack([first, second], axis=2)


def _list_shared(problem: Problem, seen: Measurements, loading: Array) -> list[PossiblePart]:
    """List what rows of one visit, of one posture or of one group may share."""
    data = problem.data
    found = []
    if count_excess(seen.configuration, np.arange(len(seen))) >= MIN_EXCESS:
        error = SharedError(loading, data.configuration)
        found.append(PossiblePart("configuration", "mm", error, 3.0, BY_TARGETS))
    if count_excess(seen.block, seen.configuration) >= MIN_EXCESS:
        error = SharedError(loading, data.block)
        found.append(PossiblePart("configuration", "mm", error, 3.0, BY_REPEATS))
    count = np.bincount(seen.group)
    groups = int((count > 0).sum())
    if groups >= MIN_GROUPS and count.max() <= MAX_BLOCK and len(seen) >= 2 * groups:
        found.append(PossiblePart("group", "mm", SharedError(loading, data.group), 3.0, "groups"))
    return found


def _list_lasting(
    problem: Problem, seen: Measurements, training: Mask, loading: Array
) -> list[PossiblePart]:
    """List what may last along the order of motion; rows that are not `seen` are cut apart."""
    data = problem.data
    visits = seen.configurations
    time = _time_visits(data, seen)
    found = []
    for length in LENGTHS:
        if length <= visits / 2:
            stretch = np.empty(len(data), np.intp)
            count = 0
            for rows in (np.flatnonzero(training), np.flatnonzero(~training)):
                order = rows[np.argsort(data.progress[rows], kind="stable")]
                stretch[order] = count + _cut(len(order), length * len(seen) / visits)
                count = int(stretch[order].max(initial=-1)) + 1
            error = SharedError(loading, stretch, time=time, length=length)
            found.append(PossiblePart("lasting", "mm", error, 3.0, ORDER, LASTING_TESTS))
    return found


def _time_visits(data: Measurements, seen: Measurements) -> Array:
    """Return the place (m,) of every row's visit in the campaign, in visits."""
    first = np.full(int(data.configuration.max()) + 1, np.inf)
    np.minimum.at(first, data.configuration, data.progress)
    begun = np.unique(first[seen.configuration])
    step = float(np.diff(begun).min(initial=1.0))
    return np.asarray(first[data.configuration] / step)


def _cut(rows: int, length: float) -> Index:
    """Cut rows in their order into stretches (rows,) of equal size, some correlation lengths each."""
    size = int(min(max(STRETCH * length, FEWEST_ROWS), MAX_BLOCK))
    return np.arange(rows) * -(-rows // size) // max(rows, 1)
