"""Where a payload hangs, as springs under it have it: at the target, or anywhere on the flange.

A model that has it hang at the target for one spring and anywhere for another contradicts itself. Then another
part of the arm may as well yield, under a payload that hangs elsewhere: what this does besides is told as the
flange or the last joint, which alone have numbers for that."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..._typing import Array
from ...measurements.campaign.state_names import StateKind, state_kind
from ...mechanisms.bending import PAYLOAD_BENDING
from ...mechanisms.compliance import PAYLOAD, PAYLOAD_DEFLECTION
from ...mechanisms.terms import Mechanism
from ..candidates.signatures import LEVELS

# kinds of what depends on where the target is, where a payload is thought to hang
BY_TARGET = {
    StateKind.UNIT_TORQUE,
    StateKind.UNIT_BENDING,
    StateKind.LOAD_POSITION,
    StateKind.LOAD_ON_FLANGE,
}
# what has numbers for where it hangs
WITH_OWN_PLACE = PAYLOAD_BENDING, PAYLOAD_DEFLECTION
# what is left of a claim where the arm may as well yield elsewhere
EVEN = 0.5


class Places(NamedTuple):
    """Numbers of the mechanisms of a model for which the payload hangs anywhere, and at the target."""

    anywhere: tuple[int, ...]
    at_target: tuple[int, ...]

    @property
    def contradict(self) -> bool:
        """Whether both cannot hold."""
        both = self.anywhere, self.at_target
        return all(both)


def find_places(mechanisms: Sequence[Mechanism]) -> Places:
    """Find where the mechanisms of a model have the payload hang."""
    anywhere, at_target = [], []
    for number, mechanism in enumerate(mechanisms):
        names = mechanism.names()
        if PAYLOAD not in names:
            continue
        kinds = {state_kind(name) for name in names}
        if kinds & BY_TARGET:
            at_target.append(number)
        elif mechanism.stem in WITH_OWN_PLACE:
            anywhere.append(number)
    return Places(tuple(anywhere), tuple(at_target))


def share_by_places(mechanisms: Sequence[Mechanism]) -> Array:
    """Share (k, 4) what the mechanisms of a model claim at every level with what else may yield, where they
    contradict one another: an even chance of all that a payload anywhere tells, and of how much yields to one
    at the target."""
    shape = len(mechanisms), len(LEVELS)
    shares = np.ones(shape)
    places = find_places(mechanisms)
    if not places.contradict:
        return shares
    anywhere = list(places.anywhere)
    at_target = list(places.at_target)
    shaped = LEVELS.index("shape")
    shares[anywhere] = EVEN
    shares[at_target, shaped:] = EVEN
    return shares
