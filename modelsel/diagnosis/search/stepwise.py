"""Stepwise search: add the strongest explanation, refit, identify the effects again.

A model is a sum of single effects, each a whole candidate (after the sum of single effects of Wang,
Sarkar, Carbonetto & Stephens 2020, "SuSiE"). Here an effect is identified again with the others
fitted exactly, so that a proxy which was named early gives way to the cause. The search ends when
chance alone would explain what is left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ..._progress import News, keep_silent
from ..._typing import Say
from ...fitting.least_squares import Fit
from ..candidates.candidate import Candidate
from ..inference.credible_sets import CredibleSet, Question, compute_own_evidence
from ..inference.evidence import compute_p_value
from .renaming import settle_names
from .state import LEVEL, Search
from .views import View

# effects in a model
MAX_EFFECTS = 24
# explanations that are tried in turn when the most probable one was tried before
MAX_TRIED = 16


class Remainder(NamedTuple):
    """The strongest explanation of what a model leaves, with its p-value.

    `held_back`: its p-value under equal normal noise where only that would have named it."""

    strongest: CredibleSet
    p: float
    held_back: float | None = None


@dataclass
class SearchProgress:
    """Where the search stands.

    The chosen candidates, the view of their model, the steps so far, and the sets of candidates
    that were tried."""

    chosen: list[int]
    view: View
    path: list[str] = field(default_factory=list)
    tried: set[frozenset[int]] = field(default_factory=lambda: {frozenset()})


@dataclass(frozen=True, eq=False)
class Exploration:
    """A search that has added what chance does not explain, before anything is confirmed."""

    search: Search
    progress: SearchProgress
    remainder: Remainder

    @property
    def chosen(self) -> tuple[Candidate, ...]:
        """The candidates that were added."""
        return tuple(self.search.candidates[g] for g in self.progress.chosen)

    @property
    def fitted(self) -> Fit:
        """The base with these, fitted."""
        return self.progress.view.fitted


def explore(search: Search, known: Sequence[Candidate], say: Say) -> Exploration:
    """Add effects to the base, or to candidates that an earlier search has chosen."""
    # by mechanism: a scanned one has candidates of one name, which differ in their constant
    place = {one.mechanism: g for g, one in enumerate(search.candidates)}
    chosen = [place[one.mechanism] for one in known]
    path = [f"+ {one.label}" for one in known]
    progress = _start(search, chosen, None, path) if chosen else None
    progress = progress or SearchProgress([], search.first)
    remainder = _add_effects(search, progress, say)
    return Exploration(search, progress, remainder)


def explore_further(
    search: Search, chosen: list[int], start: Fit, path: list[str]
) -> Exploration | None:
    """Add effects to candidates that were put in the place of others; None where the data do not
    determine these."""
    progress = _start(search, chosen, start, path)
    if progress is None:
        return None
    # what is only put in other words is not news
    remainder = _add_effects(search, progress, keep_silent)
    return Exploration(search, progress, remainder)


def _start(
    search: Search, chosen: list[int], start: Fit | None, path: list[str]
) -> SearchProgress | None:
    """Start from chosen candidates; None where the data do not determine them."""
    view = search.try_fit(chosen, start)
    if view is None:
        return None
    tried = {frozenset[int](), frozenset(chosen)}
    return SearchProgress(chosen, view, path, tried)


class _Added(NamedTuple):
    """The candidates and the view after a step, and what was named again in words."""

    chosen: list[int]
    view: View
    steps: list[str]


# Add: the strongest explanation of the residual, as long as chance does not explain it.


def _add_effects(search: Search, progress: SearchProgress, say: Say) -> Remainder:
    """Add effects until chance explains what is left, and return that.

    When nothing more is to be added, every effect is identified again once, and the search goes on
    if that changed the model."""
    identified_all = False
    while True:
        remainder, new = _find_next(search, progress)
        if new is not None and len(progress.chosen) < MAX_EFFECTS:
            _add_effect(search, progress, new, say)
        elif identified_all or not _identify_all(search, progress):
            return remainder
        else:
            identified_all = True


def _find_next(search: Search, progress: SearchProgress) -> tuple[Remainder, int | None]:
    """Find the candidate to add next; None where chance, under either null, explains the rest."""
    view = progress.view
    chosen = progress.chosen
    question = search.ask_rest(view)
    strongest = question.answer(search.list_set_aside(chosen))
    evidence = strongest.evidence
    p = compute_p_value(evidence, search.null)
    remainder = Remainder(strongest, p)
    new = _find_untried(search, question, strongest, progress)
    if new is None:
        return remainder, None
    p_by_signs = search.compute_sign_p(view, chosen, evidence)
    if p_by_signs > LEVEL:
        held_back = Remainder(strongest, p_by_signs, held_back=p)
        return held_back, None
    return remainder, new


def _find_untried(
    search: Search, question: Question, strongest: CredibleSet, progress: SearchProgress
) -> int | None:
    """Find the most probable explanation beyond chance whose addition gives a new model.

    Many weak ones may be beyond chance together: the one that is added must be so by itself, with
    others of the same effect, or it would be dropped again."""
    aside = search.list_set_aside(progress.chosen)
    for _ in range(MAX_TRIED):
        if compute_p_value(strongest.evidence, search.null) > LEVEL:
            break
        top = strongest.top
        trial = search.add(progress.chosen, top)
        own = compute_own_evidence(question, strongest, top)
        is_new = frozenset(trial) not in progress.tried
        if is_new and compute_p_value(own, search.null) <= LEVEL:
            return top
        aside = np.append(aside, top)
        strongest = question.answer(aside)
    return None


def _add_effect(search: Search, progress: SearchProgress, new: int, say: Say) -> None:
    """Add a candidate, refit, and identify again the effects that it moved.

    What the fit cannot determine is not added."""
    label = search.candidates[new].label
    trial = search.add(progress.chosen, new)
    added = _settle_added(search, progress, new, trial)
    progress.tried.add(frozenset(trial))
    if added is None:
        say(News(f"tried {label}", kept=True))
        return
    say(News(f"added {label}", kept=True))
    settled = frozenset(added.chosen)
    progress.tried.add(settled)
    progress.chosen = added.chosen
    progress.view = added.view
    progress.path.append(f"+ {label}")
    progress.path += added.steps


def _settle_added(
    search: Search, progress: SearchProgress, new: int, trial: list[int]
) -> _Added | None:
    """Fit a trial with a new candidate, and settle the names of the effects that it moved; None where it
    is not to be added."""
    before = progress.view
    view = search.try_fit(trial, before.fitted)
    if view is None or not _is_determined(search, new, view):
        return None
    steps: list[str] = []
    settled, settled_view = settle_names(search, trial, view, before, steps)
    goes_in_circle = frozenset(settled) in progress.tried
    if not goes_in_circle:
        return _Added(settled, settled_view, steps)
    if _replaces_form(search, progress.chosen, trial):
        # it is worse than the form that was there
        return None
    return _Added(trial, view, [])


def _replaces_form(search: Search, before: Sequence[int], after: Sequence[int]) -> bool:
    """Return whether what yields has another form after a step than before it."""
    left = set(after)
    forms = search.traits.forms
    replaced = [g for g in before if g not in left]
    has_form = forms[replaced] >= 0
    return bool(has_form.any())


def _is_determined(search: Search, g: int, view: View) -> bool:
    """Return whether a fit determines an effect.

    Then its size is bounded, and one of its terms is not covered by others."""
    candidate = search.candidates[g]
    is_own = view.mask_terms(candidate)
    own = np.flatnonzero(is_own)
    kept = view.fitted.found.kept
    if set(own).isdisjoint(kept):
        return False
    return not search.is_unbounded(g, view)


def _identify_all(search: Search, progress: SearchProgress) -> bool:
    """Identify every effect again; returns whether the set of effects changed."""
    before = set(progress.chosen)
    progress.chosen, progress.view = settle_names(
        search, progress.chosen, progress.view, None, progress.path
    )
    after = set(progress.chosen)
    progress.tried.add(frozenset(after))
    return after != before
