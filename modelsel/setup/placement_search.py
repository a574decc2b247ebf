"""Search placements and targets: several starts are minimised, and the one with the least robust
misfit is taken.

The starts are minimised together, and so are those of sights whose rows have the same groups and
targets, such as the same positions with several robots. The search of a sight ends with the first
starts that end in one minimum, if it explains the points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from hashlib import blake2b
from itertools import islice
from threading import Lock

import numpy as np

from .._typing import Array, Mask
from .adjustment import GROSS, refine_robustly, refine_without_gross_rows
from .placement import (
    MEDIAN_3,
    Placed,
    Sight,
    compute_misfits,
    compute_trimmed_median,
    stack_placed,
    stack_sights,
)
from .starting_values import generate_starts, turn_about_lines

# rows on which starts are tried, spread over the data, and at least of every group and target
START_ROWS = 300
MIN_PAIR_ROWS = 30
# starts that are tried before all others: mostly two agree
FIRST_STARTS = 2
# relative difference of misfits that are one minimum
SAME_MINIMUM = 1e-3
# share of the points' spread below which agreement of two starts ends the search
GOOD_SHARE = 0.01

# sights whose placements are remembered
REMEMBERED = 200

Found = tuple[Placed, Mask]
_remembered: dict[bytes, Found] = {}
# a program may register in several threads
_lock = Lock()


def find_placements(sights: Sequence[Sight]) -> list[Found]:
    """Find for every sight (the placement with the least robust misfit over all starts, mask of the
    rows that are not gross).

    Those found lately are remembered: one check registers the same rows as another before it."""
    keys = [_hash_sight(sight) for sight in sights]
    found: dict[bytes, Found] = {}
    new: dict[bytes, Sight] = {}
    for key, sight in zip(keys, sights, strict=True):
        known = _remembered.get(key)
        if known is None:
            new[key] = sight
        else:
            found[key] = known
    for alike in _list_alike(new):
        stacked = [new[key] for key in alike]
        placed = _find_alike(stacked)
        pairs = zip(alike, placed, strict=True)
        found.update(pairs)
    _remember(found)
    return [found[key] for key in keys]


def _hash_sight(sight: Sight) -> bytes:
    """Hash all that a sight holds."""
    sizes = (sight.groups, sight.x.shape, sight.usual.shape)
    text = repr(sizes)
    encoded = text.encode()
    digest = blake2b(encoded)
    values = [sight.x, sight.o, sight.F, sight.group, sight.target, sight.usual]
    if sight.seen is not None:
        values.append(sight.seen)
    for value in values:
        held = value.tobytes()
        digest.update(held)
    return digest.digest()


def _remember(found: Mapping[bytes, Found]) -> None:
    """Remember what was found last, and forget what was found before."""
    with _lock:
        for key, each in found.items():
            _remembered.pop(key, None)
            _remembered[key] = each
        while len(_remembered) > REMEMBERED:
            oldest = next(iter(_remembered))
            del _remembered[oldest]


def _list_alike(sights: Mapping[bytes, Sight]) -> list[list[bytes]]:
    """List the keys of sights whose rows have the same groups and targets."""
    alike: dict[tuple[object, ...], list[bytes]] = {}
    for key, sight in sights.items():
        group = sight.group.tobytes()
        target = sight.target.tobytes()
        has_orientations = sight.seen is not None
        layout = (sight.groups, sight.targets, has_orientations, group, target)
        of_layout = alike.setdefault(layout, [])
        of_layout.append(key)
    return list(alike.values())


def _find_alike(sights: Sequence[Sight]) -> list[Found]:
    """Find the placements of sights that can be stacked."""
    searches = [_Search(sight) for sight in sights]
    _try_starts(searches, FIRST_STARTS)
    going = [search for search in searches if not search.has_ended]
    _try_starts(going, None)
    for search in searches:
        search.turn_about_lines()
    _try_starts(searches, None)
    stacked = stack_sights(sights)
    each_best = [search.best for search in searches]
    best = stack_placed(each_best)
    whole = refine_robustly(stacked, best)
    fitted, good = refine_without_gross_rows(stacked, whole)
    count = len(sights)
    each = [fitted.take(k) for k in range(count)]
    return list(zip(each, good, strict=True))


class _Search:
    """The search of one sight on a sample of its rows: the starts that are left, and the placements
    that were tried, with their misfits."""

    def __init__(self, sight: Sight) -> None:
        sample = _thin(sight)
        extent = _compute_extent(sample)
        self.sample = sample
        self.good_mm = GOOD_SHARE * extent
        self.starts = generate_starts(sample)
        self.tried: list[Placed] = []
        self.has_ended = False

    def add(self, refined: Sequence[Placed]) -> None:
        """Add placements that were refined from starts, but for those after the search has ended."""
        for at in refined:
            if self.has_ended:
                return
            tried = self.tried
            tried.append(at)
            self.has_ended = len(tried) > 1 and _agree(self.sample, tried, self.good_mm)

    @property
    def best(self) -> Placed:
        """The placement of the least loss."""
        tried = self.tried
        losses = _compute_losses(self.sample, tried)
        least = losses.argmin()
        return tried[int(least)]

    def turn_about_lines(self) -> None:
        """Begin anew with the best placement, and with those that it cannot be told from."""
        best = self.best
        self.tried = [best]
        self.has_ended = False
        self.good_mm = 0.0  # all of them are tried
        self.starts = turn_about_lines(self.sample, best)


def _try_starts(searches: Sequence[_Search], count: int | None) -> None:
    """Refine so many more starts of every search, or all, together."""
    samples: list[Sight] = []
    starts: list[Placed] = []
    counts = []
    for search in searches:
        before = len(starts)
        starts += islice(search.starts, count)
        more = len(starts) - before
        samples += [search.sample] * more
        counts.append(more)
    if not starts:
        return
    sight = stack_sights(samples)
    at = stack_placed(starts)
    refined = refine_robustly(sight, at)
    first = 0
    for search, more in zip(searches, counts, strict=True):
        beyond = first + more
        own = [refined.take(k) for k in range(first, beyond)]
        search.add(own)
        first = beyond


def _thin(sight: Sight) -> Sight:
    """Thin every pair of group and target to rows spread over the data."""
    pairs = [rows for *_, rows in sight.pairs]
    share = START_ROWS // len(pairs)
    most = max(share, MIN_PAIR_ROWS)
    chosen = []
    for rows in pairs:
        count = len(rows)
        spread = np.linspace(0, count - 1, min(count, most))
        places = spread.astype(int)
        chosen.append(rows[places])
    kept = np.concatenate(chosen)
    return sight.take(np.sort(kept))


def _compute_extent(sight: Sight) -> float:
    """Compute the median distance [mm] of points from the middle of their group."""
    of_rows = sight.middles[sight.group]
    distance = np.linalg.norm(sight.x - of_rows, axis=1)
    median = np.median(distance)
    return float(median)


def _compute_losses(sight: Sight, tried: Sequence[Placed]) -> Array:
    """Compute (k,) sums of squares, cut off at a common length, with the prior of the targets."""
    stacked = stack_placed(tried)
    size = compute_misfits(sight, stacked)
    medians = compute_trimmed_median(size, sight.unknowns)
    scale = float(medians.min())
    offset = stacked.tools - sight.usual
    ratio = offset / sight.prior_sigma
    penalties = np.square(ratio).sum((1, 2))
    sigma = scale / MEDIAN_3
    prior = penalties * sigma**2
    cut_off = GROSS * scale
    bounded = np.minimum(np.square(size), cut_off**2)
    losses = bounded.sum(1) + prior
    return np.asarray(losses)


def _agree(sight: Sight, tried: Sequence[Placed], good_mm: float) -> bool:
    """Return whether two starts have ended in the best minimum, and it explains the points."""
    loss = _compute_losses(sight, tried)
    best = int(loss.argmin())
    least = loss[best]
    most = least * (1 + SAME_MINIMUM)
    in_best = loss <= most
    if in_best.sum() < 2:
        return False
    misfits = compute_misfits(sight, tried[best])
    median = float(np.median(misfits))
    return median < good_mm
