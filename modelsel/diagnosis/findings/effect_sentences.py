"""One finding in one sentence, and what the catalogue does not expect of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ...exceptions import sentence_list, write_percent, write_rounded
from ...mechanisms.terms import Term
from ..inference.credible_sets import FOUND, Entry
from ..inference.sign_constraints import find_contrary_terms
from ..shapes.shape_constants import find_own_wave
from .effects import Effect
from .rival_names import NAMED_RIVALS, describe_open_names, list_rival_labels
from .sentences import (
    describe_amount,
    describe_cause,
    format_quantity,
    has_contrary_signs,
    label_effect,
    name_joint,
    sum_of_name,
    weigh_listed,
)
from .springs_apart import SpringsApart
from .stated_probability import describe_level_probability, format_probability

# sizes that are unusual for an error of an arm, where the catalogue gives no range
USUAL_SIZE = {"mm": 10.0, "rad": 0.02}


def list_cautions(effect: Effect) -> list[str]:
    """List what the catalogue does not expect of an effect: signs, sizes, what cancels it."""
    cautions = list(_generate_sign_cautions(effect))
    mechanism = effect.candidate.mechanism
    # which the sentence says
    is_told = has_contrary_signs(mechanism, effect.estimate)
    contrary = find_contrary_terms(mechanism, effect.estimate, effect.standard_error)
    for term, is_contrary in zip(mechanism.terms, contrary, strict=True):
        if is_contrary and not is_told:
            cautions.append(
                f"the sign of {term.symbol} is opposite to what physics predicts, so another cause "
                "is likely"
            )
    cautions += _list_size_cautions(effect)
    after = effect.after_selection
    if after is not None and after.differs(effect.estimate, effect.standard_error):
        cautions.append(
            f"allowing for the search, its size is {100 * after.low:.0f} to {write_percent(after.high)} of this (95 %)"
        )
    if effect.claim is not None and effect.claim.waves:
        _, fitted = find_own_wave(mechanism)
        cautions.append(describe_aliases(effect.claim.waves, fitted))
    joint = effect.mixed_joint
    if joint is not None:
        cautions.append(
            f"the gravity torque about joint {joint} goes once a turn, too: what joint {joint} turns "
            "unevenly and what it winds up under its weight are told as one"
        )
    if effect.apart is not None:
        cautions.append(describe_apart(effect.apart))
    if effect.lasting:
        cautions.append(f"errors that last may do the same (probability {effect.lasting:.2f})")
    if effect.cancels is not None:
        other, share = effect.cancels
        cautions.append(
            f"{other} cancels most of it; together they move the target by {write_percent(share)} of what "
            "either does alone: the data do not determine the size of each"
        )
    return cautions


def _generate_sign_cautions(effect: Effect) -> Iterator[str]:
    """Generate a caution for every registered mechanism that only the opposite sign would allow.

    Such a mechanism has the same screws, and physics gives it one sign."""
    entries = effect.named.entries
    alike = [entry for entry in entries if entry.alike]
    explanations: list[Effect | Entry] = [effect, *alike]
    named: set[str] = set()
    for explanation in explanations:
        estimate = explanation.estimate
        for mechanism in explanation.candidate.but_for_sign:
            name = mechanism.name
            is_contrary = has_contrary_signs(mechanism, estimate)
            if not is_contrary or name in named:
                continue
            named.add(name)
            yield f"{name} would do the same with the opposite sign only, so this is not {name}"


def _list_size_cautions(effect: Effect) -> list[str]:
    """List which sizes the data do not determine, and which are larger than usual; of several terms
    that of the most."""
    undetermined = []
    large = []
    terms = effect.candidate.mechanism.terms
    for term, estimate, error in zip(terms, effect.estimate, effect.standard_error, strict=True):
        value = float(estimate)
        largest = _find_usual(term)
        if error > largest:
            undetermined.append((float(error) / largest, term, value))
        elif abs(value) - 2 * error > largest:
            large.append((abs(value) / largest, term, value))
    cautions = []
    if undetermined:
        _, term, _ = max(undetermined, key=lambda one: one[0])
        more = _count_more(undetermined, "of")
        cautions.append(
            f"the data do not determine the size of {term.symbol}{more}: its standard error is larger "
            f"than such an error usually is ({_write_usual(term)})"
        )
    if len(large) == 1:
        ((_, term, _),) = large
        cautions.append(f"{term.symbol} is larger than usual ({_write_usual(term)})")
    elif large:
        _, term, value = max(large, key=lambda one: one[0])
        size = format_quantity(value, None, term.unit)
        cautions.append(
            f"{term.symbol} = {size} is larger than usual ({_write_usual(term)}){_count_more(large, 'so are')}"
        )
    return cautions


def _count_more(listed: Sequence[object], verb: str) -> str:
    """Say of how many more the same holds; nothing where there is one."""
    more = len(listed) - 1
    if more == 0:
        return ""
    return f", and {verb} {more} more"


def _find_usual(term: Term) -> float:
    """Find the largest size of a term that is usual."""
    if term.size is not None:
        return term.size[1]
    return USUAL_SIZE.get(term.unit, np.inf)


def _write_usual(term: Term) -> str:
    largest = _find_usual(term)
    unit = term.unit
    return format_quantity(largest, None, unit)


def describe_effect(effect: Effect, doubt: str = "") -> str:
    """Describe one finding in one sentence; `doubt`, where there is one, stands beside its name."""
    candidate = effect.candidate
    terms = candidate.mechanism.terms
    what = describe_cause(effect, name_joint(effect))
    amount = describe_amount(terms, effect.estimate, effect.standard_error)
    if effect.named.verdict == FOUND:
        standing = _describe_probability(effect)
    else:
        standing = _describe_rivals(effect)
    if doubt:
        standing = f"{standing}, {doubt}"
    parts = [f"{what}: {amount}{standing}", *list_cautions(effect)]
    return "; ".join(parts) + "."


def describe_apart(apart: SpringsApart) -> str:
    """Say of one spring under two loads how it stands to the arm's own weight."""
    times = write_rounded(apart.weight, 2)
    ends = ""
    if apart.low is not None and apart.high is not None:
        ends = f" (95 %: {write_rounded(apart.low, 2)} to {write_rounded(apart.high, 2)})"
    return (
        f"the arm's own weight winds it up {times} times{ends} as far as the masses as declared would, with "
        "the stiffness that it has under the payload"
    )


