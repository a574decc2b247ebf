"""Effects that are dropped again: those whose size the others leave open, and those that chance explains given the
others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..._typing import Array
from ...fitting.least_squares import STEP_MM
from ..inference.evidence import compute_p_value
from .path_sentences import DROPPED
from .state import LEVEL, Search
from .views import View


def prune_effects(
    search: Search, chosen: list[int], view: View, path: list[str]
) -> tuple[list[int], View]:
    """Drop the effects that the others make dispensable, the weakest first.

    That are effects whose size the others leave open, and effects that chance alone would explain."""
    while chosen:
        g = _find_dispensable(search, chosen, view)
        if g is None:
            break
        rest = [k for k in chosen if k != g]
        after = search.try_fit(rest, view.fitted)
        if after is None:
            break
        path.append(f"{DROPPED}{search.candidates[g].label}")
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


def confirm_effects(
    search: Search, chosen: list[int], view: View, path: list[str]
) -> tuple[dict[int, float], View]:
    """Confirm every effect given the others, under every null distribution.

    An effect that was significant when it was added may not be beside the others; such effects are
    dropped, the weakest first. A single effect was tested when it was added. Returns the p-value of
    every effect that stays, and the model's view."""
    while True:
        if chosen:
            refitted = search.try_fit(chosen, view.fitted, STEP_MM)
            view = refitted or view
        evidence = {g: search.rename(g, view).evidence for g in chosen}
        nulls = search.draw_final_nulls(view, min(evidence.values(), default=np.inf))
        p = {g: _compute_largest_p(evidence[g], nulls) for g in chosen}
        if len(chosen) < 2:
            return p, view
        weakest = max(chosen, key=lambda g: p[g])
        if p[weakest] <= LEVEL:
            return p, view
        rest = [g for g in chosen if g != weakest]
        after = search.try_fit(rest, view.fitted)
        if after is None:
            return p, view
        label = search.candidates[weakest].label
        path.append(f"{DROPPED}{label}")
        chosen = rest
        view = after


def _compute_largest_p(evidence: float, nulls: Sequence[Array]) -> float:
    return max(compute_p_value(evidence, null) for null in nulls)
