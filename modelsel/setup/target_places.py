"""Whether what the rows call a target is one place on the flange: two targets under one name keep
their distance from each other, one that stands on the floor keeps its place while the arm moves.

Neither needs the robot, the tracker's frame or where the targets are."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from .._typing import Array, Index
from ..exceptions import write_rounded
from ..measurements.measurements import Measurements

# pairs of rows, and configurations of a pair of targets, below which nothing is said
MIN_PAIRS = 4
MIN_CONFIGURATIONS = 5
# mm from which two rows of one posture are at two places: no arm repeats so badly
MIN_DISTANCE_MM = 5.0
# what the distances of pairs may differ by, as a share of them, and the share of pairs that do not
MAX_DIFFERENCE = 0.03
MIN_EQUAL_SHARE = 0.8
# share of the distance by which all pairs lie in one direction: what was moved is the instrument
MAX_COMMON_SHARE = 0.9
# spread of a target that stands, as a share of that of one which the arm moves
MAX_STANDING_SHARE = 0.05


def describe_wrong_targets(data: Measurements) -> str | None:
    """Describe rows whose target has no name of its own, or a target that the arm does not carry;
    None where there are none."""
    if data.gauges is not None:
        return None
    is_whole = np.isfinite(data.position)
    if not is_whole.all():
        return None
    standing = _describe_standing(data)
    if standing is not None:
        return standing
    return _describe_unnamed(data)


def _describe_unnamed(data: Measurements) -> str | None:
    """Describe two targets under one name."""
    first, second = _pair_rows(data)
    apart = data.position[second] - data.position[first]
    distance = np.linalg.norm(apart, axis=1)
    if len(distance) < MIN_PAIRS:
        return None
    middle = float(np.median(distance))
    difference = np.abs(distance - middle)
    is_equal = difference <= MAX_DIFFERENCE * middle
    count = int(is_equal.sum())
    total = len(distance)
    fewest = MIN_EQUAL_SHARE * total
    if middle < MIN_DISTANCE_MM or count < fewest:
        return None
    mean = apart[is_equal].mean(0)
    common = float(np.linalg.norm(mean))
    if common > MAX_COMMON_SHARE * middle:
        return None
    pair = [first[0], second[0]]
    rows = data.row[pair]
    where = data.where.listed(rows)
    return (
        f"Rows with the same joint readings are {write_rounded(middle)} mm apart, the same distance "
        f"in {count:,} of {total:,} postures ({where}): several targets on the flange were "
        "measured under one name. Give every row the name of its own in a column target."
    )


def _pair_rows(data: Measurements) -> tuple[Index, Index]:
    """Pair the first two rows of every posture, group and target."""
    targets = len(data.targets)
    session = data.block * len(data.groups) + data.group
    key = session * targets + data.target
    order = np.lexsort((data.row, key))
    _, starts, counts = np.unique(key[order], return_index=True, return_counts=True)
    has_two = counts > 1
    places = starts[has_two]
    first = order[places]
    second = order[places + 1]
    return first, second


def _describe_standing(data: Measurements) -> str | None:
    """Describe a target that stands still while the arm moves another one."""
    measured = np.unique(data.target).tolist()
    for still, carried in permutations(measured, 2):
        rows, others = _match_rows(data, still, carried)
        if len(rows) < MIN_CONFIGURATIONS:
            continue
        places = data.position[rows]
        moving = data.position[others]
        spread = _compute_spread(places)
        motion = _compute_spread(moving)
        apart = places - moving
        distance = np.linalg.norm(apart, axis=1)
        change = float(np.ptp(distance))
        is_still = spread < MAX_STANDING_SHARE * motion
        is_rigid = change < max(MIN_DISTANCE_MM, MAX_STANDING_SHARE * motion)
        if not is_still or is_rigid:
            continue
        name = data.targets[still]
        other = data.targets[carried]
        return (
            f'Target "{name}" stands still while the arm moves: its {len(rows):,} positions are '
            f"within {write_rounded(spread, 2)} mm of their middle, and its distance from "
            f'"{other}" changes by {write_rounded(change)} mm. It is not on the flange: take its '
            "rows out of the file."
        )
    return None


def _match_rows(data: Measurements, still: int, carried: int) -> tuple[Index, Index]:
    """Match a row of one target with one of another, of the same configuration and of the group
    that has most of them."""
    first = np.flatnonzero(data.target == still)
    second = np.flatnonzero(data.target == carried)
    _, of_first, of_second = np.intersect1d(
        data.configuration[first], data.configuration[second], return_indices=True
    )
    rows = first[of_first]
    others = second[of_second]
    if not len(rows):
        return rows, others
    group = data.group[rows]
    counts = np.bincount(group)
    largest = counts.argmax()
    is_largest = group == largest
    return rows[is_largest], others[is_largest]


def _compute_spread(position: Array) -> float:
    """Compute the largest distance [mm] of positions (m, 3) from their middle."""
    middle = np.median(position, axis=0)
    apart = position - middle
    distance = np.linalg.norm(apart, axis=1)
    largest = distance.max()
    return float(largest)
