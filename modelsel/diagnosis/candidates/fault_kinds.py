"""Kinds of faults of the data, and those that a registered mechanism stands for."""

from __future__ import annotations

from enum import Enum

from ...mechanisms.terms import Mechanism


class FaultKind(Enum):
    """What kind of fault it is; the value is its name after `fault:`."""

    SWAPPED_REFLECTORS = "swapped-reflectors"
    ROW_ORDER = "row-order"
    TRACKER_BUMPED = "tracker-bumped"
    READ_TOO_EARLY = "read-too-early"
    TIME_OFFSET = "time-offset"

    @property
    def label(self) -> str:
        """The name in findings: "fault:row-order"."""
        return f"fault:{self.value}"


# faults that are mechanisms, by the mechanism's name
BY_MECHANISM = {
    kind.label: kind
    for kind in (FaultKind.TRACKER_BUMPED, FaultKind.READ_TOO_EARLY, FaultKind.TIME_OFFSET)
}


def find_fault_kind(mechanism: Mechanism) -> FaultKind | None:
    """Find the kind of fault that a mechanism stands for; None for an error of the arm."""
    return BY_MECHANISM.get(mechanism.name)
