"""The loop that extends a model: name, add the whole top mechanism, refit everything, name each effect again given the
others, drop what the full model no longer needs; until chance alone would explain what is left.

A sum of single effects, each a whole candidate (grouped after Wang, Sarkar, Carbonetto & Stephens 2020, "SuSiE"); here an
effect is re-named with the others fitted exactly, so that an early proxy is found out.
"""
from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..data.measurements import Index
from ..fitting.fit import STEP_MM, Fit
from ..fitting.shrink import fit_shrunk
from ..matrix.design import Model
from ..matrix.scene import Scene
from ..which.candidates import Candidate
from ..words.errors import NotEstimable
from ..words.rigid import Array
from .curves import better, curves
from .errormap import Columns, columns, flat, single_f, unflat
from .evidence import familywise, null, p_value
from .flips import LOUD, SLANTED, adjusted, flipped, flipped_p, slanted, uneven, units
from .naming import Named, name, name_again, own_evidence, with_candidate
from .view import View, models, view

MOST = 24           # effects
LEVEL = 0.05        # family-wise
BETTER = np.log(3)  # log odds at which a re-named effect changes its name
ROUNDS = 16
SHIFT = 0.1         # share of an effect's displacement that a newcomer must change for it to be named again
DRAWS = (999, 499)     # null draws for small and large studies
COARSE_MM = 1e-2        # step at which the fits on the way are good enough
LARGE = 3e6             # candidates' numbers beyond which a study is large


@dataclass(frozen=True, eq=False)
class Effect:
    """One named effect of the extended model, given all the others; `p` family-wise."""

    candidate: Candidate
    named: Named
    p: float
    estimate: Array = field(repr=False)
    standard_error: Array = field(repr=False)


@dataclass(frozen=True, eq=False)
class Extension:
    """The extended model: effects in the order they were found, its fit, the null evidences, what was tried on the way;
    `left` names the strongest of what remains, with its p-value, whatever it is (None without candidates); `held_back`: its p
    under equal normal noise, where that would have named it and the residual's own signs do not; `single_f` (G,) every candidate
    alone on the base, `map_p` (G,) family-wise p of that.
    """

    base: Model
    effects: tuple[Effect, ...]
    model: Model
    fit: Fit
    null: Array
    path: tuple[str, ...]
    left: Named | None
    left_p: float
    held_back: float | None
    bound: float
    single_f: Array = field(repr=False)
    map_p: Array = field(repr=False)


class _Search:
    """What the loop shares: the training scene, all candidates with their columns, the null of the first scan."""

    def __init__(self, scene: Scene, base: Model, found: tuple[Candidate, ...], rng: np.random.Generator, base_fit: Fit):
        self.scene, self.base, self.found, self.rng = scene, base, found, rng
        self.columns: Columns = columns(scene, found, base_fit.at())
        self.log_prior = np.log([c.prior for c in found])
        self.curves = curves(found, self.columns, self.log_prior)
        self.first = view(scene, self.columns, base, base_fit)
        self.dead = np.flatnonzero(self.first.seen.sizes == 0)      # the base has them: what a refit leaks of them is no cause
        self.null, self.least_p = null(self.first.seen, self.log_prior, DRAWS[self.columns.XT.size >= LARGE], rng)
        self.bound = float(np.quantile(self.null, 1 - LEVEL))

    def fit(self, chosen: Sequence[int], start: Fit | None, step_mm: float = COARSE_MM) -> View:
        model = models(self.base, [self.found[g] for g in chosen])
        return view(self.scene, self.columns, model, fit_shrunk(self.scene, model, start, step_mm))

    def attempt(self, chosen: Sequence[int], start: Fit | None, step_mm: float = COARSE_MM) -> View | None:
        """`fit`, or None where the data do not determine such a model."""
        try:
            return self.fit(chosen, start, step_mm)
        except NotEstimable:
            return None

    def next(self, view: View, known: Sequence[int]) -> Named:
        """What explains most of the rest; `known` candidates have had their turn (what the fit drops of theirs is no cause)."""
        return name(view.seen, self.found, view.r, np.union1d(self.dead, np.array(known, dtype=np.intp)))

    def by_signs(self, view: View, known: Sequence[int], observed: float) -> float:
        """How often the residual's own rows, signs of whole configurations changed, have as much evidence beyond the model; 0
        where they are as equal normal noise has them: the null of the first scan is exact then, and stronger."""
        log_prior = self.log_prior.copy()
        log_prior[np.union1d(self.dead, np.array(known, dtype=np.intp))] = -np.inf
        unit, e, alike = self.in_units(view)
        return 0.0 if alike else flipped_p(flipped(view.seen, log_prior, e, unit, self.rng), observed)

    def in_units(self, view: View) -> tuple[Index, Array, bool]:
        """(which rows change sign together, -1 where a row is the prior's; the adjusted residual; whether equal normal noise has
        such rows)."""
        scene = self.scene
        own, grouped = units(scene.data, view.fitted.residuals(scene)[:, :3], self.rng)
        every = np.tile(own, (1, scene.components, 1))
        measured = np.concatenate([flat(scene, rows, every[:, :, rows])[0] for rows in scene.blocks()])
        unit = np.append(measured, np.full(len(view.r) - len(measured), -1))
        e = adjusted(view.seen.Q, view.r, unit)
        total = np.bincount(measured, np.square(e[:len(measured)])).astype(float)
        alike = uneven(total, np.bincount(measured)) < LOUD and (
            scene.measured is not None or slanted(unflat(scene, e), view.seen.freedom / scene.components) > SLANTED)
        return unit, e, alike and not grouped

    def map_p(self, view: View) -> Array:
        """(G,) family-wise p of every candidate alone on the base; where what the model of `view` leaves is not as equal normal
        noise has it, no smaller than under the signs of the base's residual."""
        seen, r = self.first.seen, self.first.r
        p = familywise(seen, r, self.least_p)
        unit, _, alike = self.in_units(view)
        if alike:
            return p
        unit = unit[:len(r)]
        least = [few for _, few in flipped(seen, self.log_prior, adjusted(seen.Q, r, unit), unit, self.rng)]
        return np.maximum(p, familywise(seen, r, np.sort(np.concatenate(least))))

    def again(self, g: int, view: View) -> tuple[Named, float]:
        """Effect g given the others: (named again, the evidence for itself or its like)."""
        if g not in view.asked:
            seen, y = view.without(self.found[g])
            named = name_again(seen, self.found, g, y, self.dead)
            view.asked[g] = with_candidate(named, seen, self.found, g, y), own_evidence(seen, named, g, y)
        return view.asked[g]

    def redrawn(self, chosen: Sequence[int], view: View) -> Iterator[tuple[list[int], str]]:
        """(models in which a joint's own-angle effects are explained better together, what changed)."""
        for curve in self.curves.values():
            now = [g for g in chosen if g in curve.which]
            if not now:
                continue
            D, response = view.freed(*(self.found[g] for g in now))
            best = better(curve, view.Q - D @ (D.T @ view.Q), response, now, BETTER)
            if best is not None:
                names = (" & ".join(self.found[g].mechanism.name for g in some) for some in (now, best))
                yield [*(g for g in chosen if g not in now), *best], " -> ".join(names)

    def joined(self, chosen: Sequence[int], g: int) -> list[int]:
        """With candidate g; a finer free function of a joint takes the place of a coarser one."""
        def subject(k: int) -> object:
            mechanism = self.found[k].mechanism
            return mechanism.terms[0].screws[0].frame if mechanism.name.startswith("free(") else (k,)
        return [*(k for k in chosen if subject(k) != subject(g)), g]


