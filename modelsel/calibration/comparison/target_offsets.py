"""Where each of several targets sits on the flange, in two campaigns that number their targets
alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...mechanisms.causes import Member
from ...mechanisms.terms import Term
from ..calibration import Calibration

AXES = ("tx", "ty", "tz")
Offsets = tuple[Term, Term, Term]  # of one target, along the flange's x, y and z


def find_offsets(a: Calibration, b: Calibration, shared: Sequence[int]) -> list[Offsets]:
    """Find the offsets of every target that both campaigns measured; none where there is one target,
    or where a campaign has not fitted them."""
    if len(shared) < 2:
        return []
    known = [_list_offsets(campaign) for campaign in (a, b)]
    offsets = list[Offsets]()
    first, second = known
    for target in shared:
        found = list[Term]()
        for axis in AXES:
            place = target, axis
            if place in first and place in second:
                found.append(first[place])
        if len(found) < len(AXES):
            return []
        x, y, z = found
        offsets.append((x, y, z))
    return offsets


def _list_offsets(c: Calibration) -> dict[tuple[int, str], Term]:
    """List the terms that move one target on the flange, by target and axis."""
    flange = c.robot.n + 1
    offsets = {}
    for term in c.terms:
        if len(term.screws) > 1:
            continue
        for screw in term.screws:
            cause = screw.cause
            is_offset = screw.frame == flange and screw.axis in AXES
            if is_offset and isinstance(cause, Member) and cause.kind == "target":
                offsets[cause.index, screw.axis] = term
    return offsets


def count_from(a: Calibration, b: Calibration, offsets: Sequence[Offsets]) -> Calibration:
    """Return the second campaign's calibration with these targets' offsets counted from where the
    first campaign's study has the targets on the flange."""
    place_of = {term.key: k for k, term in enumerate(b.terms)}
    theta = b.theta.copy()
    for own in offsets:
        first, *_ = own
        (screw,) = first.screws
        cause = screw.cause
        assert isinstance(cause, Member)
        target = cause.index
        apart = b.tools[target] - a.tools[target]
        for term, distance in zip(own, apart.tolist(), strict=True):
            place = place_of[term.key]
            theta[place] += distance
    return replace(b, theta=theta)
