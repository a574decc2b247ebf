"""Targets that slipped at one moment, but not alike, told each by its own move.

A step of all targets and one of a few of these at the same moment are the same model as a step of the
others and one of these few. The first pair says that all moved alike, and by how much the few moved
beyond that; the second says how far each moved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import permutations
from typing import NamedTuple

import numpy as np

from ...exceptions import NotEstimable, number_repeated
from ...fitting.least_squares import Fit, cost
from ...fitting.problem import Problem
from ...fitting.shrinkage import fit_shrunk
from ...mechanisms.environment import STEPS
from ...mechanisms.step_moments import list_step_moments
from ..candidates.candidate import Candidate
from ..candidates.nested_steps import Targets, is_target_step, list_moved_targets
from ..candidates.session_steps import build_step_of, have_own_name
from ..inference.credible_sets import CredibleSet
from ..inference.evidence import compute_single_f
from ..search.state import Search, extend_model
from ..search.weighed_models import WeighedModel
from .effects import Effect
from .outcome import Diagnosis


class _Pair(NamedTuple):
    """Two of several effects by their places: a step of some targets, and one of a part of these; and
    the targets that the `part` leaves to the `rest`."""

    whole: int
    part: int
    rest: Targets


class _Apart(NamedTuple):
    """The steps of the rest and of the part of some targets, and the model that has them, fitted."""

    rest: Candidate
    part: Candidate
    fitted: Fit


def tell_steps_apart(search: Search, diagnosis: Diagnosis) -> tuple[Search, Diagnosis]:
    """Tell steps of some targets and of a part of these as steps of the others and of this part, where
    they began at one moment. Returns the search with the new steps among its candidates, too."""
    for pair in _list_pairs(search.problem, diagnosis.effects):
        apart = _fit_apart(search, diagnosis, pair)
        if apart is not None:
            known = search.traits.numbers
            rest, part, _ = apart
            new = [step for step in (rest, part) if step.mechanism not in known]
            offered = search.offer(new)
            told = _retell(offered, diagnosis, pair, apart)
            return tell_steps_apart(offered, told)
    return search, diagnosis


def _list_pairs(problem: Problem, effects: Sequence[Effect]) -> list[_Pair]:
    """List the steps of which one moves a part of the targets that the other does."""
    steps = [k for k, effect in enumerate(effects) if _is_single(effect.candidate)]
    pairs = []
    for whole, part in permutations(steps, 2):
        every = list_moved_targets(problem, effects[whole].candidate)
        few = list_moved_targets(problem, effects[part].candidate)
        rest = every - few
        if few < every and have_own_name(problem.data, rest):
            pair = _Pair(whole, part, rest)
            pairs.append(pair)
    return pairs


def _is_single(candidate: Candidate) -> bool:
    """Whether a candidate is a step of targets at one moment."""
    mechanism = candidate.mechanism
    moments = list_step_moments(mechanism.terms)
    is_single = len(moments) == 1
    return is_single and is_target_step(candidate)


def _fit_apart(search: Search, diagnosis: Diagnosis, pair: _Pair) -> _Apart | None:
    """Fit the steps of the rest and of the part at one moment, that of either step, whichever fits
    better. None where they began at two moments: that fits better than chance would, as a further
    moment is one of many."""
    coordinates = search.problem.coordinates
    own = cost(diagnosis.fit.reduction)
    best: _Apart | None = None
    least = np.log(len(STEPS))
    for at in _list_moments(diagnosis, pair):
        apart = _try_moment(search, diagnosis, pair, at)
        if apart is None:
            continue
        ratio = cost(apart.fitted.reduction) / own
        loss = coordinates / 2 * np.log(ratio)
        if loss < least:
            best = apart
            least = loss
    return best


def _list_moments(diagnosis: Diagnosis, pair: _Pair) -> list[float]:
    """List the moments of both steps."""
    moments: set[float] = set()
    for place in (pair.whole, pair.part):
        effect = diagnosis.effects[place]
        mechanism = effect.candidate.mechanism
        own = list_step_moments(mechanism.terms)
        moments |= own
    return sorted(moments)


def _try_moment(search: Search, diagnosis: Diagnosis, pair: _Pair, at: float) -> _Apart | None:
    """Fit the steps of the rest and of the part at a moment; None where the data do not determine
    them."""
    whole, part = (diagnosis.effects[k].candidate for k in (pair.whole, pair.part))
    few = list_moved_targets(search.problem, part)
    rest = _move_step(search.problem, whole, pair.rest, at)
    own = _move_step(search.problem, part, few, at)
    if rest is None or own is None:
        return None
    chosen = [effect.candidate for effect in diagnosis.effects]
    chosen[pair.whole] = rest
    chosen[pair.part] = own
    model = extend_model(search.base, chosen)
    try:
        fitted = fit_shrunk(search.problem, model, diagnosis.fit, held="all")
    except NotEstimable:
        return None
    return _Apart(rest, own, fitted)


def _move_step(problem: Problem, step: Candidate, targets: Targets, at: float) -> Candidate | None:
    """Build a step of other targets, or at another moment; None where they have rows on one side of it
    alone."""
    mechanism = step.mechanism
    moved = list_moved_targets(problem, step)
    moments = list_step_moments(mechanism.terms)
    is_own = moved == targets
    if is_own and moments == {at}:
        return step
    built = build_step_of(problem, targets, at)
    if built is None:
        return None
    return replace(step, mechanism=built)


def _retell(search: Search, diagnosis: Diagnosis, pair: _Pair, apart: _Apart) -> Diagnosis:
    """Retell a diagnosis with steps of the rest and of the part of some targets."""
    whole, part = (diagnosis.effects[k] for k in (pair.whole, pair.part))
    effects = list(diagnosis.effects)
    effects[pair.whole] = _retell_effect(search, whole, apart.rest)
    effects[pair.part] = _retell_effect(search, part, apart.part)
    effects = _sort_two(search, _estimate(effects, apart.fitted), pair)
    given_up = f"{whole.candidate.label} & {part.candidate.label}"
    told = f"{apart.rest.label} & {apart.part.label}"
    labels = {whole.candidate.label: apart.rest, part.candidate.label: apart.part}
    chosen = [effect.candidate for effect in effects]
    return replace(
        diagnosis,
        effects=tuple(effects),
        model=extend_model(search.base, chosen),
        fit=apart.fitted,
        path=(*diagnosis.path, f"{given_up} -> {told}"),
        models=_retell_models(diagnosis.models, labels),
        offered=search.candidates,
        single_f=compute_single_f(search.first.scan, search.first.response),
    )


def _retell_effect(search: Search, effect: Effect, step: Candidate) -> Effect:
    """Retell an effect as a step of some of its targets, that takes back nothing of another one."""
    names_by_place = step.mechanism.names_by_place()
    acts = tuple(names_by_place.items())
    claim = effect.claim
    if claim is not None:
        claim = replace(claim, acts=acts)
    named = _retell_set(search.problem, effect, step)
    return replace(effect, candidate=step, named=named, claim=claim, cancels=None)


def _retell_set(problem: Problem, effect: Effect, step: Candidate) -> CredibleSet:
    """Retell the entries of an effect's credible set that have its name."""
    targets = list_moved_targets(problem, step)
    own = effect.candidate.label
    entries = []
    for entry in effect.named.entries:
        candidate = entry.candidate
        moments = list_step_moments(candidate.mechanism.terms)
        if candidate.label == own and len(moments) == 1:
            candidate = _move_step(problem, candidate, targets, moments.pop()) or candidate
        if entry.candidate.mechanism == effect.candidate.mechanism:
            candidate = step
        entries.append(replace(entry, candidate=candidate))
    return replace(effect.named, entries=tuple(entries))


