"""The loop that extends a model: name, add the whole top mechanism, refit everything, name each
effect again given the others, drop what the full model no longer needs; until chance alone would
explain what is left.

A sum of single effects, each a whole candidate (grouped after Wang, Sarkar, Carbonetto & Stephens
2020, "SuSiE"); here an effect is re-named with the others fitted exactly, so that an early proxy is
found out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from .._typing import Array
from ..fitting.design import Model
from ..fitting.least_squares import STEP_MM, Fit
from ..fitting.problem import Problem
from ..fitting.shrinkage import fit_shrunk
from .candidates import Candidate
from .credible_sets import CredibleSet
from .evidence import compute_p_value, compute_single_f
from .state import LEVEL, MIN_LOG_ODDS, Search, View

MOST = 24  # effects
UNDONE = 0.5  # share of either of two effects below which what is left of both is said


@dataclass(frozen=True, eq=False)
class Effect:
    """One named effect of the extended model, given all the others; `p` family-wise; `cancels`:
    another one that undoes most of it, and the share of it that is left of both."""

    candidate: Candidate
    named: CredibleSet
    p: float
    estimate: Array = field(repr=False)
    standard_error: Array = field(repr=False)
    cancels: tuple[str, float] | None = None


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The extended model: effects in the order they were found, its fit, the null evidences, what
    was tried on the way; `left` names the strongest of what remains, with its p-value, whatever it
    is (None without candidates); `held_back`: its p under equal normal noise, where that would have
    named it and the residual's own signs do not; `single_f` (G,) every candidate alone on the base,
    `map_p` (G,) family-wise p of that."""

    base: Model
    effects: tuple[Effect, ...]
    model: Model
    fit: Fit
    null: Array
    path: tuple[str, ...]
    left: CredibleSet | None
    left_p: float
    held_back: float | None
    bound: float
    single_f: Array = field(repr=False)
    map_p: Array = field(repr=False)


