"""Effects named again: where a newcomer moved them, what it frees, and which of them chance alone would explain."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..which.candidates import Candidate
from .evidence import p_value
from .search import BETTER, LEVEL, Search
from .view import View

ROUNDS = 16
SHIFT = 0.1         # share of an effect's displacement that a newcomer must change for it to be named again


def pruned(search: Search, chosen: list[int], view: View, path: list[str]) -> tuple[list[int], View]:
    """Without the effects whose size the others leave open, and those that chance alone would explain; the weakest first."""
    while chosen:
        wild = next((g for g in reversed(chosen) if search.unbounded(g, view)), None)
        if wild is not None:
            rest = [g for g in chosen if g != wild]
            after = search.attempt(rest, view.fitted)
            if after is None:
                break
            path.append(f"- {search.found[wild].label}")
            chosen, view = rest, after
            continue
        own = {g: search.again(g, view)[1] for g in chosen}
        weakest = min(chosen, key=lambda g: own[g])
        rest = [g for g in chosen if g != weakest]
        if p_value(own[weakest], search.null) <= LEVEL or (after := search.attempt(rest, view.fitted)) is None:
            break
        path.append(f"- {search.found[weakest].label}")
        chosen, view = rest, after
    return chosen, view


def _moved(before: View, after: View, candidate: Candidate) -> bool:
    """Whether a newcomer changed what an effect does to the target by more than a tenth."""
    old = dict(zip((t.screws for t in before.model.terms), before.fitted.theta, strict=True))
    own = np.flatnonzero(after.own(candidate))
    moves = after.A[:after.seen.columns.XT.shape[1], own]
    now = moves @ after.fitted.theta[own]
    change = moves @ (after.fitted.theta[own] - [old.get(after.model.terms[k].screws, 0.0) for k in own])
    return float(np.linalg.norm(change)) > SHIFT * float(np.linalg.norm(now))


def settle(search: Search, chosen: list[int], view: View, before: View | None, path: list[str]) -> tuple[list[int], View]:
    """Name again, given the others, every effect that the newcomer moved (all, where nothing stood before), until the names
    stay; drop what is no longer needed. One change at a time, the weakest first; what a change did not move keeps its name."""
    visited = {frozenset(chosen)}
    known: dict[int, tuple[float, int]] = {}                # effect -> (evidence for itself, its better name or -1 or itself)
    if before is not None:
        known = {g: (np.inf, g) for g in chosen if not _moved(before, view, search.found[g])}
    for _ in range(ROUNDS):
        for g in chosen:
            if g not in known:
                named, own = search.again(g, view)
                odds = named.log_probability[named.top] - named.log_probability[g]
                better = -1 if p_value(own, search.null) > LEVEL else named.top if odds > BETTER else g
                known[g] = (own, better)
        change = next(((g, trial) for _, g in sorted((known[g][0], g) for g in chosen if known[g][1] != g)
                       if frozenset(trial := _replaced(search, chosen, g, known[g][1])) not in visited), None)
        if change is not None:
            g, trial = change
            old, new = search.found[g].label, known[g][1]
            said = f"- {old}" if len(trial) < len(chosen) else f"{old} -> {search.found[new].label}"
        else:
            redrawn = next((one for one in search.redrawn(chosen, view) if frozenset(one[0]) not in visited), None)
            if redrawn is None:
                break
            g, (trial, said) = -1, redrawn
        visited.add(frozenset(trial))
        after = search.attempt(trial, view.fitted)
        if after is None:
            if g >= 0:
                known[g] = (known[g][0], g)
            continue
        path.append(said)
        known = {k: known[k] for k in trial if k in known and not _moved(view, after, search.found[k])}
        chosen, view = trial, after
    return chosen, view


def _replaced(search: Search, chosen: Sequence[int], old: int, new: int) -> list[int]:
    """Without one effect, or with a better name for it."""
    rest = [g for g in chosen if g != old]
    return rest if new < 0 or new in rest else search.joined(rest, new)