def _estimate(effects: Sequence[Effect], fitted: Fit) -> list[Effect]:
    """Estimate effects by a fitted model that has them, and number those of one name."""
    labels = [effect.candidate.label for effect in effects]
    numbers = number_repeated(labels)
    estimated = []
    for effect, number in zip(effects, numbers, strict=True):
        candidate = effect.candidate
        mechanism = candidate.mechanism
        own = fitted.locate(mechanism)
        estimate = fitted.theta[own]
        error = fitted.standard_errors[own]
        numbered = replace(effect, number=number)
        refitted = replace(numbered, estimate=estimate, standard_error=error)
        estimated.append(refitted)
    return estimated


def _sort_two(search: Search, effects: Sequence[Effect], pair: _Pair) -> list[Effect]:
    """Sort the two steps by how far they move all rows together, the larger first."""
    ordered = list(effects)
    first, second = sorted((pair.whole, pair.part))
    one, other = effects[first], effects[second]
    size = _measure_size(search.problem, one)
    if size < _measure_size(search.problem, other):
        ordered[first] = other
        ordered[second] = one
    return ordered


def _measure_size(problem: Problem, effect: Effect) -> float:
    """Measure by how much a step moves all rows, squared."""
    data = problem.data
    targets = list_moved_targets(problem, effect.candidate)
    (at,) = list_step_moments(effect.candidate.mechanism.terms)
    is_moved = np.isin(data.target, list(targets)) & (data.progress > at)
    square = effect.estimate @ effect.estimate
    return float(square * is_moved.sum())


def _retell_models(
    models: Sequence[WeighedModel], labels: Mapping[str, Candidate]
) -> tuple[WeighedModel, ...]:
    """Retell the sets of effects that have all of some labels, by what these are told as; sets of the
    same names count as one."""
    merged: dict[tuple[str, ...], WeighedModel] = {}
    for model in models:
        own = [effect.label for effect in model.effects]
        effects = model.effects
        if set(labels) <= set(own):
            effects = tuple(labels.get(effect.label, effect) for effect in effects)
        names = tuple(sorted(effect.label for effect in effects))
        told = replace(model, effects=effects)
        other = merged.get(names)
        if other is not None:
            probability = other.probability + model.probability
            told = replace(other, probability=probability, chosen=other.chosen or model.chosen)
        merged[names] = told
    return tuple(merged.values())
