"""The names of what else an effect could be: rivals, other names of one displacement, other constants."""

from __future__ import annotations

from ..exceptions import sentence_list
from ..measurements.state_names import StateKind, parse_state_name
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
    twins = [one.candidate for one in effect.named.entries if one.candidate.screws == own.screws]
    return list(dict.fromkeys(one.label for one in twins if one.label != own.label))


def describe_open_names(effect: Effect) -> str:
    """Describe what the data leave open: rivals, or the constant alone; and other names of the effect."""
    twins = list_twin_labels(effect)
    others = [label for label in list_rival_labels(effect) if label not in twins]
    rivals = ", ".join(others[:NAMED_RIVALS]) or "others"
    left = f"the data cannot tell this apart from {rivals}"
    if not others and _has_constants(effect):
        left = f"the data do not settle {_name_constant(effect)}"
    if not twins:
        return left
    verb = "is another name" if len(twins) == 1 else "are other names"
    return f"{left}; {sentence_list(twins)} {verb} of the same displacement"


def _has_constants(effect: Effect) -> bool:
    """Return whether the effect's own name is listed with another constant."""
    own = effect.candidate
    listed = [one.candidate for one in effect.named.entries]
    return any(one.label == own.label and one.mechanism != own.mechanism for one in listed)


def _name_constant(effect: Effect) -> str:
    """Name the constant in which explanations of one name differ."""
    variables = [parse_state_name(name) for name in effect.candidate.mechanism.names()]
    kinds = {one.kind for one in variables if one is not None}
    return "the moment" if kinds == {StateKind.PROGRESS} else "its constant"
