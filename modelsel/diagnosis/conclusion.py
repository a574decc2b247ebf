"""The conclusion of a search: what the full model needs, how much of it is proven, and what is left.

Effects that chance explains given the others are dropped; shapes outside the registry and the error
map may replace some; the rest is fitted exactly, and each effect gets the claim that is proven."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ..exceptions import number_repeated
from ..fitting.least_squares import Fit
from ..fitting.shrinkage import fit_shrunk
from ..mechanisms.terms import Mechanism
from .candidates.signatures import SHAPELESS, read_parts
from .findings.cancelled_effects import find_cancelling
from .findings.claims import Weighed, build_claim, weigh_claims
from .findings.effects import Effect
from .findings.lone_postures import LONE_FACTOR, find_lone_posture
from .findings.outcome import Diagnosis
from .findings.payload_places import share_by_places
from .findings.steps_apart import tell_steps_apart
from .findings.sure_drivers import find_sure
from .findings.torque_functions import find_bend
from .findings.torque_waves import find_mixed_joint
from .inference.after_selection import AfterSelection, allow_for_search, find_limit
from .inference.evidence import MIN_LOG_ODDS, compute_p_value, compute_single_f
from .reshaping import take_shapes
from .search.dropped_effects import confirm_effects, prune_effects
from .search.model_search import visit_models, weigh_models
from .search.renaming import holds_name, settle_names
from .search.state import LEVEL, Search, extend_model
from .search.stepwise import Exploration, Remainder, explore_further
from .search.views import View
from .search.weighed_models import VisitedModels

# times that shapes which no list has are offered
MAX_OFFERS = 4
# times in a row that they may lead to effects which are less probable than others before
MAX_STRAYED = 1
# times that effects are taken back
MAX_TAKEN_BACK = 2


@dataclass(frozen=True, eq=False)
class Conclusion:
    """A search, and what it keeps: the `chosen` effects, the largest first, and the view of their model.

    `p`: their p-values under every null distribution, once they are confirmed; `known`: the sets of
    effects around them, where they were weighed before."""

    explored: Exploration
    chosen: list[int]
    view: View
    p: dict[int, float] = field(default_factory=dict)
    known: VisitedModels | None = None

    @property
    def mechanisms(self) -> frozenset[Mechanism]:
        """The mechanisms of the effects that it keeps."""
        candidates = self.explored.search.candidates
        return frozenset(candidates[g].mechanism for g in self.chosen)

    @cached_property
    def diagnosis(self) -> Diagnosis:
        """The diagnosis before claims are weighed; of most searches nobody asks for it."""
        return _build_diagnosis(self)

    @cached_property
    def visited(self) -> VisitedModels:
        """The sets of effects around what stays, as many as a better one may be found among."""
        return self.known or visit_models(self.explored.search, self.view, self.chosen)

    @property
    def log_posterior(self) -> float:
        """How probable what stays is beside other conclusions of the same base, whatever they were offered."""
        return self.visited.find_log_posterior(self.chosen)

    @cached_property
    def weighed(self) -> VisitedModels:
        """The same, as many as claims may be weighed by."""
        search = self.explored.search
        view, chosen = self.view, self.chosen
        names = search.traits.nested_names
        weighed = weigh_models(search, view, chosen)
        return weighed.tell_apart(names, chosen)


def conclude(explored: Exploration) -> Conclusion:
    """Drop what the full model does not need."""
    search, progress = explored.search, explored.progress
    chosen, view = prune_effects(search, progress.chosen, progress.view, progress.path)
    return Conclusion(explored, _sort_by_size(search, chosen, view), view)


def confirm(concluded: Conclusion) -> Conclusion:
    """Confirm every effect given the others, under every null distribution."""
    search, path = concluded.explored.search, concluded.explored.progress.path
    p, view = confirm_effects(search, concluded.chosen, concluded.view, path)
    is_same = p.keys() == set(concluded.chosen)
    known = concluded.visited if is_same else None
    return Conclusion(concluded.explored, _sort_by_size(search, p, view), view, p, known)


def prove(concluded: Conclusion) -> Diagnosis:
    """Weigh how much of every effect is proven.

    Effects are taken back where another set of them is more probable, and confirmed. Where a shape
    that no list has explains effects better, the search goes on with it. What stays is the most
    probable that this leads to."""
    concluded, weighed = max(
        _offer_shapes(_settle(concluded)), key=lambda one: one[0].log_posterior
    )
    search = concluded.explored.search
    claimed = replace(
        concluded.diagnosis,
        effects=_claim(concluded, weighed),
        models=concluded.weighed.tell(search.candidates, concluded.chosen),
    )
    search, told = tell_steps_apart(search, claimed)
    return replace(told, map_p=search.compute_map_p(concluded.view))


def _offer_shapes(concluded: Conclusion) -> Iterator[tuple[Conclusion, Weighed]]:
    """Offer shapes that explain effects better again and again, until none does, that leads back to effects
    which there were before, or twice in a row to less probable ones. Generates every conclusion."""
    weighed = _weigh(concluded)
    yield concluded, weighed
    seen = {concluded.mechanisms}
    highest = concluded.log_posterior
    strayed = 0
    for _ in range(MAX_OFFERS):
        reshaped = _take_shapes(concluded, weighed) if weighed.better else None
        if reshaped is None:
            return
        concluded = _settle(reshaped)
        strayed = 0 if concluded.log_posterior > highest else strayed + 1
        if concluded.mechanisms in seen or strayed > MAX_STRAYED:
            return
        seen.add(concluded.mechanisms)
        highest = max(highest, concluded.log_posterior)
        weighed = _weigh(concluded)
        yield concluded, weighed


def _settle(concluded: Conclusion) -> Conclusion:
    """Take effects back, and confirm the others; once more where some were not confirmed."""
    taken = _take_back(concluded)
    confirmed = confirm(taken)
    if len(confirmed.chosen) < len(taken.chosen):
        confirmed = confirm(_take_back(confirmed))
    return _name_again(confirmed)


def _name_again(concluded: Conclusion) -> Conclusion:
    """Name effects again where one has lost its name: it was found beside others that were dropped
    since, beside a step of some of its targets, or beside another spring of its joint."""
    explored, chosen, view = concluded.explored, concluded.chosen, concluded.view
    search, path = explored.search, explored.progress.path
    apart = search.traits.nested_names.tell_apart(chosen)
    is_apart = set(apart) == set(chosen)
    if is_apart and all(holds_name(search, g, view) for g in chosen):
        return concluded
    if not is_apart:
        view = search.try_fit(apart, view.fitted) or view
        chosen = list(apart) if view is not concluded.view else chosen
    named, renamed_view = settle_names(search, chosen, view, None, path)
    in_order = _sort_by_size(search, named, renamed_view)
    return confirm(Conclusion(explored, in_order, renamed_view))


def _take_shapes(concluded: Conclusion, weighed: Weighed) -> Conclusion | None:
    """Put shapes that explain effects better in their place, and continue the search with these;
    None where the data do not determine them."""
    explored, start = concluded.explored, concluded.view.fitted
    reshaped = take_shapes(explored, concluded.chosen, start, weighed.better, weighed.constants)
    return None if reshaped is None else conclude(reshaped)


def _claim(concluded: Conclusion, weighed: Weighed) -> tuple[Effect, ...]:
    """Claim of every effect the levels that hold both against its rivals, given the other effects,
    and over the sets of effects that were weighed."""
    search, chosen = concluded.explored.search, concluded.chosen
    effects = concluded.diagnosis.effects
    visited = concluded.weighed
    members = visited.members.union(chosen)
    parts = {g: read_parts(search.candidates[g], search.traits.acting_parts[g]) for g in members}
    included = visited.include(chosen, search.traits.signatures, parts, search.traits.forms)
    numbers = number_repeated([effect.candidate.label for effect in effects])
    shares = share_by_places([effect.candidate.mechanism for effect in effects])
    claimed = []
    for g, effect, number, share in zip(chosen, effects, numbers, shares, strict=True):
        levels = share * np.minimum(weighed.levels[g], included[g])
        lone = find_lone_posture(search, concluded.view, g)
        if lone is not None:
            levels = LONE_FACTOR * levels
        claim = build_claim(search.problem, search.traits.acting_parts[g], levels)
        if claim.needs_drivers:
            sure = find_sure(search, g, chosen, weighed.drivers[g], visited)
            claim = replace(claim, drivers=tuple(sure.items()))
        claim = replace(claim, bend=find_bend(search.problem, effect), lone_posture=lone)
        with_claim = replace(effect, claim=claim, number=number)
        claimed.append(with_claim)
    return tuple(claimed)


def _take_back(concluded: Conclusion) -> Conclusion:
    """Put a set of effects in the place of the chosen ones, if it is clearly more probable. An effect that
    was given up and named again stays."""
    held: set[int] = set()
    for _ in range(MAX_TAKEN_BACK):
        explored, now = concluded.explored, concluded.chosen
        better = concluded.visited.find_better(now, MIN_LOG_ODDS, held)
        if better is None:
            break
        search = explored.search
        given_up = _join_others(search, now, better)
        put_in = _join_others(search, better, now)
        path = [*explored.progress.path, f"{given_up} -> {put_in}"]
        start = concluded.view.fitted
        # what stays keeps its order
        kept = [g for g in now if g in better]
        added = [g for g in better if g not in kept]
        chosen = [*kept, *added]
        further = explore_further(search, chosen, start, path)
        if further is None:
            break
        searched = conclude(further)
        if not _is_better(searched, concluded):
            break
        named_again = [g for g in searched.chosen if g in now and g not in better]
        held.update(named_again)
        concluded = searched
    return concluded


def _is_better(searched: Conclusion, before: Conclusion) -> bool:
    """Whether a conclusion has other effects than the one before, and these are more probable."""
    led_back = searched.mechanisms == before.mechanisms
    return not led_back and searched.log_posterior > before.log_posterior


def _join_others(search: Search, members: Sequence[int], others: Sequence[int]) -> str:
    """Join the labels of the members that are not among the others."""
    own = [search.candidates[g].label for g in members if g not in others]
    return " & ".join(own) or "nothing"


def _weigh(concluded: Conclusion) -> Weighed:
    return weigh_claims(concluded.explored.search, concluded.view, concluded.chosen)


def _sort_by_size(search: Search, chosen: Iterable[int], view: View) -> list[int]:
    """Sort effects by how far they move the target beyond the base, so that every step of the ladder
    stands on what is larger."""
    size = {}
    for g in chosen:
        moved = search.compute_displacement(g, view)
        size[g] = float(np.linalg.norm(moved))
    return sorted(size, key=lambda g: -size[g])


def _build_diagnosis(concluded: Conclusion) -> Diagnosis:
    """Fit the model exactly, and put the diagnosis together."""
    explored, view, chosen = concluded.explored, concluded.view, concluded.chosen
    search, progress, remainder = explored.search, explored.progress, explored.remainder
    if set(chosen) != set(progress.chosen):
        remainder = _assess_remainder(search, view, chosen)
    model, fitted = view.model, view.fitted
    if chosen:
        # in the order of the effects, by which what follows names the model's mechanisms
        model = extend_model(search.base, [search.candidates[g] for g in chosen])
        fitted = fit_shrunk(search.problem, model, fitted, held="all")
    return Diagnosis(
        base=search.base,
        effects=_build_effects(concluded, fitted),
        model=model,
        fit=fitted,
        path=tuple(progress.path),
        left=remainder.strongest,
        left_p=remainder.p,
        held_back=remainder.held_back,
        bound=search.bound,
        single_f=compute_single_f(search.first.scan, search.first.response),
        offered=search.candidates,
    )


# Tell: the effects, and what is left.


def _assess_remainder(search: Search, view: View, chosen: Sequence[int]) -> Remainder:
    """Assess the strongest explanation of what a model leaves, under both nulls."""
    strongest = search.name_strongest(view, chosen)
    evidence = strongest.evidence
    p = compute_p_value(evidence, search.null)
    if p <= LEVEL:
        p_by_signs = search.compute_sign_p(view, chosen, evidence)
        p = max(p, p_by_signs)
    return Remainder(strongest, p)


def _build_effects(concluded: Conclusion, fitted: Fit) -> tuple[Effect, ...]:
    search, view, chosen = concluded.explored.search, concluded.view, concluded.chosen
    cancelled = find_cancelling(search, chosen, view)
    effects = []
    for g in chosen:
        candidate = search.candidates[g]
        terms = fitted.locate(candidate.mechanism)
        effect = Effect(
            candidate=candidate,
            named=search.rename(g, view).named,
            p=concluded.p[g],
            estimate=fitted.theta[terms],
            standard_error=fitted.standard_errors[terms],
            cancels=cancelled.get(g),
            after_selection=_allow_for_search(search, g, view),
            mixed_joint=find_mixed_joint(search.problem, candidate.mechanism),
        )
        effects.append(effect)
    return tuple(effects)


def _allow_for_search(search: Search, g: int, view: View) -> AfterSelection | None:
    """Allow for the search in the size of an effect, given the others; a free function has none."""
    if search.candidates[g].kind in SHAPELESS:
        return None
    scan, response = search.scan_without(g, view)
    terms = int(scan.sizes[g])
    square = terms * float(compute_single_f(scan, response)[g])
    if not square:
        return None
    critical = float(np.quantile(search.null, 1 - LEVEL, method="higher"))
    freedom = scan.freedom - terms
    limit = find_limit(square, terms, freedom, search.rename(g, view).evidence - critical)
    return allow_for_search(square, limit, terms)
