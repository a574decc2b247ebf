"""Targets and groups of two campaigns under one numbering: what has one name is one thing, wherever
it stands in the files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..._typing import Array, Index
from ...fitting.design import Model
from ...mechanisms.causes import Applied, Cause, Combined, Member
from ...mechanisms.terms import Mechanism, Screw, Term
from ..calibration import Calibration
from ..known_names import Names, match_names


@dataclass(frozen=True, eq=False)
class CommonNames:
    """Names of targets, or of groups, in two campaigns: `names` are the first's in their order, then
    what the second alone has; `places` are those of the second's names among them."""

    first: Names
    names: Names
    places: Index

    @property
    def shared(self) -> Index:
        """Places of the names that both campaigns have."""
        count = len(self.first)
        is_shared = self.places < count
        shared = self.places[is_shared]
        return np.sort(shared)

    @property
    def sampled(self) -> int:
        """The place of the first name that both have; where they share none, the first's first."""
        shared = self.shared
        if not len(shared):
            return 0
        return int(shared[0])

    @property
    def only_first(self) -> Names:
        """The names that the second campaign does not have."""
        shared = self.shared.tolist()
        only = []
        for place, name in enumerate(self.first):
            if place not in shared:
                only.append(name)
        return tuple(only)

    @property
    def only_second(self) -> Names:
        """The names that the first campaign does not have."""
        count = len(self.first)
        return self.names[count:]

    def arrange(self, own: Array, first: Array) -> Array:
        """Arrange what the second campaign has of each of its names by the common numbering, with
        the first's values for what the second does not have."""
        count = len(self.names)
        of_each = own.shape[1:]
        shape = count, *of_each
        known = len(self.first)
        arranged = np.empty(shape)
        arranged[:known] = first
        arranged[self.places] = own
        return arranged


def number_together(first: Names, second: Names) -> CommonNames:
    """Number the names of two campaigns together; where each has one alone, the two are one."""
    distinct = dict.fromkeys((*first, *second))
    names = tuple(distinct)
    count = len(second)
    others = len(first)
    if others == count == 1:
        names = first
    own = np.arange(count)
    places = match_names(own, second, names)
    return CommonNames(first, names, places)


def renumber(
    c: Calibration, first: Calibration, targets: CommonNames, groups: CommonNames
) -> Calibration:
    """Return the second campaign's calibration with its targets and groups numbered as in the
    first's, in its set-up and in the causes of its terms."""
    places = {"target": targets.places, "group": groups.places}
    mechanisms = [_renumber_mechanism(own, places) for own in c.model.mechanisms]
    tool_rotations = c.tool_rotations
    if tool_rotations is not None:
        still = np.tile(np.eye(3), (len(first.targets), 1, 1))
        tool_rotations = targets.arrange(tool_rotations, still)
    rotations, translations = c.placement
    first_rotations, first_translations = first.placement
    return replace(
        c,
        targets=targets.names,
        groups=groups.names,
        tools=targets.arrange(c.tools, first.tools),
        tool_rotations=tool_rotations,
        placement=(
            groups.arrange(rotations, first_rotations),
            groups.arrange(translations, first_translations),
        ),
        model=Model(tuple(mechanisms)),
    )


def _renumber_mechanism(mechanism: Mechanism, places: Mapping[str, Index]) -> Mechanism:
    terms = []
    for term in mechanism.terms:
        own = _renumber_term(term, places)
        terms.append(own)
    return replace(mechanism, terms=tuple(terms))


def _renumber_term(term: Term, places: Mapping[str, Index]) -> Term:
    screws = []
    for screw in term.screws:
        cause = _renumber_cause(screw.cause, places)
        own = Screw(screw.frame, screw.axis, cause)
        screws.append(own)
    return replace(term, screws=tuple(screws))


def _renumber_cause(cause: Cause, places: Mapping[str, Index]) -> Cause:
    """Return a cause with its targets and groups at their new places."""
    match cause:
        case Member(kind, index):
            return Member(kind, int(places[kind][index]))
        case Applied(function, argument):
            return Applied(function, _renumber_cause(argument, places))
        case Combined(operator, left, right):
            return Combined(operator, _renumber_cause(left, places), _renumber_cause(right, places))
    return cause
