"""The screws with which a candidate moves the target, without those that hardly do.

A link that bends under the weight beyond it turns its far end about the axis of the next joint, and
about the two axes across it by a hundredth of that. It is told where it acts: at that joint. What
follows from where the target is, as errors of an instrument do, shifts all axes of one place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..._linalg import project_out
from ..._typing import Array
from ...fitting.linearisation import Linearisation
from ...fitting.problem import Problem
from ...measurements.campaign.state_names import is_where_target_is
from ...mechanisms.terms import Screw, Term, TermKey
from ..candidates.candidate import Candidate
from ..columns.candidate_columns import stack_design
from ..columns.row_blocks import split_range
from ..inference.credible_sets import ALIKE

# share of the largest motion by a screw of a term at one frame, below which another does not count:
# with and without it, the target moves alike
SMALL = float(np.sqrt(1 / ALIKE**2 - 1))
# columns that are measured at a time
PIECE = 64


def keep_acting_screws(
    problem: Problem, found: Sequence[Candidate], at: Linearisation | None, Q: Array
) -> tuple[Candidate, ...]:
    """Return the candidates with those of their screws that move the target.

    Of a term's screws at one frame those are left out that move it by less than SMALL of the one that
    moves it most, in the root mean square over the rows, beyond the model with the orthonormal basis
    Q (N, r): what it absorbs tells nothing of a place. `at`: the point of the parameters."""
    distinct: dict[TermKey, Term] = {}
    several: list[int] = []
    for number, candidate in enumerate(found):
        names = candidate.mechanism.names()
        if any(map(is_where_target_is, names)):
            continue
        own = [term for term in candidate.mechanism.terms if _has_several_at_one(term)]
        if own:
            several.append(number)
            distinct |= {term.key: term for term in own}
    acting = _find_acting(problem, list(distinct.values()), at, Q)
    kept = list(found)
    for number in several:
        kept[number] = _keep(found[number], acting)
    return tuple(kept)


def _has_several_at_one(term: Term) -> bool:
    """Return whether a term has several screws at one frame."""
    count = len(term.screws)
    return count > 1 and count > len({screw.frame for screw in term.screws})


def _keep(candidate: Candidate, acting: Mapping[TermKey, tuple[Screw, ...]]) -> Candidate:
    mechanism = candidate.mechanism
    terms = [replace(term, screws=acting.get(term.key, term.screws)) for term in mechanism.terms]
    shorter = replace(mechanism, terms=tuple(terms))
    return replace(candidate, mechanism=shorter)


def _find_acting(
    problem: Problem, terms: Sequence[Term], at: Linearisation | None, Q: Array
) -> dict[TermKey, tuple[Screw, ...]]:
    """Find the acting screws of some terms."""
    alone = [Term("", (screw,)) for term in terms for screw in term.screws]
    if not alone:
        return {}
    sizes = iter(_measure_beyond(problem, alone, at, Q))
    acting: dict[TermKey, tuple[Screw, ...]] = {}
    for term in terms:
        size = {screw: next(sizes) for screw in term.screws}
        largest: dict[int, float] = {}
        for screw, own in size.items():
            largest[screw.frame] = max(own, largest.get(screw.frame, 0.0))
        acting[term.key] = tuple(s for s in term.screws if size[s] >= SMALL * largest[s.frame])
    return acting


def _measure_beyond(
    problem: Problem, terms: Sequence[Term], at: Linearisation | None, Q: Array
) -> list[float]:
    """Measure the columns of terms beyond a basis, some at a time: of all of them they would fill the
    memory."""
    sizes: list[float] = []
    for some in split_range(len(terms), PIECE):
        part = terms[some]
        columns, _ = stack_design(problem, part, at)
        beyond = project_out(columns, Q)
        lengths = np.linalg.norm(beyond, axis=0)
        own = lengths.tolist()
        sizes += own
    return sizes
