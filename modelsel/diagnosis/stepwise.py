"""Stepwise search: add the strongest explanation, refit, identify the effects again, drop what is
not needed.

A model is a sum of single effects, each a whole candidate (after the sum of single effects of Wang,
Sarkar, Carbonetto & Stephens 2020, "SuSiE"). Here an effect is identified again with the others
fitted exactly, so that a proxy which was named early gives way to the cause. The search ends when
chance alone would explain what is left."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from .._progress import News
from .._typing import Array, Say
from ..fitting.design import Model
from ..fitting.least_squares import STEP_MM, Fit
from ..fitting.shrinkage import fit_shrunk
from .candidates import Candidate
from .claims import weigh_claims
from .credible_sets import CredibleSet
from .effects import Claim, Effect
from .evidence import compute_p_value, compute_single_f
from .outcome import Diagnosis
from .renaming import settle_names
from .state import LEVEL, Search, View

# effects in a model
MAX_EFFECTS = 24
# explanations that are tried in turn when the most probable one was tried before
MAX_TRIED = 16
# times that shapes which no list has are offered
MAX_OFFERS = 2
# share of either of two effects below which what is left of both is reported
MAX_CANCELLED = 0.5


class _Remainder(NamedTuple):
    """The strongest explanation of what a model leaves, with its p-value.

    `held_back`: its p-value under equal normal noise where only that would have named it."""

    strongest: CredibleSet
    p: float
    held_back: float | None = None


@dataclass
class _Progress:
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
    progress: _Progress
    remainder: _Remainder

    @property
    def chosen(self) -> tuple[Candidate, ...]:
        """The candidates that were added."""
        return tuple(self.search.found[g] for g in self.progress.chosen)

    @property
    def fitted(self) -> Fit:
        """The base with these, fitted."""
        return self.progress.view.fitted


def explore(search: Search, known: Sequence[Candidate], say: Say) -> Exploration:
    """Add effects to the base, or to candidates that an earlier search has chosen."""
    progress = _resume(search, known)
    remainder = _add_effects(search, progress, say)
    return Exploration(search, progress, remainder)


def _resume(search: Search, known: Sequence[Candidate]) -> _Progress:
    """Start from the base, or from candidates that are known where the data determine them."""
    place = {one.mechanism.name: g for g, one in enumerate(search.found)}
    chosen = [place[one.mechanism.name] for one in known]
    view = search.try_fit(chosen, None) if chosen else None
    if view is None:
        return _Progress([], search.first)
    tried = {frozenset[int](), frozenset(chosen)}
    path = [f"+ {search.found[g].label}" for g in chosen]
    return _Progress(chosen, view, path, tried)


def build_empty(base: Model, base_fit: Fit) -> Diagnosis:
    """Build the diagnosis without candidates: nothing may extend the base."""
    nothing = np.zeros(0)
    return Diagnosis(
        base=base,
        effects=(),
        model=base,
        fit=base_fit,
        null=nothing,
        path=(),
        left=None,
        left_p=1.0,
        held_back=None,
        bound=np.inf,
        single_f=nothing,
        map_p=nothing,
    )


# Add: the strongest explanation of the residual, as long as chance does not explain it.


def _add_effects(search: Search, progress: _Progress, say: Say) -> _Remainder:
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


def _find_next(search: Search, progress: _Progress) -> tuple[_Remainder, int | None]:
    """Find the candidate to add next; None where chance, under either null, explains the rest."""
    view = progress.view
    chosen = progress.chosen
    strongest = search.name_strongest(view, chosen)
    evidence = strongest.evidence
    p = compute_p_value(evidence, search.null)
    remainder = _Remainder(strongest, p)
    new = _find_untried(search, strongest, progress)
    if new is None:
        return remainder, None
    p_by_signs = search.compute_sign_p(view, chosen, evidence)
    if p_by_signs > LEVEL:
        held_back = _Remainder(strongest, p_by_signs, held_back=p)
        return held_back, None
    return remainder, new


def _find_untried(search: Search, strongest: CredibleSet, progress: _Progress) -> int | None:
    """Find the most probable explanation beyond chance whose addition gives a new model."""
    blocked = list(progress.chosen)
    for _ in range(MAX_TRIED):
        if compute_p_value(strongest.evidence, search.null) > LEVEL:
            break
        trial = search.add(progress.chosen, strongest.top)
        if frozenset(trial) not in progress.tried:
            return strongest.top
        blocked.append(strongest.top)
        strongest = search.name_strongest(progress.view, blocked)
    return None


def _add_effect(search: Search, progress: _Progress, new: int, say: Say) -> None:
    """Add a candidate, refit, and identify again the effects that it moved.

    What the fit cannot determine is not added."""
    label = search.found[new].label
    say(News(f"found {label}", kept=True))
    trial = search.add(progress.chosen, new)
    view = search.try_fit(trial, progress.view.fitted)
    if view is None or not _is_determined(search, new, view):
        progress.tried.add(frozenset(trial))
        return
    steps: list[str] = []
    settled, settled_view = settle_names(search, trial, view, progress.view, steps)
    goes_in_circle = frozenset(settled) in progress.tried
    if goes_in_circle:
        settled = trial
        settled_view = view
        steps = []
    progress.tried |= {frozenset(trial), frozenset(settled)}
    progress.chosen = settled
    progress.view = settled_view
    progress.path += [f"+ {label}", *steps]


def _is_determined(search: Search, g: int, view: View) -> bool:
    """Return whether a fit determines an effect.

    Then its size is bounded, and one of its terms is not covered by others."""
    candidate = search.found[g]
    is_own = view.mask_terms(candidate)
    own = np.flatnonzero(is_own)
    kept = view.fitted.found.kept
    if set(own).isdisjoint(kept):
        return False
    return not search.is_unbounded(g, view)


def _identify_all(search: Search, progress: _Progress) -> bool:
    """Identify every effect again; returns whether the set of effects changed."""
    before = set(progress.chosen)
    progress.chosen, progress.view = settle_names(
        search, progress.chosen, progress.view, None, progress.path
    )
    after = set(progress.chosen)
    progress.tried.add(frozenset(after))
    return after != before


# Drop: effects whose size stays open, and those that chance explains given the others.


def prune_effects(
    search: Search, chosen: list[int], view: View, path: list[str]
) -> tuple[list[int], View]:
    """Drop the effects that the others make dispensable, the weakest first.

    Such are those whose size the others leave open, and those that chance alone would explain."""
    while chosen:
        g = _find_dispensable(search, chosen, view)
        if g is None:
            break
        rest = [k for k in chosen if k != g]
        after = search.try_fit(rest, view.fitted)
        if after is None:
            break
        path.append(f"- {search.found[g].label}")
        chosen = rest
        view = after
    return chosen, view


def _find_dispensable(search: Search, chosen: Sequence[int], view: View) -> int | None:
    for g in reversed(chosen):
        if search.is_unbounded(g, view):
            return g
    evidence = {g: search.rename(g, view).evidence for g in chosen}
    weakest = min(chosen, key=lambda g: evidence[g])
    p = compute_p_value(evidence[weakest], search.null)
    if p > LEVEL:
        return weakest
    return None


def _confirm_effects(
    search: Search, chosen: list[int], view: View, path: list[str]
) -> tuple[dict[int, float], Array, View]:
    """Confirm every effect given the others, under every null.

    Returns p of every effect that stays, the map's family-wise p (G,), and the model's view.

    An effect that passed when it came may fail once the others stand, and is dropped, the weakest
    first; one that stands alone was tested when it came."""
    while True:
        if chosen:
            refitted = search.try_fit(chosen, view.fitted, STEP_MM)
            view = refitted or view
        evidence = {g: search.rename(g, view).evidence for g in chosen}
        nulls, map_p = search.draw_final_nulls(view, min(evidence.values(), default=np.inf))
        p = {g: _compute_largest_p(evidence[g], nulls) for g in chosen}
        if len(chosen) < 2:
            return p, map_p, view
        weakest = max(chosen, key=lambda g: p[g])
        if p[weakest] <= LEVEL:
            return p, map_p, view
        rest = [g for g in chosen if g != weakest]
        after = search.try_fit(rest, view.fitted)
        if after is None:
            return p, map_p, view
        label = search.found[weakest].label
        path.append(f"- {label}")
        chosen = rest
        view = after


def _compute_largest_p(evidence: float, nulls: Sequence[Array]) -> float:
    return max(compute_p_value(evidence, null) for null in nulls)


# Conclude: the final fit, its effects, and what is left.


class _Settled(NamedTuple):
    """What stays of a search: its effects with their p-values, the map's p-values, and the view."""

    p: dict[int, float]
    map_p: Array
    view: View

    @property
    def chosen(self) -> list[int]:
        """The candidates that stay."""
        return list(self.p)


