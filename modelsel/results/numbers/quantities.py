"""Quantities: numbers with a name, an interval and a unit, and their words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...diagnosis.findings.sentences import choose_prefix
from ...exceptions import sentence_list, write_rounded
from .workspace import Fitted, Range

# arc seconds of a radian
ARC_SECONDS = float(np.degrees(1.0) * 3600)
# mrad of a radian
MILLI = 1e3
# units of angles, and how many of them a radian is
ANGLES = {"arcsec": ARC_SECONDS, "mrad": MILLI}
# digits of an interval's ends: the usual, and the most that are tried to tell them apart
DIGITS, MAX_DIGITS = 3, 5
# how many times a figure an end of its interval is where the interval chooses the unit
FAR_SMALLER = 10.0


@dataclass(frozen=True)
class Usable:
    """A usable number, its 95 % interval and its words; an end is None where the data leave it
    open."""

    quantity: str
    value: float
    low: float | None
    high: float | None
    unit: str
    text: str


def express(quantity: str, value: Range, unit: str, where: str = "") -> Usable:
    """Express a range as a usable number; with `where` its words are the figure and that. Words tell an
    angle in the unit that its size asks for, as everywhere."""
    shown = value
    sign = f" {unit}"
    if unit in ANGLES:
        units = ANGLES[unit]
        shown, sign = _prefix_angle(value, units)
    size = format_figure(shown.value)
    ends = describe_ends(shown)
    figure = f"{size}{sign}{ends}"
    text = f"{figure} {where}" if where else f"{quantity} {figure}"
    return Usable(quantity, value.value, value.low, value.high, unit, text)


def say_beyond(joints: Sequence[int]) -> str:
    """Say, to follow where a number is of, which joints stand beyond their measured range there; nothing
    where none does."""
    if not joints:
        return ""
    count = len(joints)
    listed = [str(joint) for joint in joints]
    numbers = sentence_list(listed)
    word = "joint" if count == 1 else "joints"
    return f", beyond the measured range of {word} {numbers}"


def say_where(words: str, fitted: Fitted, row: int) -> str:
    """Say where a number is of, and which joints stand beyond their measured range there."""
    joints = fitted.workspace.find_unmeasured(row)
    return f"{words}{say_beyond(joints)}"


def _prefix_angle(value: Range, units: float) -> tuple[Range, str]:
    """Return an angle, of so many units of a radian, in the unit that reads well, and that unit: that of
    its interval where it is small beside this."""
    turn = value.scale(1 / units)
    size = abs(turn.value)
    ends = [abs(end) for end in (turn.low, turn.high) if end is not None]
    largest = max(ends, default=size)
    if largest > FAR_SMALLER * size:
        size = largest
    factor, unit = choose_prefix(size, "rad")
    multiple = 1 / factor
    shown = turn.scale(multiple)
    return shown, f" {unit}"


def describe_ends(value: Range) -> str:
    """Return the 95 % interval in brackets, to follow a figure, with as many digits as tell its ends
    apart; nothing where there is none, or where it takes more than MAX_DIGITS."""
    if value.low is None and value.high is None:
        return ""
    if value.low is None:
        high = format_figure(value.high or 0.0)
        return f" (95 %: at most {high})"
    if value.high is None:
        low = format_figure(value.low)
        return f" (95 %: at least {low})"
    for digits in range(DIGITS, MAX_DIGITS + 1):
        low = write_rounded(value.low, digits)
        high = write_rounded(value.high, digits)
        if low != high:
            return f" (95 %: {low} to {high})"
    return ""


def format_figure(value: float) -> str:
    """Return a figure with three digits, never with an exponent."""
    return write_rounded(value)
