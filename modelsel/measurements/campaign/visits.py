"""Configurations, blocks and motion: which rows are one visit of the arm, which visits have the same
readings, and how the arm moved from one to the next."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..._linalg import connected_components
from ..._typing import Array, Index
from .joint_path import JointPath
from .near_readings import MAX_LAG, find_near_pairs, find_returns
from .resting_joints import find_resting_steps

# rad or mm: two readings closer than this are the same configuration
SAME_READING = 1e-6


def number_keys(keys: Sequence[object] | NDArray[np.generic]) -> tuple[Index, tuple[str, ...]]:
    """Number keys by their first appearance: (each key's number, the distinct keys in that
    order)."""
    numbers: dict[str, int] = {}
    index = []
    for key in keys:
        word = str(key)
        number = numbers.setdefault(word, len(numbers))
        index.append(number)
    key_numbers = np.array(index, dtype=np.intp)
    distinct = tuple(numbers)
    return key_numbers, distinct


def number_visits(q: Array, explicit: Sequence[object] | None, group: Index) -> Index:
    """Number the configuration of every row: by the given column, else adjacent rows with equal
    readings in one group."""
    if explicit is not None:
        numbers, _ = number_keys(explicit)
        return numbers
    is_new = np.ones(len(q), bool)
    is_new[1:] = np.diff(group) != 0
    for readings in q.T:
        step = np.diff(readings)
        is_new[1:] |= np.abs(step) > SAME_READING
    visit = np.cumsum(is_new) - 1
    return np.asarray(visit, dtype=np.intp)


def count_distinct(numbers: Index) -> int:
    """Count the distinct values among numbers (m,) from zero up, such as blocks and groups."""
    return int(np.count_nonzero(np.bincount(numbers)))


def number_blocks(
    q: Array, configuration: Index, prismatic: Sequence[bool] = (), max_lag: int = MAX_LAG
) -> Index:
    """Number blocks of rows whose readings agree to 1e-6 or are of one posture, or that share a
    configuration; `max_lag`: see `find_near_pairs`."""
    equal = number_equal(q, configuration, max_lag)
    _, first = np.unique(equal, return_index=True)
    returns = find_returns(q[first], prismatic)
    joined = connected_components(len(first), returns)
    return joined[equal]


def number_equal(q: Array, configuration: Index, max_lag: int = MAX_LAG) -> Index:
    """Number rows whose readings agree to 1e-6, or that share a configuration; `max_lag`: see
    `find_near_pairs`."""
    _, first, visit = np.unique(configuration, return_index=True, return_inverse=True)
    pairs = find_near_pairs(q[first], SAME_READING, max_lag)
    blocks = connected_components(len(first), pairs)
    return blocks[visit.reshape(-1)]


def derive_path(
    q: Array, configuration: Index, group: Index, order: Array, prismatic: Sequence[bool]
) -> tuple[JointPath, Index, Array]:
    """Derive the path through all visits, the place (m,) of each row's visit on it, and the largest
    flicker of each joint's reading (n,) that is no motion."""
    visits = _order_visits(configuration, group, order)
    visit_group = group[visits]
    opens_group = np.ones(len(visits), bool)
    opens_group[1:] = np.diff(visit_group) != 0
    number = np.arange(len(visits))
    place = np.empty(int(configuration.max(initial=-1)) + 1, dtype=np.intp)
    place[configuration[visits]] = number
    row_visit: Index = place[configuration]
    steps = np.zeros((len(visits), q.shape[1]))
    flicker = np.zeros(q.shape[1])
    for j, readings in enumerate(q.T):
        step = steps[:, j]
        step[1:] = np.diff(readings[visits])
        step[opens_group] = 0
        step[np.abs(step) <= SAME_READING] = 0
        slides = j < len(prismatic) and bool(prismatic[j])
        resting = find_resting_steps(step, opens_group, slides)
        flicker[j] = np.abs(step[resting]).max(initial=0.0)
        step[resting] = 0
    return JointPath(steps, opens_group), row_visit, flicker


def describe_last_motion(path: JointPath, row_visit: Index) -> tuple[Array, Array]:
    """Return (approach, move), each (m, n): sign and size of the motion that led to each row's visit;
    a joint that rests keeps the sign."""
    number = np.arange(len(path.opens))
    shape = len(row_visit), path.steps.shape[1]
    approach, move = np.empty(shape), np.empty(shape)
    # joint by joint: of a million rows, no more than a few columns are held beside the result
    for j, step in enumerate(path.steps.T):
        is_motion = (step != 0) | path.opens
        last_motion = np.maximum.accumulate(np.where(is_motion, number, 0))
        approach[:, j] = np.sign(step[last_motion])[row_visit]
        move[:, j] = np.abs(step)[row_visit]
    return approach, move


def _order_visits(configuration: Index, group: Index, order: Array) -> Index:
    """List one row per visit, in order of motion, group by group."""
    rows = np.arange(len(group))
    keys = (rows, order, group)
    sequence = np.lexsort(keys)
    ordered = configuration[sequence]
    _, first = np.unique(ordered, return_index=True)
    # in order of motion
    places = np.sort(first)
    visits: Index = sequence[places]
    return visits


def order_units(unit: Index, progress: Array) -> tuple[Index, Index]:
    """Number units as the arm came to them, the same whatever the rows' order: (every row's unit
    (m,), the first row (u,) of each)."""
    is_present = np.bincount(unit) > 0
    place = np.cumsum(is_present) - 1
    number = place[unit]
    sequence = np.argsort(progress, kind="stable")
    count = int(is_present.sum())
    first_rows = np.empty(count, dtype=np.intp)
    # from the last row to the first, which is what stays
    backwards = sequence[::-1]
    first_rows[number[backwards]] = backwards
    first_progress = progress[first_rows]
    order = np.argsort(first_progress, kind="stable")
    # as the arm came to them
    rank: Index = np.argsort(order, kind="stable")
    row_unit = rank[number]
    unit_rows = first_rows[order]
    return row_unit, unit_rows
