"""Effects that follow the temperature late, where nothing is known of what went before."""

from __future__ import annotations

from collections.abc import Sequence

from ...measurements.campaign.state_names import StateKind, state_kind
from ...measurements.measurements import Measurements
from ...mechanisms.terms import Term


def list_late_names(terms: Sequence[Term]) -> list[str]:
    """List the temperatures that terms look at late."""
    names = {name for term in terms for screw in term.screws for name in screw.cause.names()}
    return sorted(name for name in names if state_kind(name) is StateKind.LATE)


def describe_unknown_history(terms: Sequence[Term], data: Measurements | None = None) -> list[str]:
    """Describe how the temperature is taken where rows do not say how it came about; in general, where
    there are no rows."""
    is_known = data is not None and data.late_temperature is not None
    if is_known or not list_late_names(terms):
        return []
    sentence = (
        "the arm follows the temperature late; without the times of the rows, the temperature is taken to "
        "have long been what it is."
    )
    return [sentence]