def conclude(explored: Exploration) -> Diagnosis:
    """Drop what the full model does not need, weigh how much of every effect is proven, and put the
    diagnosis together.

    Where a shape that no list has explains effects better, the search goes on with it."""
    settled = _settle(explored)
    weighed = weigh_claims(explored.search, settled.view, settled.chosen)
    for _ in range(MAX_OFFERS):
        if not weighed.better:
            break
        explored = _take_shapes(explored, settled, weighed.better)
        settled = _settle(explored)
        weighed = weigh_claims(explored.search, settled.view, settled.chosen)
    return _build_diagnosis(explored, settled, weighed.claims)


def _settle(explored: Exploration) -> _Settled:
    """Drop the effects that the full model does not need, and confirm the others."""
    search, progress = explored.search, explored.progress
    chosen, view = prune_effects(search, progress.chosen, progress.view, progress.path)
    return _Settled(*_confirm_effects(search, chosen, view, progress.path))


def _take_shapes(
    explored: Exploration, settled: _Settled, better: Sequence[tuple[tuple[int, ...], Candidate]]
) -> Exploration:
    """Put shapes that no list has in the place of effects, and let the search go on.

    An effect that has given way to one shape does not give way to another."""
    before, chosen, path = explored.search, settled.chosen, list(explored.progress.path)
    shapes: list[Candidate] = []
    for members, shape in better:
        if set(members) <= set(chosen):
            left = " & ".join(before.found[g].label for g in members)
            path.append(f"{left} -> {shape.label}")
            chosen = [g for g in chosen if g not in members]
            shapes.append(shape)
    search = before.offer(shapes)
    chosen += range(len(before.found), len(search.found))
    view = search.try_fit(chosen, settled.view.fitted)
    if view is None:
        return replace(explored, search=before)
    progress = _Progress(chosen, view, path, {frozenset[int](), frozenset(chosen)})
    return Exploration(search, progress, _add_effects(search, progress, _keep_silent))