def run_stepwise_search(
    problem: Problem,
    base: Model,
    base_fit: Fit,
    found: tuple[Candidate, ...],
    rng: np.random.Generator,
    say: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Extend the base on a training problem by what the candidates explain beyond chance, one named
    effect at a time."""
    if not found:
        return Diagnosis(
            base,
            (),
            base,
            base_fit,
            np.zeros(0),
            (),
            None,
            1.0,
            None,
            np.inf,
            np.zeros(0),
            np.zeros(0),
        )
    search = Search(problem, base, found, rng, base_fit)
    chosen: list[int] = []
    path: list[str] = []
    tried: set[frozenset[int]] = {frozenset()}
    view, settled_all = search.first, False
    while True:
        left = search.next(view, chosen)
        left_p, held_back = compute_p_value(left.evidence, search.null), None
        new = _untried(search, left, view, chosen, tried)
        if new is not None and (by_signs := search.by_signs(view, chosen, left.evidence)) > LEVEL:
            new, left_p, held_back = None, by_signs, left_p
        if new is None or len(chosen) >= MOST:
            if settled_all:
                break
            before = list(
                chosen
            )  # nothing more to add: every effect is named once more, and what that frees, too
            chosen, view = settle(search, chosen, view, None, path)
            tried.add(frozenset(chosen))
            settled_all = True
            if set(chosen) == set(before):
                break
            continue
        trial = search.joined(chosen, new)
        path.append(f"+ {found[new].label}")
        say(f"found {found[new].label}")
        first = search.attempt(trial, view.fitted)
        if (
            first is None
            or search.unbounded(new, first)
            or not (set(np.flatnonzero(first.own(found[new]))) & set(first.fitted.found.kept))
        ):
            tried.add(frozenset(trial))  # it adds nothing that the fit could determine
            path.pop()
            continue
        steps: list[str] = []
        settled, after = settle(search, trial, first, view, steps)
        if (
            frozenset(settled) in tried
        ):  # re-naming would go in a circle: the addition stays as it is
            settled, after, steps = trial, first, []
        chosen, view, path = settled, after, path + steps
        tried |= {frozenset(trial), frozenset(settled)}
    before = list(chosen)
    chosen, view = pruned(search, chosen, view, path)
    known, map_p, view = _proven(search, chosen, view, path)
    chosen = list(known)
    if chosen != before:  # what the dropped ones explained is left
        left, left_p, held_back = *_left(search, view, chosen), None
    fitted = fit_shrunk(problem, view.model, view.fitted, held="all") if chosen else view.fitted
    place = {t.key: k for k, t in enumerate(view.model.terms)}
    effects, undone = [], _undone(search, chosen, view)
    for g, p in known.items():
        (one, _), at = search.again(g, view), [place[t.key] for t in found[g].mechanism.terms]
        effects.append(
            Effect(found[g], one, p, fitted.theta[at], fitted.standard_errors[at], undone.get(g))
        )
    return Diagnosis(
        base,
        tuple(effects),
        view.model,
        fitted,
        search.null,
        tuple(path),
        left,
        left_p,
        held_back,
        search.bound,
        compute_single_f(search.first.seen, search.first.r),
        map_p,
    )


def _left(search: Search, view: View, chosen: Sequence[int]) -> tuple[CredibleSet, float]:
    """The strongest of what a model leaves, and its p."""
    left = search.next(view, chosen)
    p = compute_p_value(left.evidence, search.null)
    return left, p if p > LEVEL else max(p, search.by_signs(view, chosen, left.evidence))


def _undone(search: Search, chosen: Sequence[int], view: View) -> dict[int, tuple[str, float]]:
    """Effects of which another one takes back more than half at the target: (its label, the share
    that is left of both)."""
    moved = {g: search.displacement(g, view) for g in chosen}
    size = {g: float(np.linalg.norm(d)) for g, d in moved.items()}
    out: dict[int, tuple[str, float]] = {}
    for g in chosen:
        rest = [
            (float(np.linalg.norm(moved[g] + moved[h])) / min(size[g], size[h]), h)
            for h in chosen
            if h != g and min(size[g], size[h]) > 0
        ]
        if rest and min(rest)[0] < UNDONE:
            share, other = min(rest)
            out[g] = (search.found[other].label, share)
    return out


def _proven(
    search: Search, chosen: list[int], view: View, path: list[str]
) -> tuple[dict[int, float], Array, View]:
    """(p of every effect that chance does not explain, given the others, by any null; the map's p;
    the model's view): an effect that passed when it came may fail once the others stand, and goes,
    the weakest first; one that stands alone was asked when it came."""
    while True:
        if chosen:
            view = (
                search.attempt(chosen, view.fitted, STEP_MM) or view
            )  # to the last tenth of a micrometre, where it settles
        nothing, map_p = search.by_chance(view)
        known = {
            g: max(compute_p_value(search.again(g, view)[1], some) for some in nothing)
            for g in chosen
        }
        weakest = max(chosen, key=lambda g: known[g], default=-1)
        if (
            len(chosen) < 2
            or known[weakest] <= LEVEL
            or (after := search.attempt([g for g in chosen if g != weakest], view.fitted)) is None
        ):
            return known, map_p, view
        path.append(f"- {search.found[weakest].label}")
        chosen, view = [g for g in chosen if g != weakest], after


def _untried(
    search: Search, left: CredibleSet, view: View, chosen: Sequence[int], tried: set[frozenset[int]]
) -> int | None:
    """The most probable explanation beyond chance whose addition gives a model not seen before."""
    blocked = list(chosen)
    for _ in range(ROUNDS):
        if compute_p_value(left.evidence, search.null) > LEVEL:
            break
        if frozenset(search.joined(chosen, left.top)) not in tried:
            return left.top
        blocked.append(left.top)
        left = search.next(view, blocked)
    return None


# Effects named again: where a newcomer moved them, what it frees, and which of them chance alone
# would explain.

ROUNDS = 16
SHIFT = (
    0.1  # share of an effect's displacement that a newcomer must change for it to be named again
)


def pruned(
    search: Search, chosen: list[int], view: View, path: list[str]
) -> tuple[list[int], View]:
    """Without the effects whose size the others leave open, and those that chance alone would
    explain; the weakest first."""
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
        if (
            compute_p_value(own[weakest], search.null) <= LEVEL
            or (after := search.attempt(rest, view.fitted)) is None
        ):
            break
        path.append(f"- {search.found[weakest].label}")
        chosen, view = rest, after
    return chosen, view


def _moved(before: View, after: View, candidate: Candidate) -> bool:
    """Whether a newcomer changed what an effect does to the target by more than a tenth."""
    old = dict(zip((t.key for t in before.model.terms), before.fitted.theta, strict=True))
    own = np.flatnonzero(after.own(candidate))
    moves = after.A[: after.seen.columns.XT.shape[1], own]
    now = moves @ after.fitted.theta[own]
    change = moves @ (
        after.fitted.theta[own] - [old.get(after.model.terms[k].key, 0.0) for k in own]
    )
    return float(np.linalg.norm(change)) > SHIFT * float(np.linalg.norm(now))


def settle(
    search: Search, chosen: list[int], view: View, before: View | None, path: list[str]
) -> tuple[list[int], View]:
    """Name again, given the others, every effect that the newcomer moved (all, where nothing stood
    before), until the names stay; drop what is no longer needed. One change at a time, the weakest
    first; what a change did not move keeps its name."""
    visited = {frozenset(chosen)}
    known: dict[
        int, tuple[float, int]
    ] = {}  # effect -> (evidence for itself, its better name or -1 or itself)
    if before is not None:
        known = {g: (np.inf, g) for g in chosen if not _moved(before, view, search.found[g])}
    for _ in range(ROUNDS):
        for g in chosen:
            if g not in known:
                named, own = search.again(g, view)
                odds = named.log_probability[named.top] - named.log_probability[g]
                better = (
                    -1
                    if compute_p_value(own, search.null) > LEVEL
                    else named.top
                    if odds > MIN_LOG_ODDS
                    else g
                )
                known[g] = (own, better)
        change = next(
            (
                (g, trial)
                for _, g in sorted((known[g][0], g) for g in chosen if known[g][1] != g)
                if frozenset(trial := _replaced(search, chosen, g, known[g][1])) not in visited
            ),
            None,
        )
        if change is not None:
            g, trial = change
            old, new = search.found[g].label, known[g][1]
            said = f"- {old}" if len(trial) < len(chosen) else f"{old} -> {search.found[new].label}"
        else:
            redrawn = next(
                (one for one in search.redrawn(chosen, view) if frozenset(one[0]) not in visited),
                None,
            )
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
        known = {
            k: known[k] for k in trial if k in known and not _moved(view, after, search.found[k])
        }
        chosen, view = trial, after
    return chosen, view


def _replaced(search: Search, chosen: Sequence[int], old: int, new: int) -> list[int]:
    """Without one effect, or with a better name for it."""
    rest = [g for g in chosen if g != old]
    return rest if new < 0 or new in rest else search.joined(rest, new)
