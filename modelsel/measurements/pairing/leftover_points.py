"""Points of an instrument's export that no reading of a joint log is called like: shots repeated
under another name, and points measured at the start and at the end."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence

import numpy as np

from ..._typing import Array, Index

# what stands behind the name of a point that was shot again: P031_2, P031 (2), P031-rep
AGAIN = re.compile(
    r"(?P<name>.+?)\s*(?:[_.-]\s*\d{1,2}|\(\d{1,2}\)|[_ -](?:r|rep|repeat|reshot|wdh|again|bis)\d{0,2})",
    re.IGNORECASE,
)
# words for the beginning and the end of a campaign
BEGINNINGS = ("start", "begin", "before", "anfang", "vorher", "vor")
ENDINGS = ("end", "after", "ende", "nachher", "nach")
WORD = re.compile(r"[^\W\d_]+")


def find_repeated_name(name: str, measured: Collection[str], read: Collection[str]) -> str | None:
    """Find the name of the point that was shot again under `name`: one of those measured, and one
    of those with readings; None where there is none."""
    if name in read:
        return None
    match = AGAIN.fullmatch(name)
    if match is None:
        return None
    first = match["name"]
    is_measured = first in measured
    has_readings = first in read
    return first if is_measured and has_readings else None


def pair_start_and_end(names: Sequence[str]) -> list[tuple[str, int, int]]:
    """Pair names that differ by a word for the start and one for the end alone: (what they share,
    the place of the first, of the second)."""
    starts = _find_marked(names, BEGINNINGS)
    ends = _find_marked(names, ENDINGS)
    pairs = []
    for shared, first in starts.items():
        if shared in ends:
            last = ends[shared]
            pairs.append((shared, first, last))
    return pairs


def _find_marked(names: Sequence[str], words: Collection[str]) -> dict[str, int]:
    """Find the names that hold one of some words, by what else they hold; not those that stand
    twice."""
    found = dict[str, int]()
    twice = set[str]()
    for place, name in enumerate(names):
        for match in WORD.finditer(name):
            word = match[0].casefold()
            if word not in words:
                continue
            before = name[: match.start()]
            after = name[match.end() :]
            shared = f"{before} {after}".strip(" _-.:")
            if shared in found:
                twice.add(shared)
            found[shared] = place
    for shared in twice:
        del found[shared]
    return found


def describe_drift(names: Sequence[str], position: Array, rows: Index) -> list[str]:
    """Say how far points moved that were measured at the start and at the end, of some rows of an
    export: their names, and their positions (m, 3) [mm]."""
    chosen = rows.tolist()
    pairs = pair_start_and_end([names[row] for row in chosen])
    moved = []
    for shared, first, last in pairs:
        start = position[chosen[first]]
        end = position[chosen[last]]
        distance = float(np.linalg.norm(end - start))
        if np.isfinite(distance):
            moved.append(f"{shared} by {distance:.3f} mm")
    if not moved:
        return []
    listed = ", ".join(moved)
    said = (
        f"Between the start and the end the fixed points moved: {listed}. This is how far the "
        "instrument, or what it and the points stand on, drifted."
    )
    return [said]
