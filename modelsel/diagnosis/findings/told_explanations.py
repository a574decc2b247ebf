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

from ..._typing import Array, Index
from ..candidates.candidate import Candidate
from ..candidates.signatures import OF_ONE_SHAPE, read_drivers
from ..shapes.candidate_kinds import CandidateKind
from ..shapes.late_temperatures import is_late
from ..shapes.shape_constants import find_time_constant

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
    alike = _find_alike(found, own)
    others = [found[k].prior for k in alike if found[k] is not own]
    return own.prior + sum(others)


def find_constant(found: Sequence[Candidate], g: int, evidence: Array) -> Candidate | None:
    """Find the shape of candidate g with the likeliest constant by its log evidence (G,), whatever
    the priors; it takes over the prior. None where candidate g has it, or has no constant. The masses
    that make a mechanism's torque, declared or unknown, are such a constant."""
    own = found[g]
    alike = _list_constants(found, own)
    best = max(alike, key=lambda k: evidence[k], default=g)
    if evidence[best] <= evidence[g] + SAME:
        return None
    return replace(found[best], prior=own.prior)


def _list_constants(found: Sequence[Candidate], own: Candidate) -> list[int]:
    """List the candidates of a candidate's kind that are of the same shape, or mechanism, with another
    constant; of a shape this one, too."""
    if find_time_constant(own.mechanism) is not None:
        of_kind = [k for k, other in enumerate(found) if other.kind is own.kind]
        warming = [k for k in of_kind if find_time_constant(found[k].mechanism) is not None]
        return _select_driven(found, own, warming)
    alike = _find_alike(found, own)
    if own.kind in WITH_CONSTANT:
        return alike
    names = own.mechanism.names()
    return [k for k in alike if found[k].mechanism.names() != names]


def _find_alike(found: Sequence[Candidate], own: Candidate) -> list[int]:
    """Find the candidates of a candidate's kind that have the same shape, or mechanism, with any
    constant."""
    of_kind = [k for k, other in enumerate(found) if other.kind is own.kind]
    if own.kind in WITH_CONSTANT:
        return _select_driven(found, own, of_kind)
    if own.registered:
        name = own.mechanism.name
        return [k for k in of_kind if found[k].mechanism.name == name]
    if not is_late(own.mechanism):
        return []
    late = [k for k in of_kind if is_late(found[k].mechanism)]
    return _select_driven(found, own, late)


def _select_driven(found: Sequence[Candidate], own: Candidate, numbers: Sequence[int]) -> list[int]:
    """Select the candidates with the places and drivers of one of them."""
    drivers = read_drivers(own)
    alike = []
    for k in numbers:
        of_other = read_drivers(found[k])
        if of_other == drivers:
            alike.append(k)
    return alike
