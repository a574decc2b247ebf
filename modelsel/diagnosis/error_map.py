"""The error map: places x causes, with what each cell alone would explain beyond the base."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._typing import Array
from ..mechanisms.causes import Bump, Cause
from ..mechanisms.terms import Mechanism
from ..robot.rigid import AXES
from .candidates.candidate import Candidate
from .findings.outcome import Diagnosis
from .shapes.candidate_kinds import MAP_KINDS
from .shapes.distinct_places import Place
from .shapes.driver_functions import IN_TIME
from .shapes.unregistered import Causes


@dataclass(frozen=True, eq=False)
class ErrorMap:
    """What every cell of the error map, a place with a cause, would explain alone.

    `f` (P, C): the F statistic of each cell, NaN where there is no cell; `p` (P, C): its family-
    wise p-value; `where` and `why`: places and causes as values; `named`: the registered mechanism
    of a cell (row, column)."""

    places: tuple[str, ...]
    causes: tuple[str, ...]
    f: Array
    p: Array
    where: tuple[Place, ...]
    why: tuple[tuple[Cause, ...], ...]
    named: dict[tuple[int, int], Mechanism]


def build_error_map(diagnosis: Diagnosis, found: Sequence[Candidate]) -> ErrorMap:
    """Build the map of every candidate that is one cell, seen from the base.

    A cell acts at one place with one cause, or with one wave of unknown phase."""
    cells: dict[tuple[Place, str], int] = {}
    why: dict[str, Causes] = {}
    hidden = _find_weaker_forms(diagnosis, found)
    for g, candidate in enumerate(found):
        cell = _locate(candidate)
        if cell is None or g in hidden:
            continue
        place, causes = cell
        name = " & ".join(map(str, causes))
        why.setdefault(name, causes)
        cells.setdefault((place, name), g)
    where = list({place for place, _ in cells})
    where.sort(key=lambda place: (place[0], AXES.index(place[1])))
    names = list(why)
    row_of = {place: k for k, place in enumerate(where)}
    column_of = {name: k for k, name in enumerate(names)}
    shape = len(where), len(names)
    f = np.full(shape, np.nan)
    p = np.ones(shape)
    named = {}
    for (place, name), g in cells.items():
        row = row_of[place]
        column = column_of[name]
        f[row, column] = diagnosis.single_f[g]
        p[row, column] = diagnosis.map_p[g]
        if found[g].registered:
            named[row, column] = found[g].mechanism
    return ErrorMap(
        places=tuple(f"{frame} {axis}" for frame, axis in where),
        causes=tuple(names),
        f=f,
        p=p,
        where=tuple(where),
        why=tuple(why.values()),
        named=named,
    )


def _find_weaker_forms(diagnosis: Diagnosis, found: Sequence[Candidate]) -> set[int]:
    """Find the candidates that the map leaves out: of a step at any moment all but what was found, or
    else the strongest."""
    chosen = {effect.candidate.mechanism for effect in diagnosis.effects}
    forms: dict[str, list[int]] = {}
    for g, candidate in enumerate(found):
        name = candidate.registered_name
        if name is not None and candidate.mechanism.names() & IN_TIME:
            forms.setdefault(name, []).append(g)
    hidden: set[int] = set()
    for members in forms.values():
        shown = max(members, key=lambda g: (found[g].mechanism in chosen, diagnosis.single_f[g]))
        hidden.update(members)
        hidden.discard(shown)
    return hidden


def _locate(candidate: Candidate) -> tuple[Place, Causes] | None:
    """Find the cell of a candidate; None where it is no cell of the map."""
    is_in_map = candidate.registered or candidate.kind in MAP_KINDS
    if not is_in_map:
        return None
    places: set[Place] = set()
    causes: dict[Cause, None] = {}
    for term in candidate.mechanism.terms:
        for screw in term.screws:
            place = screw.frame, screw.axis
            places.add(place)
            causes[screw.cause] = None
    first_cause = next(iter(causes))
    if isinstance(first_cause, Bump):
        return None
    if len(places) != 1 or len(causes) > 2:
        return None
    return places.pop(), tuple(causes)
