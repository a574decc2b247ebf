"""Names of a temperature that is late, and the column that it follows from."""

from __future__ import annotations

from collections.abc import Iterable

from .reference_temperature import TEMPERATURE
from .state_names import StateKind, StateVariable, state_kind


def list_sources(names: Iterable[str]) -> frozenset[str]:
    """List the names that values follow from: of a temperature that is late the column, of any other the
    name itself."""
    return frozenset(TEMPERATURE if state_kind(name) is StateKind.LATE else name for name in names)


def is_temperature(name: str) -> bool:
    """Return whether a name is of the temperature, as it is or late."""
    return list_sources([name]) == {TEMPERATURE}


def name_late(lag: int) -> str:
    """Name the temperature as a mass of some time constant [min] has it."""
    return StateVariable(StateKind.LATE, lag=lag).name
