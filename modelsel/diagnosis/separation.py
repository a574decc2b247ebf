"""Effects and errors apart: what repeats, and what does not.

An effect that is not named yet resembles errors: a joint that yields, one that does not repeat. So
the parts of the errors are found at the base first, where they are the most that they can be, and
effects are sought given these. Then the parts are found again in what the effects leave, and in
turn, until that stays."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .._random import generator
from .._typing import Say
from ..fitting.design import Model
from ..fitting.error_structure import ErrorStructure, compute_criterion, find_structure
from ..fitting.least_squares import fit
from ..fitting.possible_parts import DIRECTIONS, PossiblePart
from ..fitting.problem import Problem
from ..mechanisms.terms import Mechanism
from ..selection.evaluation import Split
from .candidates import Candidate
from .conclusion import Conclusion, build_empty, conclude, prove
from .options import DiagnosisOptions
from .outcome import Diagnosis
from .state import Search
from .stepwise import Exploration, explore

# searches at most, each with the parts of the errors that the one before has left: where some stay,
# and where none do
MAX_SEARCHES_WITH_PARTS, MAX_SEARCHES = 2, 3


class Inquiry(NamedTuple):
    """What is asked of the rows of a split."""

    base: Model
    everything: tuple[Mechanism, ...]
    seed: int
    cells: bool
    say: Say
    options: DiagnosisOptions

    def search(self, problem: Problem, found: tuple[Candidate, ...]) -> Search:
        """Prepare the search for effects in a training problem, with the study's random stream of
        naming."""
        rng = generator(self.seed, "naming")
        base_fit = fit(problem, self.base)
        return Search(problem, self.base, found, rng, base_fit, self.options.memory_mb)


def separate(
    split: Split, inquiry: Inquiry, found: tuple[Candidate, ...], parts: tuple[PossiblePart, ...]
) -> tuple[Split, Diagnosis]:
    """Separate what repeats from what does not: effects, given the parts of the errors, and in turn.

    A joint's part that only directions tell may be an effect that is not named yet: the search
    starts without such parts. Where some stay, it starts with them, too, and of the explanations
    the criterion chooses. Returns the split, its rows weighed so that they are independent."""
    base_fit = fit(split.training(), inquiry.base)
    if not found:
        return split, build_empty(inquiry.base, base_fit)
    surer = tuple(part for part in parts if part.told_by != DIRECTIONS)
    errors = find_structure(split.problem, split.used, base_fit, surer)
    best, has_parts = _search_in_turn(split, inquiry, found, parts, errors)
    if has_parts:
        every = find_structure(split.problem, split.used, base_fit, parts)
        if any(part.told_by == DIRECTIONS for part in every.parts):
            best, _ = _search_in_turn(split, inquiry, found, parts, every, best)
    return _claim(split, parts, best)


def _search_in_turn(
    split: Split,
    inquiry: Inquiry,
    found: tuple[Candidate, ...],
    parts: tuple[PossiblePart, ...],
    errors: ErrorStructure,
    best: _Explanation | None = None,
) -> tuple[_Explanation, bool]:
    """Search for effects given parts of the errors, and with what these leave of the parts, in turn.

    What the base leaves is the most that errors can be. Where effects explain some of that away, the
    search goes on with what is left of it. Returns the explanation that the criterion chooses, `best`
    among them, and whether parts stay with the last."""
    plain, used = split.problem, split.used
    known: tuple[Candidate, ...] = ()
    has_parts = False
    for k in range(MAX_SEARCHES):
        weighed = replace(split, problem=errors.whiten(plain))
        explored = explore(inquiry.search(weighed.training(), found), known, inquiry.say)
        known = explored.chosen
        left = find_structure(plain, used, explored.fitted, parts)
        is_settled = not known or left.resembles(errors)
        most = MAX_SEARCHES_WITH_PARTS if left.shared else MAX_SEARCHES
        is_last = is_settled or k + 1 == most
        if is_last or left.shared:
            one = _explain(split, explored, parts, left)
            has_parts = bool(one.errors.shared)
            best = one if best is None or one.criterion < best.criterion else best
        if is_last:
            break
        errors = left
        del explored  # its columns, before others are made
    assert best is not None
    return best, has_parts


class _Explanation(NamedTuple):
    """Effects and the parts of the errors together, with their information criterion."""

    concluded: Conclusion
    errors: ErrorStructure
    criterion: float


def _explain(
    split: Split, explored: Exploration, parts: tuple[PossiblePart, ...], errors: ErrorStructure
) -> _Explanation:
    """Conclude a search, and put its effects and the parts that these leave together."""
    concluded = conclude(explored)
    diagnosis = concluded.diagnosis
    named = [effect.candidate for effect in diagnosis.effects]
    if len(named) != len(explored.chosen):
        errors = find_structure(split.problem, split.used, diagnosis.fit, parts)
    log_prior = sum(float(np.log(candidate.prior)) for candidate in named)
    criterion = compute_criterion(split.problem, split.used, diagnosis.fit, errors, log_prior)
    return _Explanation(concluded, errors, criterion)


def _claim(
    split: Split, parts: tuple[PossiblePart, ...], best: _Explanation
) -> tuple[Split, Diagnosis]:
    """Weigh what is proven of an explanation, and the rows by the parts that it leaves."""
    before = best.concluded.diagnosis.effects
    diagnosis, errors = prove(best.concluded), best.errors
    if [one.candidate for one in diagnosis.effects] != [one.candidate for one in before]:
        errors = find_structure(split.problem, split.used, diagnosis.fit, parts)
    weighed = replace(split, problem=errors.whiten(split.problem))
    return weighed, replace(diagnosis, errors=errors)