def extend(scene: Scene, base: Model, base_fit: Fit, found: tuple[Candidate, ...], rng: np.random.Generator,
           say: Callable[[str], None] = lambda _: None) -> Extension:
    """Extend the base on a training scene by what the candidates explain beyond chance, one named effect at a time."""
    if not found:
        return Extension(base, (), base, base_fit, np.zeros(0), (), None, 1.0, None, np.inf, np.zeros(0), np.zeros(0))
    search = _Search(scene, base, found, rng, base_fit)
    chosen: list[int] = []
    path: list[str] = []
    tried: set[frozenset[int]] = {frozenset()}
    view, settled_all = search.first, False
    while True:
        left = search.next(view, chosen)
        left_p, held_back = p_value(left.evidence, search.null), None
        new = _untried(search, left, view, chosen, tried)
        if new is not None and (by_signs := search.by_signs(view, chosen, left.evidence)) > LEVEL:
            new, left_p, held_back = None, by_signs, left_p
        if new is None or len(chosen) >= MOST:
            if settled_all:
                break
            before = list(chosen)           # nothing more to add: every effect is named once more, and what that frees, too
            chosen, view = _settle(search, chosen, view, None, path)
            tried.add(frozenset(chosen))
            settled_all = True
            if set(chosen) == set(before):
                break
            continue
        trial = search.joined(chosen, new)
        path.append(f"+ {found[new].label}")
        say(f"found {found[new].label}")
        first = search.attempt(trial, view.fitted)
        if first is None or not set(np.flatnonzero(first.own(found[new]))) & set(first.fitted.found.kept):
            tried.add(frozenset(trial))      # it adds nothing that the fit could determine
            path.pop()
            continue
        steps: list[str] = []
        settled, after = _settle(search, trial, first, view, steps)
        if frozenset(settled) in tried:      # re-naming would go in a circle: the addition stays as it is
            settled, after, steps = trial, first, []
        chosen, view, path = settled, after, path + steps
        tried |= {frozenset(trial), frozenset(settled)}
    chosen, view = _pruned(search, chosen, view, path)
    if chosen:
        view = search.attempt(chosen, view.fitted, STEP_MM) or view       # to the last tenth of a micrometre, where it settles
    place = {t.screws: k for k, t in enumerate(view.model.terms)}
    effects = []
    for g in chosen:
        (one, own), at = search.again(g, view), [place[t.screws] for t in found[g].mechanism.terms]
        effects.append(Effect(found[g], one, p_value(own, search.null), view.fitted.theta[at],
                              view.fitted.standard_errors[at]))
    return Extension(base, tuple(effects), view.model, view.fitted, search.null, tuple(path), left, left_p, held_back,
                     search.bound, single_f(search.first.seen, search.first.r),
                     search.map_p(view))


def _untried(search: _Search, left: Named, view: View, chosen: Sequence[int], tried: set[frozenset[int]]) -> int | None:
    """The most probable explanation beyond chance whose addition gives a model not seen before."""
    blocked = list(chosen)
    for _ in range(ROUNDS):
        if p_value(left.evidence, search.null) > LEVEL:
            break
        if frozenset(search.joined(chosen, left.top)) not in tried:
            return left.top
        blocked.append(left.top)
        left = search.next(view, blocked)
    return None


def _pruned(search: _Search, chosen: list[int], view: View, path: list[str]) -> tuple[list[int], View]:
    """Without the effects that chance alone would explain, given the others; the weakest first."""
    while chosen:
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


def _settle(search: _Search, chosen: list[int], view: View, before: View | None, path: list[str]) -> tuple[list[int], View]:
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


def _replaced(search: _Search, chosen: Sequence[int], old: int, new: int) -> list[int]:
    """Without one effect, or with a better name for it."""
    rest = [g for g in chosen if g != old]
    return rest if new < 0 or new in rest else search.joined(rest, new)
