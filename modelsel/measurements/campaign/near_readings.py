"""Which visits of the arm have readings near each other, and which came back to one posture: encoders
and drives let the readings of a posture differ a little."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..._hashing import HASH_FACTOR
from ..._linalg import connected_components
from ..._typing import Array, Index, Mask
from ...exceptions import count_words, write_rounded

# visits that may lie as close along one direction before a search tree compares them
MAX_LAG = 16
# the most by which the readings of one posture differ: what drives leave of a motion's goal
RETURN_RAD, RETURN_MM = 5e-3, 5.0
# share of it by which they differ at most where a nominal arm knows how far it moved between them
PREDICTED = 0.2
# how many times as far as its readings differ the next posture must be, of few joints so many more that of
# this many postures drawn at random one is so near to another
APART, BY_CHANCE = 20.0, 1e5
# cells of the grids that join readings, as multiples of RETURN: the finest tell fine grids of postures apart
CELLS = (4.0, 1.0, 0.25, 0.0625, 0.015625)
# grids of a cell, and by how much those of joints are shifted against each other
GRIDS, GOLDEN = 6, 0.618
# visits whose cells are hashed at once: what they need stays in the processor's cache
BLOCK = 2048


def find_near_pairs(readings: Array, within: float, max_lag: int = MAX_LAG) -> Index:
    """Find the pairs (k, 2) of visits whose readings (v, n) differ by at most `within` in every
    joint."""
    pairs = _compare_along(readings, within, max_lag)
    if pairs is None:
        from scipy.spatial import cKDTree

        tree = cKDTree(readings)
        found: Index = tree.query_pairs(within, p=np.inf, output_type="ndarray")
        return found
    return pairs


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
    """Find pairs (k, 2) of visits to one posture, each with its first: their readings (v, n), rad or mm,
    differ by little, and by far less than from those of any other posture; `prismatic`: joints that
    slide.

    None is found where no posture stands apart from others, as on a path that was sampled finely."""
    scaled = _scale(readings, prismatic)
    found = [_find_apart(scaled, cell) for cell in CELLS]
    return np.concatenate(found)


def _find_apart(scaled: Array, cell: float) -> Index:
    """Find pairs (k, 2) of visits to postures that stand apart among those that grids tell apart."""
    posture = _join_near(scaled / cell)
    _, first, count = np.unique(posture, return_index=True, return_counts=True)
    spread = compute_spread(scaled, posture)
    candidates = np.flatnonzero((count > 1) & (spread <= 1.0))
    if not len(candidates) or len(first) < 2:
        return np.zeros((0, 2), dtype=np.intp)
    nearest = _measure_nearest(scaled[first], candidates)
    moving = max(int((np.ptp(scaled, axis=0) > 1.0).sum()), 1)
    apart = max(APART, BY_CHANCE ** (1 / moving))
    stands_apart = np.zeros(len(first), bool)
    stands_apart[candidates] = nearest >= apart * spread[candidates]
    pairs = np.stack([first[posture], np.arange(len(scaled))], 1)
    is_return = stands_apart[posture] & (pairs[:, 0] != pairs[:, 1])
    returns: Index = pairs[is_return]
    return returns


def _join_near(scaled: Array) -> Index:
    """Number (v,) what visits with near readings have in common, or a chain of them: those that are in
    one cell of a grid. Of several grids, each shifted against the others in every joint, one nearly
    always has readings in one cell that differ by far less."""
    number = np.arange(len(scaled))
    pairs = [np.zeros((0, 2), dtype=np.intp)]
    blocks = [scaled[low : low + BLOCK] for low in range(0, max(len(scaled), 1), BLOCK)]
    keys = np.concatenate([_hash_cells(block) for block in blocks], axis=1)
    ordered = np.sort(keys, axis=1)
    shares = (ordered[:, 1:] == ordered[:, :-1]).any(1)
    for grid in np.flatnonzero(shares):
        _, first, cell = np.unique(keys[grid], return_index=True, return_inverse=True)
        together = np.stack([first[cell], number], 1)
        pairs.append(together)
    return connected_components(len(scaled), np.concatenate(pairs))


def _hash_cells(scaled: Array) -> NDArray[np.uint64]:
    """Hash the cell (GRIDS, v) of every grid in which each visit is."""
    keys = np.zeros((GRIDS, len(scaled)), np.uint64)
    grids = np.arange(GRIDS)[:, None]
    for joint, column in enumerate(scaled.T):
        shift = (grids / GRIDS + GOLDEN * joint) % 1
        # no cell is minus zero, which has other bits than zero
        cells = np.floor(column + shift) + 0.0
        keys = (keys ^ cells.view(np.uint64)) * HASH_FACTOR
        keys ^= keys >> np.uint64(32)
    return keys


def _measure_nearest(scaled: Array, some: Index) -> Array:
    """Measure how far (k,) the nearest other is from some."""
    from scipy.spatial import cKDTree

    tree = cKDTree(scaled)
    distances, _ = tree.query(scaled[some], k=2, p=np.inf)
    return np.asarray(distances[:, 1])


def are_near(readings: Array, posture: Index, prismatic: Sequence[bool] = ()) -> Mask:
    """Say of each posture (k,) whether the readings (v, n) of its visits differ by so little that a nominal
    arm knows how far it moved between them."""
    scaled = _scale(readings, prismatic)
    spread = compute_spread(scaled, posture)
    return np.asarray(spread <= PREDICTED)


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
        "repeats, which stay together in folds and in a split that is drawn: what lasts at a posture says nothing "
        "of others."
    )
