"""Which visits of the arm have readings near each other, and which came back to one posture: encoders
and drives let the readings of a posture differ a little."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .._linalg import connected_components
from .._typing import Array, Index, Mask
from ..exceptions import count_words, write_rounded

# visits that may lie as close along one direction before a search tree compares them
MAX_LAG = 16
# pairs beyond which visits lie so densely that no posture stands apart from others
MOST_PAIRS = 3_000_000
# the most by which the readings of one posture differ: what drives leave of a motion's goal
RETURN_RAD, RETURN_MM = 1e-3, 1.0
# how many times as far as its readings differ the next posture must be
APART = 20.0


def find_near_pairs(readings: Array, within: float, max_lag: int = MAX_LAG) -> Index:
    """Find the pairs (k, 2) of visits whose readings (v, n) differ by at most `within` in every
    joint."""
    pairs = _compare_along(readings, within, max_lag)
    if pairs is None:
        from scipy.spatial import cKDTree

        tree = cKDTree(readings)
        pairs = tree.query_pairs(within, p=np.inf, output_type="ndarray")
    return pairs


def _find_few_near_pairs(readings: Array, within: float) -> Index | None:
    """Find near pairs as `find_near_pairs` does; None where visits lie so densely that there are more
    than MOST_PAIRS."""
    pairs = _compare_along(readings, within, MAX_LAG)
    if pairs is not None:
        return pairs
    from scipy.spatial import cKDTree

    tree = cKDTree(readings)
    # every pair in both orders, and every visit with itself
    counted = tree.count_neighbors(tree, within, p=np.inf) - len(readings)
    if counted > 2 * MOST_PAIRS:
        return None
    found: Index = tree.query_pairs(within, p=np.inf, output_type="ndarray")
    return found


def _compare_along(readings: Array, within: float, max_lag: int) -> Index | None:
    """Find near pairs among the visits that are near along one direction; None where more than
    `max_lag` visits are so to one."""
    joint_numbers = np.arange(1, readings.shape[1] + 1)
    # readings alike in every joint are alike along any one direction
    direction = np.sqrt(joint_numbers)
    along = readings @ direction
    order = np.argsort(along, kind="stable")
    ordered = along[order]
    limit = within * direction.sum()
    pairs = [np.zeros((0, 2), dtype=np.intp)]
    later = np.arange(1, len(ordered))
    for lag in range(1, max_lag + 1):
        later = later[later >= lag]
        steps = ordered[later] - ordered[later - lag]
        later = later[steps <= limit]
        if not len(later):
            return np.concatenate(pairs)
        couples = np.stack([order[later - lag], order[later]], 1)
        largest = _measure_distances(readings, couples)
        alike = couples[largest <= within]
        pairs.append(alike)
    return None


def _measure_distances(readings: Array, pairs: Index) -> Array:
    """Compute the largest difference (k,) of the readings of pairs (k, 2) in any joint."""
    first, second = pairs.T
    difference = readings[first] - readings[second]
    return np.asarray(np.abs(difference).max(1))


def find_returns(readings: Array, prismatic: Sequence[bool] = ()) -> Index:
    """Find pairs (k, 2) of visits to one posture: their readings (v, n), rad or mm, differ by little, and
    by far less than from those of any other posture; `prismatic`: joints that slide.

    None is found where visits lie so densely that no posture stands apart, as on a path that was
    sampled finely."""
    scaled = _scale(readings, prismatic)
    none = np.zeros((0, 2), dtype=np.intp)
    pairs = _find_few_near_pairs(scaled, 1.0)
    if pairs is None or not len(pairs):
        return none
    posture = connected_components(len(scaled), pairs)
    spread = compute_spread(scaled, posture)
    _, first = np.unique(posture, return_index=True)
    around = _find_few_near_pairs(scaled[first], APART)
    if around is None:
        return none
    nearest = np.full(len(spread), np.inf)
    distance = _measure_distances(scaled[first], around)
    for side in around.T:
        np.minimum.at(nearest, side, distance)
    stands_apart: Mask = (spread <= 1.0) & (nearest >= APART * spread)
    return pairs[stands_apart[posture[pairs[:, 0]]]]


def are_near(readings: Array, posture: Index, prismatic: Sequence[bool] = ()) -> Mask:
    """Say of each posture (k,) whether the readings (v, n) of its visits differ by as little as those of
    returns."""
    scaled = _scale(readings, prismatic)
    spread = compute_spread(scaled, posture)
    return np.asarray(spread <= 1.0)


def _scale(readings: Array, prismatic: Sequence[bool]) -> Array:
    """Divide readings (v, n) by the most by which those of one posture differ."""
    slides = _mark_slides(readings, prismatic)
    most = np.where(slides, RETURN_MM, RETURN_RAD)
    return np.asarray(readings / most)


def _mark_slides(readings: Array, prismatic: Sequence[bool]) -> Mask:
    """Mark (n,) the joints that slide; none where `prismatic` is empty."""
    slides = np.zeros(readings.shape[1], bool)
    slides[: len(prismatic)] = prismatic
    return slides


def compute_spread(readings: Array, posture: Index) -> Array:
    """Compute by how much the readings (v, n) of each posture differ at most in any joint (k,)."""
    shape = int(posture.max(initial=-1)) + 1, readings.shape[1]
    low = np.full(shape, np.inf)
    high = np.full(shape, -np.inf)
    np.minimum.at(low, posture, readings)
    np.maximum.at(high, posture, readings)
    spread = high - low
    return np.asarray(spread.max(1, initial=0.0))


def describe_returns(
    readings: Array, posture: Index, prismatic: Sequence[bool], same: float
) -> str | None:
    """Describe visits that are taken as repeats of a posture though their readings (v, n) differ by more
    than `same`; None where there are none. `posture` (v,): the number of each visit's."""
    differs = compute_spread(readings, posture) > same
    if not differs.any():
        return None
    slides = _mark_slides(readings, prismatic)
    sizes = []
    for joints, scale, unit in ((~slides, np.degrees(1), "deg"), (slides, 1.0, "mm")):
        spread = compute_spread(readings[:, joints], posture)
        largest = spread[differs].max()
        if largest > same:
            sizes.append(f"{write_rounded(scale * largest, 2)} {unit}")
    size = " and ".join(sizes)
    postures = count_words(int(differs.sum()), "posture")
    visits = count_words(int(differs[posture].sum()), "configuration")
    return (
        f"The arm came back to {postures} with readings that differ by up to {size}. These {visits} are taken as "
        "repeats, which stay together in folds and split: what lasts at a posture says nothing of others."
    )