def _keep_silent(_: str) -> None:
    """Say nothing of what is only put in other words."""


def _build_diagnosis(
    explored: Exploration, settled: _Settled, claims: Mapping[int, Claim]
) -> Diagnosis:
    """Fit the model exactly, and put the diagnosis together."""
    search, progress, remainder = explored.search, explored.progress, explored.remainder
    view, chosen = settled.view, settled.chosen
    if chosen != progress.chosen:
        remainder = _assess_remainder(search, view, chosen)
    fitted = view.fitted
    if chosen:
        fitted = fit_shrunk(search.problem, view.model, view.fitted, held="all")
    return Diagnosis(
        base=search.base,
        effects=_build_effects(search, view, fitted, settled.p, claims),
        model=view.model,
        fit=fitted,
        null=search.null,
        path=tuple(progress.path),
        left=remainder.strongest,
        left_p=remainder.p,
        held_back=remainder.held_back,
        bound=search.bound,
        single_f=compute_single_f(search.first.scan, search.first.response),
        map_p=settled.map_p,
        offered=search.found,
    )


def _assess_remainder(search: Search, view: View, chosen: Sequence[int]) -> _Remainder:
    """Assess the strongest explanation of what a model leaves, under both nulls."""
    strongest = search.name_strongest(view, chosen)
    evidence = strongest.evidence
    p = compute_p_value(evidence, search.null)
    if p <= LEVEL:
        p_by_signs = search.compute_sign_p(view, chosen, evidence)
        p = max(p, p_by_signs)
    return _Remainder(strongest, p)


def _build_effects(
    search: Search, view: View, fitted: Fit, p: dict[int, float], claims: Mapping[int, Claim]
) -> tuple[Effect, ...]:
    cancelled = _find_cancelling(search, list(p), view)
    effects = []
    for g, p_value in p.items():
        terms = search.locate_terms(g, view)
        effect = Effect(
            candidate=search.found[g],
            named=search.rename(g, view).named,
            p=p_value,
            estimate=fitted.theta[terms],
            standard_error=fitted.standard_errors[terms],
            cancels=cancelled.get(g),
            claim=claims.get(g),
        )
        effects.append(effect)
    return tuple(effects)


def _find_cancelling(
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
            label = search.found[other].label
            cancelled[g] = (label, share)
    return cancelled
