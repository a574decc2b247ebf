"""Usable numbers of an instrument: its scale, its axes, its angles."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ...mechanisms.terms import Mechanism
from .quantities import ARC_SECONDS, Usable, express
from .workspace import Fitted, Range

ANGLES = {
    "tracker-index": "vertical angle off by",
    "tracker-transit": "the two axes off a right angle",
    "tracker-collimation": "beam off its direction",
}
# what the numbers of several errors together are called, by their terms
TERMS = {
    "hc": "horizontal angle with its cosine",
    "hs": "horizontal angle with its sine",
    "vc": "vertical angle with its cosine",
    "vs": "vertical angle with its sine",
    "v0": "vertical angle off by",
    "i": "the two axes off a right angle",
    "c": "beam off its direction",
    "oh": "beam beside the axes, level",
    "ov": "beam beside the axes, upwards",
}


def measure_scale(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure by what share every length is too long."""
    yield express("scale", fitted.range_of(np.ones(1)).scale(1e6), "ppm")


def measure_axes(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure how much longer an axis of the instrument counts than the others do, and by how much two
    are off a right angle."""
    every = np.eye(len(mechanism.terms))
    for term, own in zip(mechanism.terms, every, strict=True):
        size = fitted.range_of(own)
        axes = term.symbol[1:]
        if term.symbol.startswith("e"):
            yield express(f"scale along {axes}", size.scale(1e6), "ppm")
        else:
            angle = size.scale(2 * ARC_SECONDS)
            yield express(f"{axes[0]} and {axes[1]} off a right angle", angle, "arcsec")


def measure_range(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure by how much every distance is too long, or too short."""
    side = "short" if fitted.estimate[0] < 0 else "long"
    yield express(f"every distance too {side} by", fitted.range_of(np.ones(1)), "mm")


def measure_errors(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure every one of several errors of an instrument."""
    every = np.eye(len(mechanism.terms))
    for term, own in zip(mechanism.terms, every, strict=True):
        size = fitted.range_of(own)
        words = TERMS[term.symbol]
        if term.unit == "mm":
            yield express(words, size, "mm")
        else:
            yield express(words, size.scale(ARC_SECONDS), "arcsec")


def measure_angle(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure by how much an angle of the instrument is off."""
    size = fitted.range_of(np.ones(1))
    yield express(ANGLES[mechanism.stem], size.scale(ARC_SECONDS), "arcsec")


def measure_angle_wave(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure the amplitude by which an angle of the instrument errs as it turns."""
    length = _find_length(fitted)
    size = length.scale(ARC_SECONDS)
    yield express("amplitude of the angle's error", size, "arcsec")


def measure_beam_offset(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure how far the beam passes beside the instrument's axes."""
    yield express("beam beside the axes", _find_length(fitted), "mm")


def measure_incidence(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure the largest error of a distance, of those that were measured: the beam may not meet the
    target from other sides at all."""
    measured = replace(fitted, reaches=False)
    row = measured.find_worst()
    yield express("error of a measured distance", measured.moved_at(row), "mm", "at most")


def _find_length(fitted: Fitted) -> Range:
    """Find the length of the vector that the terms' numbers are."""
    length = float(np.linalg.norm(fitted.estimate))
    if length == 0:
        return Range(0.0, 0.0, 0.0)
    return fitted.range_of(fitted.estimate / length)
