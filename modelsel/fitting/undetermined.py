"""Parameters that the data do not determine, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._linalg import connected_components
from ..exceptions import sentence_list
from ..mechanisms.terms import Term
from .identifiability import Identified

MIN_SHARE = 1e-4  # of a column: a smaller part of its combination is not named


@dataclass(frozen=True)
class Unidentifiable:
    """A combination of parameters that the data cannot tell, in words."""

    sentence: str
    parameters: tuple[str, ...]


def describe_unidentifiable(
    identified: Identified, terms: Sequence[Term], leaning: Sequence[int] = ()
) -> tuple[Unidentifiable, ...]:
    """Describe the parameters that move nothing, groups of which only combinations are determined,
    and parameters that the data hardly determine; `leaning`: fitted terms that the prior of usual
    sizes holds as much as the data."""
    symbols = [term.symbol for term in terms]
    out = [
        *_without_effect([symbols[j] for j in identified.zero]),
        *(_entangled(group, identified, symbols) for group in _alias_groups(identified)),
        *_without_direction([symbols[j] for j in identified.still]),
    ]
    if identified.held is not None:
        out.append(_without_length(symbols[identified.held]))
    named = {name for each in out for name in each.parameters}
    out += _hardly_determined([symbols[j] for j in leaning if symbols[j] not in named])
    return tuple(out)


def _alias_groups(identified: Identified) -> list[list[int]]:
    """Terms that depend on one another, group by group, in the order of their first terms."""
    zero = set(identified.zero)
    dependent = [
        j for j in range(len(identified.scale)) if j not in identified.exact and j not in zero
    ]
    pairs = [(j, k) for j in dependent for k in (j, *_partners(identified, j))]
    label = connected_components(len(identified.scale), np.array(pairs, dtype=np.intp))
    groups: dict[int, list[int]] = {}
    for j in sorted({j for pair in pairs for j in pair}):
        groups.setdefault(int(label[j]), []).append(j)
    return list(groups.values())


def _partners(identified: Identified, j: int) -> list[int]:
    """The representatives that make up a dependent column."""
    share = np.abs(identified.relation[j] * identified.scale[list(identified.exact)])
    return [identified.exact[k] for k in np.flatnonzero(share > MIN_SHARE * identified.scale[j])]


def _without_effect(names: Sequence[str]) -> list[Unidentifiable]:
    if not names:
        return []
    verb, them = ("moves", "it") if len(names) == 1 else ("move", "them")
    sentence = (
        f"{sentence_list(names)} {verb} no measured coordinate: the data say nothing of {them}."
    )
    return [Unidentifiable(sentence, tuple(names))]


def _entangled(
    group: Sequence[int], identified: Identified, symbols: Sequence[str]
) -> Unidentifiable:
    """What is said of terms of which only combinations are determined."""
    names = [symbols[j] for j in group]
    dependent = [j for j in group if j not in identified.exact]
    free = len(group) - len(dependent)
    what = "only their sum effect is" if free == 1 else f"only {free} combinations of them are"
    fixed = [symbols[j] for j in dependent if j not in identified.kept]
    remedy = "the fit divides it among them by their usual sizes"
    if fixed:
        remedy = _at_zero(fixed)
    sentence = f"{sentence_list(names)} cannot be told apart: {what} determined; {remedy}."
    return Unidentifiable(sentence, tuple(names))


def _without_direction(names: Sequence[str]) -> list[Unidentifiable]:
    if not names:
        return []
    sentence = (
        f"{_at_zero(names)}: no row is measured in a fixed frame, so that the whole arm may turn "
        "about the touched points, whose positions are unknown."
    )
    return [Unidentifiable(sentence, tuple(names))]


def _without_length(name: str) -> Unidentifiable:
    sentence = (
        f"{_at_zero([name])}: no row measures a length, so that an arm scaled as a whole would fit "
        f"them equally well; all lengths are relative to the drawing's value at {name}."
    )
    return Unidentifiable(sentence, (name,))


def _hardly_determined(names: Sequence[str]) -> list[Unidentifiable]:
    if not names:
        return []
    verb, estimate = (
        ("is", "its estimate is") if len(names) == 1 else ("are", "their estimates are")
    )
    sentence = (
        f"{sentence_list(names)} {verb} hardly determined by these data: {estimate} held near zero "
        "by the usual size of such errors, and the standard error says how far."
    )
    return [Unidentifiable(sentence, tuple(names))]


def _at_zero(names: Sequence[str]) -> str:
    verb = "is" if len(names) == 1 else "are"
    return f"{sentence_list(names)} {verb} kept at zero"
