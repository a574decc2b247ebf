"""Errors on held-out rows compared with those of cross-validation: larger altogether, or a few of them
far larger."""

from __future__ import annotations

import numpy as np

from .._typing import Array, Index, Mask

# configurations that each side of a comparison needs
FEWEST = 5
# how many times the largest error of cross-validation is far, and the power by which tails as heavy as
# measurements have them fall
FAR, TAIL = 2.0, 3.0
# mm below which the largest error is rounding
ROUNDING_MM = 1e-6


def compare_held_out(
    expected: Array, expected_block: Index, length: Array, block: Index
) -> tuple[float, float]:
    """Test whether held-out lengths are larger than cross-validated ones: (ratio of rms, p).

    Lengths [mm] `expected` of configurations `expected_block`, and `length` of `block`. Wilcoxon's
    rank sum of mean squares per configuration, so that tails do not matter; (1, 1) with fewer than
    five configurations on a side."""
    first = _mean_by_block(np.square(expected), expected_block)
    second = _mean_by_block(np.square(length), block)
    few = min(len(first), len(second)) < FEWEST
    if few or not first.mean() > 0:
        return 1.0, 1.0
    ratio = second.mean() / first.mean()
    return float(np.sqrt(ratio)), _rank_sum_p(first, second)


def find_far_held_out(
    expected: Array, expected_block: Index, length: Array, block: Index
) -> tuple[Mask, float]:
    """Find held-out rows that err FAR times as much as any did in cross-validation: (mask, p).

    Lengths [mm] `expected` of configurations `expected_block`, and `length` of `block`. The p-value is
    of as many configurations that far off among h held-out ones, where n in cross-validation have errors of
    the same law, whose tail falls as the power -TAIL: beyond f times the largest of n, E / (n f^TAIL)
    of it is left, E exponential: their number is geometric with mean h / (n f^TAIL). The least likely
    number counts, times all. None (p = 1) with fewer than five configurations on a side, or where no
    more than rounding is left."""
    held_out, place = np.unique(block, return_inverse=True)
    blocks = len(np.unique(expected_block)), len(held_out)
    nothing = np.zeros(len(length), bool)
    if min(blocks) < FEWEST or not expected.max() > ROUNDING_MM:
        return nothing, 1.0
    times = length / expected.max()
    farthest = np.zeros(len(held_out))
    np.maximum.at(farthest, place.reshape(-1), times)
    ordered = np.sort(farthest[farthest > FAR])[::-1]
    count = np.arange(1, len(ordered) + 1)
    mean = blocks[1] / (blocks[0] * ordered**TAIL)
    p = (mean / (1 + mean)) ** count
    least = p.min(initial=1.0) * max(len(ordered), 1)
    return times > FAR, min(float(least), 1.0)


def _rank_sum_p(first: Array, second: Array) -> float:
    """Compute Wilcoxon's p of `second` being larger, by the normal approximation with ties; `scipy.stats`
    has it, and takes half a second to import."""
    from scipy.special import ndtr

    every = np.concatenate([second, first])
    _, place, ties = np.unique(every, return_inverse=True, return_counts=True)
    last = np.cumsum(ties)
    rank = last - (ties - 1) / 2
    count = len(every)
    product = len(first) * len(second)
    rank_sum = rank[place[: len(second)]].sum()
    excess = rank_sum - len(second) * (len(second) + 1) / 2 - product / 2
    tied = (ties**3 - ties).sum() / (count * (count - 1))
    variance = product / 12 * (count + 1 - tied)
    if variance == 0:
        return 1.0
    return float(ndtr(-excess / np.sqrt(variance)))


def _mean_by_block(values: Array, block: Index) -> Array:
    _, unit = np.unique(block, return_inverse=True)
    return np.asarray(np.bincount(unit, values) / np.bincount(unit))
