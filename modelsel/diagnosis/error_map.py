"""The error map as values: places x causes, what each cell alone would explain beyond the base, and
by what chance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._typing import Array
from ..mechanisms.causes import Bump, Cause
from ..mechanisms.terms import Mechanism
from ..robot.rigid import AXES
from .candidates import Candidate
from .stepwise import Diagnosis


@dataclass(frozen=True, eq=False)
class ErrorMap:
    """`f` and `p` (P, C): the F statistic of each cell alone, nan where no cell is, and its
    family-wise p; `where` and `why` are places and causes as values, `named` the registered
    mechanism of a cell (row, column)."""

    places: tuple[str, ...]
    causes: tuple[str, ...]
    f: Array
    p: Array
    where: tuple[tuple[int, str], ...]
    why: tuple[tuple[Cause, ...], ...]
    named: dict[tuple[int, int], Mechanism]


def build_error_map(diagnosis: Diagnosis, found: Sequence[Candidate]) -> ErrorMap:
    """Every candidate that acts at one place with one cause (or one wave of unknown phase), seen
    from the base."""
    cells: dict[tuple[tuple[int, str], str], int] = {}
    why: dict[str, tuple[Cause, ...]] = {}
    for k, candidate in enumerate(found):
        if not candidate.registered and candidate.mechanism.sentence:
            continue  # no cell of the map, but something strange of one joint
        screws = [s for t in candidate.mechanism.terms for s in t.screws]
        places, causes = (
            {(s.frame, s.axis) for s in screws},
            tuple(dict.fromkeys(s.cause for s in screws)),
        )
        if len(places) != 1 or len(causes) > 2 or isinstance(screws[0].cause, Bump):
            continue
        name = " & ".join(map(str, causes))
        cells.setdefault((places.pop(), name), k)
        why.setdefault(name, causes)
    rows, columns = (
        sorted({place for place, _ in cells}, key=lambda place: (place[0], AXES.index(place[1]))),
        list(why),
    )
    f, p, named = np.full((len(rows), len(columns)), np.nan), np.ones((len(rows), len(columns))), {}
    at = {key: k for keys in (rows, columns) for k, key in enumerate(keys)}
    for (place, name), k in cells.items():
        cell = at[place], at[name]
        f[cell], p[cell] = diagnosis.single_f[k], diagnosis.map_p[k]
        if found[k].registered:
            named[cell] = found[k].mechanism
    names = tuple(f"{frame} {axis}" for frame, axis in rows)
    return ErrorMap(names, tuple(columns), f, p, tuple(rows), tuple(why.values()), named)


def select_strongest_causes(whole: ErrorMap, most: int) -> tuple[int, ...]:
    """Indices of the causes whose best cell stands out most, at most `most`, in the map's order."""
    best = np.nanmax(np.where(np.isnan(whole.f), 0.0, whole.f), axis=0)
    return tuple(sorted(np.argsort(-best, kind="stable")[:most].tolist()))
