"""Causes in words: what settles in time, and what something is in proportion to."""

from __future__ import annotations

from ..._short_numbers import round_numbers
from ...exceptions import write_percent, write_rounded
from ...measurements.campaign.late_names import is_temperature
from ...measurements.campaign.reference_temperature import TEMPERATURE
from ...measurements.campaign.state_names import needs_gravity, parse_state_name
from ...mechanisms.causes import Applied, Cause, Combined, Named, Number
from ...mechanisms.terms import Mechanism
from .driver_functions import IN_TIME

# columns of the data that have words of their own
COLUMNS = {
    "payload_kg": "the payload",
    TEMPERATURE: "the temperature",
    "time_s": "the course of the campaign",
}
SETTLING = "settling with a time constant of"
MINUTE, HOUR = 60.0, 3600.0  # s
# of a unit, from which a longer one is told
LONG = 2.0


def name_driver(name: str) -> str:
    """Name a state variable, or a column of the data."""
    variable = parse_state_name(name)
    if variable is not None:
        return variable.words
    return COLUMNS.get(name, f"the column {name}")


def find_constant_of(cause: Cause) -> tuple[str, float] | None:
    """Find the clock by which a cause settles, and its time constant; None of any other cause."""
    match cause:
        case Applied("exp", Combined("/", clock, Number(minus))):
            names = clock.names()
            if names <= IN_TIME and minus < 0:
                (name,) = names
                return name, -minus
    return None


def write_cause(cause: Cause) -> str:
    """Write a cause as names have it: in words where it settles, else as its formula, with long
    numbers rounded."""
    found = find_constant_of(cause)
    if found is None:
        return round_numbers(str(cause))
    name, constant = found
    if name == "since_rest_s":
        return f"{SETTLING} {_write_duration(constant)} after each rest"
    if name == "time_s":
        return f"{SETTLING} {_write_duration(constant)}"
    return f"{SETTLING} {write_percent(constant)} of the campaign"


def _write_duration(seconds: float) -> str:
    """Write a duration [s] in seconds, minutes or hours."""
    if seconds < LONG * MINUTE:
        return f"{write_rounded(seconds)} s"
    if seconds < LONG * HOUR:
        return f"{write_rounded(seconds / MINUTE)} min"
    return f"{write_rounded(seconds / HOUR)} h"


def settles(mechanism: Mechanism) -> bool:
    """Whether a mechanism is one number that settles in time."""
    if len(mechanism.terms) != 1:
        return False
    screws = mechanism.terms[0].screws
    return find_constant_of(screws[0].cause) is not None


def append_cause(mechanism: Mechanism, causes: str) -> str:
    """Return what follows the motion of a mechanism in a sentence: that it settles, what it is in
    proportion to, or else with which `causes` it goes."""
    if settles(mechanism):
        return f", {causes}"
    proportional = _find_proportional(mechanism)
    return f" in proportion to {proportional}" if proportional else f" with {causes}"


def _find_proportional(mechanism: Mechanism) -> str:
    """Find the torque, moment or column that a mechanism of one number is in proportion to, in words;
    empty where it is another function."""
    causes = {screw.cause for term in mechanism.terms for screw in term.screws}
    if len(causes) != 1 or len(mechanism.terms) != 1:
        return ""
    (cause,) = causes
    match cause:
        case Named(name) if needs_gravity(name) or name in COLUMNS:
            return name_driver(name)
        case Combined("-", Named(name), Number(start)) if is_temperature(name):
            return f"{name_driver(name)}, counted from {start:g} °C"
    return ""
