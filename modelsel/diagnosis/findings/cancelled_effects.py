"""Effects of which another one takes back most at the target."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..search.state import Search
from ..search.views import View

# share of either of two effects below which what is left of both is reported
MAX_CANCELLED = 0.5


def find_cancelling(
    search: Search, chosen: Sequence[int], view: View
) -> dict[int, tuple[str, float]]:
    """Find the effects of which another one takes back more than half at the target.

    Maps each to the other's label, and the share of the smaller one that is left of both."""
    displacement = {}
    size = {}
    for g in chosen:
        moved = search.compute_displacement(g, view)
        displacement[g] = moved
        size[g] = float(np.linalg.norm(moved))
    cancelled = {}
    for g in chosen:
        shares = []
        for h in chosen:
            smaller = min(size[g], size[h])
            if h == g or smaller == 0:
                continue
            both = displacement[g] + displacement[h]
            left = float(np.linalg.norm(both))
            share = left / smaller
            shares.append((share, h))
        share, other = min(shares, default=(np.inf, -1))
        if share < MAX_CANCELLED:
            label = search.candidates[other].label
            cancelled[g] = (label, share)
    return cancelled
