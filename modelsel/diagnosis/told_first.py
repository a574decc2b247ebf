"""Which explanation of a finding is told: the one on whose place and drivers most of them agree, with
the likeliest constant of its shape.

Where something moves is told first, then on what that depends: several names of one place may be
likelier together than the most probable name, which has another place. A shape whose constant is
open (the angle of a jump, the power of a torque) was looked for with some constants; which of many it
is costs nothing to ask once the shape stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .._typing import Array, Index
from .candidate_kinds import CandidateKind
from .candidates import Candidate
from .late_temperatures import is_late
from .signatures import OF_ONE_SHAPE, read_drivers
from .warm_ups import find_time_constant

# levels that are told first: place and drivers
FIRST_LEVELS = 2
# kinds of one shape with a constant: the angle at which something sets in, a power, a number of waves
WITH_CONSTANT = (
    *OF_ONE_SHAPE,
    CandidateKind.BUMP,
    CandidateKind.SOFT_LAG,
    CandidateKind.POWER,
    CandidateKind.JOINT_WAVE,
    CandidateKind.SLIDE_WAVE,
)
# log evidence by which a constant is not likelier than another
SAME = 0.1


def find_agreed(
    signatures: Sequence[Index], g: int, probability: Array, levels: Array
) -> int | None:
    """Find the most probable explanation with the place, and then the drivers, that hold most
    probability (G,) together; None where candidate g has these, or holds as much.

    `signatures`: what every candidate says, level by level, -1 nothing; `levels`: the probability
    of what candidate g says, of rivals that are no candidates, too."""
    agree = np.ones(len(probability), bool)
    for known, own in zip(signatures[:FIRST_LEVELS], levels, strict=False):
        agree &= known >= 0
        if not agree.any():
            break
        totals = np.bincount(known[agree], weights=probability[agree])
        most = int(totals.argmax())
        agree &= known == most
        if most == known[g]:
            continue
        if totals[most] > own:
            agreeing = np.where(agree, probability, -1.0)
            likeliest = agreeing.argmax()
            return int(likeliest)
        break
    return None


def sum_constants(found: Sequence[Candidate], g: int) -> float:
    """Sum the prior probabilities of the shape of candidate g with any constant, or of its mechanism
    in any form."""
    own = found[g]
    of_kind = [other for other in found if other.kind is own.kind and other is not own]
    others = [other.prior for other in of_kind if _is_one_question(own, other)]
    return own.prior + sum(others)


def find_constant(found: Sequence[Candidate], g: int, evidence: Array) -> Candidate | None:
    """Find the shape of candidate g with the likeliest constant by its log evidence (G,), whatever
    the priors; it takes over the prior. None where candidate g has it, or has no constant. The masses
    that make a mechanism's torque, declared or unknown, are such a constant."""
    own = found[g]
    of_kind = [k for k, other in enumerate(found) if other.kind is own.kind]
    alike = [k for k in of_kind if _differs_in_constant(own, found[k])]
    best = max(alike, key=lambda k: evidence[k], default=g)
    if evidence[best] <= evidence[g] + SAME:
        return None
    return replace(found[best], prior=own.prior)


def _differs_in_constant(own: Candidate, other: Candidate) -> bool:
    """Return whether a candidate of the same kind is one of the same shape, or mechanism, with another
    constant."""
    if find_time_constant(own.mechanism) is not None:
        drivers = read_drivers(own)
        constant = find_time_constant(other.mechanism)
        return constant is not None and read_drivers(other) == drivers
    if not _is_one_question(own, other):
        return False
    if own.kind in WITH_CONSTANT:
        return True
    names = own.mechanism.names()
    return other.mechanism.names() != names


def _is_one_question(own: Candidate, other: Candidate) -> bool:
    """Return whether a candidate of the same kind has the same shape, or mechanism, with any constant."""
    drivers = read_drivers(own)
    if own.kind in WITH_CONSTANT:
        return read_drivers(other) == drivers
    name = own.registered_name
    if name is None:
        both_late = is_late(own.mechanism) and is_late(other.mechanism)
        return both_late and read_drivers(other) == drivers
    other_name = other.registered_name
    return other_name == name
