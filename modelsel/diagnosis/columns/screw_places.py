"""Where the columns of screws stand: by place, in runs that products take without a copy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..._typing import Index
from ...fitting.problem import Problem
from ...mechanisms.causes import ONE, Cause
from ...mechanisms.terms import Screw, Term
from ...robot.rigid import AXES

# place after all others
LAST = 1 << 62
# causes in a row from which they are worth a product of their own, without a copy
MIN_RUN = 16


class Run(NamedTuple):
    """Causes (k,) of one place and their columns (k,), in slices where they are consecutive."""

    causes: Index | slice
    columns: Index | slice


@dataclass(frozen=True, eq=False)
class Place:
    """The columns of one place: the number of its field, and its causes with their columns.

    No column stands there twice."""

    number: int
    runs: tuple[Run, ...]


def build_places(pairs: Index) -> Iterator[Place]:
    """Group the screws by field; a term's second screw at one field stands in a group of its own."""
    column, number, cause = pairs
    layer = np.zeros(len(column), np.intp)
    starts = np.flatnonzero(np.diff(column, prepend=-1))
    for first, last in pairwise([*starts.tolist(), len(column)]):
        if last - first > 1:
            own = number[first:last]
            layer[first:last] = [int((own[:k] == own[k]).sum()) for k in range(last - first)]
    for field, depth in np.unique(np.stack([number, layer]), axis=1).T.tolist():
        inside = np.flatnonzero((number == field) & (layer == depth))
        yield Place(field, tuple(_find_runs(cause[inside], column[inside])))


def _find_runs(causes: Index, columns: Index) -> Iterator[Run]:
    """Find where causes and columns are consecutive; what is in no run stands together."""
    order = np.argsort(causes, kind="stable")
    causes, columns = causes[order], columns[order]
    is_end = (np.diff(causes) != 1) | (np.diff(columns) != 1)
    ends = np.flatnonzero(np.append(is_end, True)) + 1
    alone = np.ones(len(causes), bool)
    for start, end in pairwise([0, *ends.tolist()]):
        if end - start >= MIN_RUN:
            first, top = int(causes[start]), int(columns[start])
            yield Run(slice(first, first + end - start), slice(top, top + end - start))
            alone[start:end] = False
    if alone.any():
        yield Run(causes[alone], columns[alone])


def order_terms(terms: Sequence[Term]) -> list[Term]:
    """Order terms by place, and at a place by the number of places that share their cause.

    Then every place has its causes and its columns in long runs, which products take as they are;
    terms of several screws come last."""
    axes = {axis: k for k, axis in enumerate(AXES)}
    places: dict[Cause, int] = {}  # a bit each
    first: list[tuple[int, Cause | None]] = []
    for term in terms:
        own = [len(AXES) * screw.frame + axes[screw.axis] for screw in term.screws]
        for place, screw in zip(own, term.screws, strict=True):
            places[screw.cause] = places.get(screw.cause, 0) | 1 << place
        first.append((own[0], term.screws[0].cause) if len(own) == 1 else (LAST, None))
    rank: dict[Cause | None, tuple[int, int]] = {None: (0, 0)}
    for cause, bits in places.items():
        rank[cause] = -bits.bit_count(), bits
    keys = [(place, *rank[cause]) for place, cause in first]
    order = sorted(range(len(keys)), key=keys.__getitem__)
    return [terms[k] for k in order]


def find_fields(
    problem: Problem, terms: Sequence[Term]
) -> tuple[tuple[Term, ...], list[list[tuple[int, Cause]]]]:
    """Find the fields, as terms of unit cause, and of every term the fields and causes of its
    screws.

    Where distances are measured from one configuration to another, a cause has two values in one
    row: then every term is a field of its own."""
    if problem.origin is not None or any(not term.screws for term in terms):
        return tuple(terms), [[(k, ONE)] for k in range(len(terms))]
    places = [(frame, axis) for frame in range(1, problem.robot.n + 2) for axis in AXES]
    used = {(screw.frame, screw.axis) for term in terms for screw in term.screws}
    places = [place for place in places if place in used]
    number = {place: k for k, place in enumerate(places)}
    fields = tuple(Term(f"{axis} {frame}", (Screw(frame, axis, ONE),)) for frame, axis in places)
    screws = [[(number[s.frame, s.axis], s.cause) for s in term.screws] for term in terms]
    return fields, screws