def describe_aliases(waves: Sequence[int], fitted: float) -> str:
    """Say which other numbers of waves a turn do the same at all readings as the fitted number."""
    shown = [str(count) for count in waves[:NAMED_RIVALS]]
    listed = f"{sentence_list(shown)} waves a turn"
    if len(waves) > NAMED_RIVALS:
        listed = f"{', '.join(shown)} and other numbers of waves a turn"
    return (
        f"{listed} do the same at these readings as the fitted wave of {fitted:g} a turn; readings "
        "between these would tell them apart"
    )


def _describe_probability(effect: Effect) -> str:
    candidate = effect.candidate
    entries = effect.named.entries
    written = _write_probability(effect)
    probability = f"probability {written}"
    if candidate.asked:
        probability += " among those considered"
    text = f" ({label_effect(effect)}, {probability}"
    alike = [e for e in entries if e.alike]
    labels_alike = {e.candidate.label for e in alike}
    rivals = list_rival_labels(effect)
    twins = [rival for rival in rivals if rival in labels_alike]
    if twins:
        scale = weigh_listed(effect)
        share = sum(e.probability for e in alike)
        together = scale * share
        listed = twins[:NAMED_RIVALS]
        named = ", ".join(listed)
        same_move = f"{named} would move the target in the same way"
        text += f"; {same_move}, together {format_probability(together)}"
    return text + ")"


def _write_probability(effect: Effect) -> str:
    """Write how probable the level is that an effect is told at, or the listed name where no level
    was weighed."""
    if effect.claim is None:
        return format_probability(sum_of_name(effect))
    return describe_level_probability(effect.claim.levels)


def _describe_rivals(effect: Effect) -> str:
    odds = []
    scale = weigh_listed(effect)
    weights = effect.named.sum_by_label()
    for label, weight in list(weights.items())[: NAMED_RIVALS + 1]:
        written = format_probability(scale * weight)
        odds.append(f"{label} {written}")
    listed = ", ".join(odds)
    left = describe_open_names(effect)
    return f"; {left} ({listed})"
