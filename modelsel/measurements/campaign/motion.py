"""The arm's motion through a campaign, past the places where nothing was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..._typing import Array, Index
from ...notices import Note
from ...robot.coupling import Coupling, readings_of
from .joint_path import JointPath
from .resting_joints import describe_resting_joints
from .visits import derive_path, describe_last_motion, number_keys, number_visits

# codes of notes
APPROACH_FROM_ORDER, APPROACH_AGAINST_ORDER = "approach-from-order", "approach-against-order"
# directions from which it is told that so large a share of them is not that of the order
MIN_DIRECTIONS, MAX_OTHER_SHARE = 20, 0.25


@dataclass(frozen=True, eq=False)
class Waypoints:
    """Places that the arm went to and where nothing was measured: `q` (k, n) joint angles, rad or
    mm; `row` (k,) in the file; group and configuration by name and `order` (k,), None where the
    file has no such column."""

    q: Array
    row: Index
    group: Sequence[object] | None = None
    configuration: Sequence[object] | None = None
    order: Array | None = None


@dataclass(frozen=True, eq=False)
class MeasuredRows:
    """Measured rows as motion sees them: `q` (m, n) joint angles, `row` (m,) in the file, labels by
    name and `order` (m,), None where the file has no such column."""

    q: Array
    row: Index
    group: Sequence[object] | None
    configuration: Sequence[object] | None
    order: Array | None


@dataclass(frozen=True, eq=False)
class Motion:
    """Of every measured row: `visit` (m,) its visit's number; `approach` and `move` (m, n), sign and
    size of each motor's last motion; `order` (m,) in the group. `flicker` (n,): the largest change
    of each reading that is no motion. `path`, with the place (m,) of each row's visit `on_path`."""

    visit: Index
    approach: Array
    move: Array
    order: Array
    flicker: Array
    path: JointPath
    on_path: Index

    def find_path(self, given: Array | None) -> JointPath | None:
        """Return the path; None where directions of approach are given (m, n) that are not those of the
        order of motion: the arm may have gone past its goals on purpose."""
        if given is None:
            return self.path
        own = self.approach
        is_given = given != 0
        is_derived = own != 0
        is_known = is_given & is_derived
        is_same = given == own
        agrees = is_same[is_known]
        follows = agrees.size and agrees.all()
        return self.path if follows else None


def trace_motion(
    rows: MeasuredRows,
    waypoints: Waypoints | None,
    coupling: Coupling | None,
    prismatic: Sequence[bool],
) -> Motion:
    """Trace the motion through measured rows and the waypoints between them."""
    measured = len(rows.q)
    place = np.arange(measured)
    order = np.arange(measured, dtype=float) if rows.order is None else rows.order
    if waypoints is not None and len(waypoints.q):
        passed = waypoints
        at = np.concatenate([rows.row, passed.row])
        place = np.argsort(at, kind="stable")
        own = at.astype(float)
        if rows.order is not None and passed.order is not None:
            own = np.concatenate([rows.order, passed.order])
        order = own[:measured]
        rows = MeasuredRows(
            np.concatenate([rows.q, passed.q])[place],
            at[place],
            _join(rows.group, passed.group, place),
            _join(rows.configuration, passed.configuration, place),
            own[place],
        )
    group = np.zeros(len(place), np.intp) if rows.group is None else number_keys(rows.group)[0]
    visit = number_visits(rows.q, rows.configuration, group)
    readings = readings_of(coupling, rows.q)
    along = order if rows.order is None else rows.order
    path, on_path, flicker = derive_path(readings, visit, group, along, prismatic)
    back = np.argsort(place, kind="stable")[:measured]
    places = on_path[back]
    approach, move = describe_last_motion(path, places)
    return Motion(visit[back], approach, move, np.asarray(order, float), flicker, path, places)


def _join(
    first: Sequence[object] | None, second: Sequence[object] | None, place: Index
) -> Sequence[object] | None:
    """Join the labels of rows and waypoints in the order of the file."""
    if first is None or second is None:
        return None
    labels = [*first, *second]
    joined = []
    for k in place:
        label = labels[k]
        joined.append(label)
    return joined


def describe_motion(
    motion: Motion, prismatic: Sequence[bool], given: Array | None
) -> tuple[Note, ...]:
    """Say what was taken from the order of motion, and where directions that are `given` (m, n) are
    not those of this order."""
    notes = []
    flicker = motion.flicker
    resting = describe_resting_joints(flicker, prismatic)
    if resting is not None:
        notes.append(Note("joint-rests", resting))
    contradiction = "" if given is None else _describe_contradiction(motion.approach, given)
    if contradiction:
        notes.append(Note(APPROACH_AGAINST_ORDER, contradiction))
    if given is None:
        notes.append(
            Note(
                APPROACH_FROM_ORDER,
                "The data have no approach columns: directions of approach were taken from the "
                "order of motion when the file was read.",
            )
        )
    return tuple(notes)


def _describe_contradiction(derived: Array, given: Array) -> str:
    """Say that directions of approach are not those of the order of motion; nothing where they
    mostly are, and where each joint always comes from one side, as an arm does that is sent past
    its goal on purpose."""
    varies = (given > 0).any(0) & (given < 0).any(0)
    is_known = (given != 0) & (derived != 0) & varies
    known = int(is_known.sum())
    if known < MIN_DIRECTIONS:
        return ""
    is_other = is_known & (given != derived)
    share = is_other.sum() / known
    if share < MAX_OTHER_SHARE:
        return ""
    return (
        f"The approach columns are not what the order of the rows makes of them in {100 * share:.0f} % of "
        "the motions. They are taken as they are, which is right if the arm came into each row that "
        "way on purpose. If it went straight from row to row, leave them out."
    )
