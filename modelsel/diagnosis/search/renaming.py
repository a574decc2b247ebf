"""Identify effects again: which effects a new one moved, and whether their names still hold."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from ..candidates.candidate import Candidate
from ..inference.evidence import MIN_LOG_ODDS, compute_p_value
from .mechanism_families import generate_better_families
from .path_sentences import DROPPED
from .state import LEVEL, Search
from .views import View

# changes of names that are tried in turn
MAX_CHANGES = 16
# share of an effect's displacement that a new effect must change for it to be identified again
MIN_CHANGE = 0.1


class _Standing(NamedTuple):
    """Where an effect stands given the others.

    `evidence`: the log evidence for it, infinite for one that has not moved; `better`: the candidate
    that should stand in its place: itself, a better name, or None if chance explains it."""

    evidence: float
    better: int | None


class _Change(NamedTuple):
    """A change of names to try.

    `effect`: the effect it concerns (None for several effects of one joint); `trial`: the
    candidates after it; `words`: what it is in words."""

    effect: int | None
    trial: list[int]
    words: str


def settle_names(
    search: Search, chosen: list[int], view: View, before: View | None, path: list[str]
) -> tuple[list[int], View]:
    """Identify effects again, given the others, until their names stay.

    Effects that chance explains are dropped.

    Concerns the effects that changed since the view `before` (all, where that is None). One change
    at a time is made, the weakest effect first, and a change concerns only the effects that it
    moves. Returns the candidates and their view; appends the changes to `path`."""
    visited = {frozenset(chosen)}
    standing: dict[int, _Standing] = {}
    if before is not None:
        for g in chosen:
            if not _has_moved(before, view, search.candidates[g]):
                standing[g] = _Standing(np.inf, g)
    for _ in range(MAX_CHANGES):
        for g in chosen:
            if g not in standing:
                standing[g] = _assess(search, g, view)
        change = _find_change(search, chosen, view, standing, visited)
        if change is None:
            break
        visited.add(frozenset(change.trial))
        after = search.try_fit(change.trial, view.fitted)
        if after is None:
            if change.effect is not None:
                refused = standing[change.effect]
                standing[change.effect] = refused._replace(better=change.effect)
            continue
        path.append(change.words)
        standing = {
            g: standing[g]
            for g in change.trial
            if g in standing and not _has_moved(view, after, search.candidates[g])
        }
        chosen = change.trial
        view = after
    return chosen, view


def _has_moved(before: View, after: View, candidate: Candidate) -> bool:
    """Return whether an effect at the target changed by more than MIN_CHANGE between two fits."""
    own = np.flatnonzero(after.mask_terms(candidate))
    theta = after.fitted.theta[own]
    terms = after.model.terms
    places = [before.places.get(terms[k].key) for k in own]
    theta_before = before.fitted.theta
    previous = [0.0 if place is None else theta_before[place] for place in places]
    change = float(np.linalg.norm(after.A.move(own, theta - previous)))
    size = float(np.linalg.norm(after.A.move(own, theta)))
    return change > MIN_CHANGE * size


def _assess(search: Search, g: int, view: View) -> _Standing:
    """Assess an effect given the others: whether chance explains it, or another name better."""
    renamed = search.rename(g, view)
    evidence = renamed.evidence
    p = compute_p_value(evidence, search.null)
    if p > LEVEL:
        return _Standing(evidence, None)
    if holds_name(search, g, view):
        return _Standing(evidence, g)
    top = renamed.named.top
    return _Standing(evidence, top)


def holds_name(search: Search, g: int, view: View) -> bool:
    """Return whether no other name of an effect, given the others, is clearly more probable."""
    named = search.rename(g, view).named
    log_probability = named.log_probability
    log_odds = log_probability[named.top] - log_probability[g]
    return bool(log_odds <= MIN_LOG_ODDS)


def _find_change(
    search: Search,
    chosen: Sequence[int],
    view: View,
    standing: dict[int, _Standing],
    visited: set[frozenset[int]],
) -> _Change | None:
    """Find the first change that gives a new set of candidates.

    Single effects change first, the weakest before the others, then the effects of one joint, or of
    one family, together."""
    changing = [g for g in chosen if standing[g].better != g]
    changing.sort(key=lambda effect: (standing[effect].evidence, effect))
    for g in changing:
        better = standing[g].better
        trial = _replace(search, chosen, g, better)
        if frozenset(trial) in visited:
            continue
        words = _describe_change(search, chosen, trial, g, better)
        return _Change(effect=g, trial=trial, words=words)
    moved = [g for g in chosen if standing[g].evidence < np.inf]
    together = (
        search.generate_better_curves(chosen, view, moved),
        generate_better_families(search, chosen, view),
    )
    for trial, words in chain.from_iterable(together):
        if frozenset(trial) not in visited:
            return _Change(None, trial, words)
    return None


def _replace(search: Search, chosen: Sequence[int], old: int, new: int | None) -> list[int]:
    """Remove an effect, or put a better name in its place."""
    rest = [g for g in chosen if g != old]
    return rest if new is None or new in rest else search.add(rest, new)


def _describe_change(
    search: Search, chosen: Sequence[int], trial: Sequence[int], old: int, new: int | None
) -> str:
    label = search.candidates[old].label
    if new is None or len(trial) < len(chosen):
        return f"{DROPPED}{label}"
    return f"{label} -> {search.candidates[new].label}"
