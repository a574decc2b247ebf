"""Usable numbers of what the target does on the flange: mm by its weight, a payload or temperature."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...mechanisms.environment import find_references
from ...mechanisms.terms import Mechanism
from ...mechanisms.tools import is_bending
from .quantities import Usable, express
from .workspace import Fitted, Range

# K over which thermal effects are told
RISE = 10.0


def measure_stretch(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure how far gravity along the flange's axis shifts the target."""
    yield express("shift of an upright flange axis", fitted.range_of(np.ones(1)), "mm")


def measure_tool_play(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure the whole play, from one end to the other."""
    half = fitted.range_of(np.ones(1))
    yield express("play along the flange axis", half.scale(2.0), "mm")


def measure_load(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure how far 1 kg shifts the target across the flange's axis and along it."""
    words = ("droop of a level flange axis by 1 kg", "shift of an upright one by 1 kg")
    for what, own in zip(words, np.eye(len(words)), strict=True):
        yield express(what, fitted.range_of(own), "mm")


def measure_droop(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure how far gravity across the flange's axis shifts the target; where the tool turns, how far
    at most."""
    if not is_bending(mechanism):
        yield express("droop of a level flange axis", fitted.range_of(np.ones(1)), "mm")
        return
    row = fitted.find_worst()
    yield express("droop of the tool, at most", fitted.moved_at(row), "mm")


def measure_load_shift(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure how far 1 kg shifts the target on the flange."""
    yield express("shift on the flange by 1 kg", _measure_length(fitted), "mm")


def measure_warm_shift(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure how far 10 K shift the target on the flange."""
    (reference,) = find_references(mechanism.terms[0].screws[0].cause)
    shift = _measure_length(fitted).scale(RISE)
    words = f"per 10 K, counted from {reference:g} °C"
    yield express(f"shift on the flange {words}", shift, "mm", words)


def _measure_length(fitted: Fitted) -> Range:
    """Measure the length of the vector that the terms are the components of."""
    length = float(np.linalg.norm(fitted.estimate))
    if not length:
        return Range(0.0, 0.0, 0.0)
    direction = fitted.estimate / length
    return fitted.range_of(direction)
