"""The rival explanations of a study's findings, and what of the state these and its model look at."""

from __future__ import annotations

import numpy as np

from ...calibration.experiment_design import MAX_RIVALS, Rivals
from ...diagnosis.findings.effects import Effect
from ...measurements.campaign.state_names import StateKind, parse_state_name
from ...mechanisms.terms import Term
from ..pipeline.result import Result


def find_rivals(result: Result) -> list[Rivals]:
    """Return the rival explanations of every finding that has any, with their estimates.

    Rivals are entries of one credible set that do not move the target alike.
    """
    rival_sets = []
    for effect in result.diagnosis.search.effects:
        rivals = _find_rivals_of_effect(result, effect)
        if rivals is not None:
            rival_sets.append(rivals)
    return rival_sets


def _find_rivals_of_effect(result: Result, effect: Effect) -> Rivals | None:
    first, *others = effect.named.entries[:MAX_RIVALS]
    others = [entry for entry in others if entry.probability > 0]
    if not others:
        return None
    entries = [first, *others]
    estimates = []
    for entry in entries:
        estimate = entry.estimate
        if entry.candidate == effect.candidate:
            estimate = effect.estimate
        estimates.append(estimate)
    probability = np.array([entry.probability for entry in entries])
    return Rivals(
        names=tuple(entry.candidate.label for entry in entries),
        terms=tuple(entry.candidate.mechanism.terms for entry in entries),
        estimates=tuple(estimates),
        probability=probability / probability.sum(),
        others=_list_other_terms(result, effect),
    )


def list_used_names(result: Result) -> frozenset[str]:
    """Return the names of the state that the chosen model, or a rival of one of its findings, looks
    at."""
    names = set(result.calibration.needs())
    for rivals in find_rivals(result):
        for terms in rivals.terms:
            for term in terms:
                for screw in term.screws:
                    names |= screw.cause.names()
    return frozenset(names)


def depends_on_approach(result: Result) -> bool:
    """Whether the chosen model, a rival of one of its findings, or a candidate of the study depends
    on the direction from which a joint came."""
    names = set(list_used_names(result))
    for candidate in result.diagnosis.search.offered:
        names |= candidate.mechanism.names()
    variables = [parse_state_name(name) for name in names]
    return any(v is not None and v.kind is StateKind.APPROACH for v in variables)


def _list_other_terms(result: Result, effect: Effect) -> tuple[Term, ...]:
    """Return the chosen model's terms without those that only this effect brings."""
    fitted = result.models.chosen.fit
    effect_mechanism = effect.candidate.mechanism
    effect_keys = {term.key for term in effect_mechanism.terms}
    for other in fitted.model.mechanisms:
        if other != effect_mechanism:
            effect_keys -= {term.key for term in other.terms}
    return tuple(term for term in fitted.terms if term.key not in effect_keys)
