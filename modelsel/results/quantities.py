"""Quantities: numbers with a name, an interval and a unit, and their words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .workspace import Range

# arc seconds of a radian
ARC_SECONDS = float(np.degrees(1.0) * 3600)
SIGNS = {"arcsec": "″", "ppm": " ppm", "ppm/K": " ppm/K", "N m/rad": " N m/rad"}
# from which a figure is written without decimals, its thousands apart
LARGE = 1000.0


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
    """Express a range as a usable number; with `where` its words are the figure and that."""
    sign = SIGNS.get(unit, f" {unit}")
    figure = f"{format_figure(value.value)}{sign}{describe_ends(value)}"
    text = f"{figure} {where}" if where else f"{quantity} {figure}"
    return Usable(quantity, value.value, value.low, value.high, unit, text)


def describe_ends(value: Range) -> str:
    """Return the 95 % interval in brackets, to follow a figure; nothing where there is none."""
    if value.low is None and value.high is None:
        return ""
    if value.low is None:
        return f" (95 %: at most {format_figure(value.high or 0.0)})"
    if value.high is None:
        return f" (95 %: at least {format_figure(value.low)})"
    return f" (95 %: {format_figure(value.low)} to {format_figure(value.high)})"


def format_figure(value: float) -> str:
    """Return a figure with three digits, never with an exponent."""
    if value == 0:
        return "0"
    rounded = float(f"{value:.3g}")
    if abs(rounded) >= LARGE:
        return f"{rounded:,.0f}"
    places = max(2 - int(np.floor(np.log10(abs(rounded)))), 0)
    return f"{rounded:.{places}f}"
