"""Parameters that the data do not determine, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .._linalg import connected_components
from ..exceptions import sentence_list
from ..mechanisms.terms import Term
from .identifiability import Identified

MIN_SHARE = 1e-4  # of a column: a smaller part of its combination is not named


@dataclass(frozen=True)
class Unidentifiable:
    """A combination of parameters that the data cannot tell, in words.

    combinations: how many combinations of the parameters are determined; None where they are not entangled.
    at_zero: those of entangled ones that are kept at zero."""

    sentence: str
    parameters: tuple[str, ...]
    combinations: int | None = None
    at_zero: tuple[str, ...] = ()


class Undetermined(Protocol):
    """What `Unidentifiable` has, as computed or as read from a file."""

    @property
    def sentence(self) -> str:
        """The whole of it in words."""

    @property
    def parameters(self) -> Sequence[str]:
        """The parameters that it is about."""

    @property
    def combinations(self) -> int | None:
        """How many combinations of entangled parameters are determined."""

    @property
    def at_zero(self) -> Sequence[str]:
        """Entangled parameters that are kept at zero."""


def describe_unidentifiable(
    identified: Identified,
    terms: Sequence[Term],
    leaning: Sequence[int] = (),
    labels: Sequence[str] | None = None,
) -> tuple[Unidentifiable, ...]:
    """Describe the parameters that move nothing, groups of which only combinations are determined,
    and parameters that the data hardly determine; `leaning`: fitted terms that the prior of usual
    sizes holds as much as the data; `labels`: what the terms are called, each differently; their
    symbols without."""
    symbols = [term.symbol for term in terms] if labels is None else list(labels)
    groups = _alias_groups(identified)
    without_effect = [symbols[j] for j in identified.zero]
    without_direction = [symbols[j] for j in identified.still]
    entangled = [_entangled(group, identified, symbols) for group in groups]
    out = [*_without_effect(without_effect), *entangled, *_without_direction(without_direction)]
    held = identified.held
    if held is not None:
        length = symbols[held]
        relative = _without_length(length)
        out.append(relative)
    named = {name for each in out for name in each.parameters}
    held_by_prior = [symbols[j] for j in leaning]
    others = [name for name in held_by_prior if name not in named]
    out += _hardly_determined(others)
    return tuple(out)


def write_unidentifiable(groups: Sequence[Undetermined]) -> list[str]:
    """Write what the data do not determine: several groups that cannot be told apart in one sentence, in
    place of the first of them."""
    entangled = [one for one in groups if one.combinations is not None]
    if len(entangled) < 2:
        return [one.sentence for one in groups]
    sentences = []
    for one in groups:
        if one is entangled[0]:
            together = _write_entangled(entangled)
            sentences.append(together)
        elif one.combinations is None:
            sentences.append(one.sentence)
    return sentences


def _write_entangled(groups: Sequence[Undetermined]) -> str:
    """Write several groups of which only combinations are determined, a few words each."""
    listed = []
    for one in groups:
        names = sentence_list(one.parameters)
        count = one.combinations
        if count != 1:
            names += f" ({count} combinations)"
        listed.append(names)
    zero: list[str] = []
    is_divided = False
    for one in groups:
        held = one.at_zero
        zero += held
        if not held:
            is_divided = True
    remedy = ""
    where = "The"
    if zero:
        kept = _at_zero(zero)
        remedy = f" {kept}."
        where = "In the other groups the"
    if is_divided:
        remedy += (
            f" {where} fit divides what is determined among the parameters by their usual sizes."
        )
    number = ""
    if any(one.combinations != 1 for one in groups):
        number = " (or as many combinations as are given)"
    together = "; ".join(listed)
    return (
        "Within each of these groups the parameters cannot be told apart, as the data determine only their combined "
        f"effect{number}: {together}.{remedy}"
    )


def _alias_groups(identified: Identified) -> list[list[int]]:
    """Group the terms that depend on one another, group by group, in the order of their first terms."""
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
    """Return the representatives that make up a dependent column."""
    exact = identified.exact
    scale = identified.scale
    columns = list(exact)
    relation = identified.relation
    coefficients = relation[j]
    share = np.abs(coefficients * scale[columns])
    own_scale = scale[j]
    smallest = MIN_SHARE * own_scale
    is_named = share > smallest
    named = np.flatnonzero(is_named)
    return [exact[k] for k in named]


def _without_effect(names: Sequence[str]) -> list[Unidentifiable]:
    if not names:
        return []
    verb, them = ("moves", "it") if len(names) == 1 else ("move", "them")
    sentence = f"{sentence_list(names)} {verb} no measured coordinate: the data contain no information about {them}."
    return [Unidentifiable(sentence, tuple(names))]


def _entangled(
    group: Sequence[int], identified: Identified, symbols: Sequence[str]
) -> Unidentifiable:
    """Describe terms of which only combinations are determined."""
    names = [symbols[j] for j in group]
    exact, kept = identified.exact, identified.kept
    dependent = [j for j in group if j not in exact]
    count = len(group)
    free = count - len(dependent)
    what = f"only {free} combinations of them"
    divided = "their effect"
    has_one = free == 1
    if has_one:
        what = "only their combined effect"
        divided = "it"
    fixed = [symbols[j] for j in dependent if j not in kept]
    remedy = f"the fit divides {divided} among them by their usual sizes"
    if fixed:
        remedy = _at_zero(fixed)
    listed = sentence_list(names)
    sentence = f"{listed} cannot be told apart: the data determine {what}; {remedy}."
    parameters = tuple(names)
    return Unidentifiable(sentence, parameters, free, tuple(fixed))


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
    listed = sentence_list(names)
    is_single = len(names) == 1
    verb = "is" if is_single else "are"
    return f"{listed} {verb} kept at zero"
