"""The place of every row in the campaign that it was measured in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..._typing import Array
from ...notices import Note
from ..formats.row_places import Where
from .clock_history import number_clocks

Index = NDArray[np.intp]
# rad, mm: by how much an arm that stands still may be read anew: encoders' noise, servos' hold
STANDSTILL_RAD = 1e-3
STANDSTILL_MM = 0.1


def compute_progress(group: Index, order: Array, time: Array | None = None) -> Array:
    """Compute the place (m,) of every row in the campaign, 0 to 1: groups by the clock where one clock runs
    through all of them, else in the order of their first rows; each in order of motion."""
    count = len(group)
    rows = np.arange(count)
    session = _after_one_another(group, time)
    keys = (rows, order, session)
    sequence = np.lexsort(keys)
    rank = np.empty(count)
    rank[sequence] = rows
    last_rank = max(count - 1, 1)
    return rank / last_rank


def _after_one_another(group: Index, time: Array | None) -> Index:
    """Number the groups as one followed another: by the clock where their times do not overlap,
    else as they are."""
    if time is None or not len(group):
        return group
    clocks = number_clocks(group, time)
    if clocks.any():
        return group
    groups = group.max() + 1
    first = np.full(groups, np.inf)
    np.minimum.at(first, group, time)
    by_clock = np.argsort(first, kind="stable")
    # place of each group by the clock
    place: Index = np.argsort(by_clock)
    return place[group]


def choose_standstill(prismatic: Sequence[bool]) -> Array:
    """Choose (n,) by how much the reading of each joint may differ while the arm stands still."""
    return np.where(prismatic, STANDSTILL_MM, STANDSTILL_RAD)


def check_clock(order: Array, time: Array | None, group: Index, rows: Index, where: Where) -> None:
    """Check that in no group `time_s` (m,) goes back while `order` (m,) goes on.

    `rows` (m,): the table's rows, of which `where` says the places. Raises DataError."""
    if time is None:
        return
    sequence = np.lexsort((time, order, group))
    later, earlier = sequence[1:], sequence[:-1]
    goes_back = (time[later] < time[earlier]) & (group[later] == group[earlier])
    if not goes_back.any():
        return
    number = int(np.argmax(goes_back))
    row, before = int(later[number]), int(earlier[number])
    count = int(goes_back.sum())
    more = f" (and {count - 1} more)" if count > 1 else ""
    raise where.refuse(
        f"order goes on from {order[before]:g} ({where.name_row(int(rows[before]))}) to "
        f"{order[row]:g}, but time_s goes back from {time[before]:g} to {time[row]:g}{more}; "
        "within a group both are expected to grow.",
        row=int(rows[row]),
        column="time_s",
        remedy="Correct the column that is wrong or leave it out; where the clock was started anew, "
        "give every session a name of its own in a column group.",
    )


def note_equal_orders(
    order: Array, q: Array, group: Index, rows: Index, where: Where, standstill: Array
) -> list[Note]:
    """Note rows of a group that have the same `order` (m,), but other joint readings.

    q (m, n): readings, which differ by more than `standstill` (n,) where the arm has moved; `rows`
    (m,): the table's rows, of which `where` says the places."""
    sequence = np.lexsort((order, group))
    later, earlier = sequence[1:], sequence[:-1]
    is_alike = (order[later] == order[earlier]) & (group[later] == group[earlier])
    has_moved = (np.abs(q[later] - q[earlier]) > standstill).any(1)
    tied = np.flatnonzero(is_alike & has_moved)
    if not len(tied):
        return []
    row, before = int(later[tied[0]]), int(earlier[tied[0]])
    first, second = (where.name_row(int(rows[k])) for k in (before, row))
    more = f" (and {len(tied) - 1} more)" if len(tied) > 1 else ""
    sentence = (
        f"order is {order[row]:g} on {first} and on {second}, whose joint readings differ{more}: rows with the same "
        "order are taken in the order of the file. Where order was started anew, give every session "
        "a name of its own in a column group."
    )
    return [Note("orders-equal", sentence)]
