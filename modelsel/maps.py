"""The error map as values: places x causes, what each cell alone would explain beyond the base, and by what chance."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .candidates import Candidate
from .causes import Bump
from .extend import Extension
from .rigid import AXES, Array


@dataclass(frozen=True, eq=False)
class ErrorMap:
    """`f` and `p` (P, C): the F statistic of each cell alone, nan where no cell is, and its family-wise p."""

    places: tuple[str, ...]
    causes: tuple[str, ...]
    f: Array
    p: Array


def error_map(extension: Extension, found: Sequence[Candidate]) -> ErrorMap:
    """Every candidate that acts at one place with one cause (or one wave of unknown phase), seen from the base."""
    cells: dict[tuple[str, str], tuple[float, float]] = {}
    order: dict[str, tuple[int, int]] = {}
    for k, candidate in enumerate(found):
        if not candidate.registered and candidate.mechanism.sentence:
            continue                                    # no cell of the map, but something strange of one joint
        screws = [s for t in candidate.mechanism.terms for s in t.screws]
        places = {(s.frame, s.axis) for s in screws}
        causes = list(dict.fromkeys(str(s.cause) for s in screws))
        if len(places) != 1 or len(causes) > 2 or isinstance(screws[0].cause, Bump):
            continue
        frame, axis = places.pop()
        place, cause = f"{frame} {axis}", " & ".join(causes)
        order[place] = (frame, AXES.index(axis))
        if (place, cause) not in cells:
            cells[place, cause] = (float(extension.single_f[k]), float(extension.map_p[k]))
    rows = sorted(order, key=order.__getitem__)
    columns = list(dict.fromkeys(cause for _, cause in cells))
    f, p = np.full((len(rows), len(columns)), np.nan), np.ones((len(rows), len(columns)))
    where = {cause: j for j, cause in enumerate(columns)}
    for i, place in enumerate(rows):
        for cause, j in where.items():
            if (place, cause) in cells:
                f[i, j], p[i, j] = cells[place, cause]
    return ErrorMap(tuple(rows), tuple(columns), f, p)


def strongest_causes(whole: ErrorMap, most: int) -> tuple[int, ...]:
    """Indices of the causes whose best cell stands out most, at most `most`, in the map's order."""
    best = np.nanmax(np.where(np.isnan(whole.f), 0.0, whole.f), axis=0)
    return tuple(sorted(np.argsort(-best, kind="stable")[:most].tolist()))
