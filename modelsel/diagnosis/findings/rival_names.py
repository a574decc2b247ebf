"""The names of what else an effect could be: rivals, other names of one displacement, other constants."""

from __future__ import annotations

from ...exceptions import sentence_list
from ...measurements.campaign.state_names import StateKind, parse_state_name
from .effects import Effect

# alternatives that a sentence names
NAMED_RIVALS = 3


def list_rival_labels(effect: Effect) -> list[str]:
    """List the labels of other mechanisms in the credible set, the most probable first."""
    candidate = effect.candidate
    labels: list[str] = []
    for entry in effect.named.entries:
        rival = entry.candidate
        label = rival.label
        is_other = rival.mechanism != candidate.mechanism
        if is_other and label != candidate.label:
            labels.append(label)
    return list(dict.fromkeys(labels))


def list_twin_labels(effect: Effect) -> list[str]:
    """List the labels of other mechanisms that are, with the same constants, the same displacement:
    no measurement tells them from the effect."""
    own = effect.candidate
    screws = own.screws
    labels: list[str] = []
    for entry in effect.named.entries:
        candidate = entry.candidate
        label = candidate.label
        if label == own.label or label in labels:
            continue
        if candidate.screws == screws:
            labels.append(label)
    return labels


def describe_open_names(effect: Effect) -> str:
    """Describe what the data leave open: rivals, or the constant alone; and other names of the effect."""
    twins = list_twin_labels(effect)
    labels = list_rival_labels(effect)
    others = [label for label in labels if label not in twins]
    shown = others[:NAMED_RIVALS]
    rivals = ", ".join(shown)
    left = f"the data cannot tell this apart from {rivals or 'others'}"
    if not others and _has_constants(effect):
        constant = _name_constant(effect)
        left = f"the data do not settle {constant}"
    if not twins:
        return left
    verb = "are other names"
    if len(twins) == 1:
        verb = "is another name"
    names = sentence_list(twins)
    return f"{left}; {names} {verb} of the same displacement"


def _has_constants(effect: Effect) -> bool:
    """Return whether the effect's own name is listed with another constant."""
    own = effect.candidate
    for entry in effect.named.entries:
        candidate = entry.candidate
        if candidate.label != own.label:
            continue
        if candidate.mechanism != own.mechanism:
            return True
    return False


def _name_constant(effect: Effect) -> str:
    """Name the constant in which explanations of one name differ."""
    mechanism = effect.candidate.mechanism
    names = mechanism.names()
    for name in names:
        variable = parse_state_name(name)
        if variable is None:
            return "its constant"
        if variable.kind is not StateKind.PROGRESS:
            return "its constant"
    return "the moment"
