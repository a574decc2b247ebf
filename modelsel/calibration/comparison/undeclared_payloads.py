"""Changes that another payload, which nobody declared, would make as well."""

from __future__ import annotations

from collections.abc import Iterable

from ...mechanisms.compliance import PAYLOAD, yields_to_weight
from ..calibration import Calibration
from .mechanism_changes import DEFINITE_CHANGES, MechanismChange, label_mechanism

CHANGED = (*DEFINITE_CHANGES, "changed")


def select_as_by_payload(
    changes: Iterable[MechanismChange], campaigns: Iterable[Calibration]
) -> tuple[MechanismChange, ...]:
    """Select the changes of what yields to the arm's weight; none where both campaigns know the
    payload."""
    yielding = set[str]()
    is_known = []
    for campaign in campaigns:
        is_known.append(PAYLOAD in campaign.ranges)
        for mechanism in campaign.model.mechanisms:
            if yields_to_weight(mechanism):
                yielding.add(label_mechanism(mechanism.name))
    if all(is_known):
        return ()
    selected = []
    for change in changes:
        is_of_weight = not yielding.isdisjoint(change.labels)
        if is_of_weight and change.what in CHANGED:
            selected.append(change)
    return tuple(selected)
