"""Explanations of a study's own, which the search weighs beside those that it has.

They are causes made of columns of the data, at every place or at one; some have a name, and some
a prior probability of their own."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace

from ...mechanisms.terms import Mechanism, TermKey

Screws = frozenset[TermKey]


@dataclass(frozen=True)
class OwnCandidates:
    """Explanations that a study adds together.

    `named`: they have names as registered mechanisms do; `prior`: the probability beforehand that
    an effect is one of these, shared evenly (None: that of other explanations of their kind)."""

    mechanisms: tuple[Mechanism, ...]
    named: bool = False
    prior: float | None = None


def select_beyond(
    own: Collection[OwnCandidates], known: Collection[Screws], base: Screws
) -> tuple[OwnCandidates, ...]:
    """Select what neither the terms of the `base` nor the `known` explanations do already, nor an
    earlier table."""
    seen = set(known)
    selected = []
    for group in own:
        mechanisms = tuple(_generate_new(group, seen, base))
        if mechanisms:
            selected.append(replace(group, mechanisms=mechanisms))
    return tuple(selected)


def list_stated_names(own: Collection[OwnCandidates]) -> frozenset[frozenset[str]]:
    """List the state variables of every explanation whose prior the study states."""
    stated = (group for group in own if group.prior is not None)
    return frozenset(m.names() for group in stated for m in group.mechanisms)


def _generate_new(group: OwnCandidates, seen: set[Screws], base: Screws) -> Iterator[Mechanism]:
    for mechanism in group.mechanisms:
        screws = frozenset(term.key for term in mechanism.terms)
        if screws in seen or screws <= base:
            continue
        seen.add(screws)
        yield mechanism
