"""Waves among the causes: sines and cosines of an angle, several a turn, of either sign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._typing import Array
from .cause_functions import FUNCTIONS
from .causes import Applied, Cause, Combined, Number


@dataclass(frozen=True)
class Wave:
    """A cause factor * function(count * angle): `function` is "sin" or "cos", `count` > 0 the waves
    a turn of the angle."""

    function: str
    angle: Cause
    count: float
    factor: float = 1.0

    def evaluate(self, angle: Array) -> Array:
        """Evaluate the cause where the angle has these values [rad]."""
        function = FUNCTIONS[self.function]
        values = function(self.count * angle)
        return np.asarray(self.factor * values)


def read_wave(cause: Cause) -> Wave | None:
    """Read a cause as a wave; None of any other.

    A joint that is read the other way has (-1)*sin(3*(-1)*q3)."""
    factor, inner = _split_factor(cause)
    if not isinstance(inner, Applied) or inner.function not in ("sin", "cos"):
        return None
    count, angle = _split_factor(inner.argument)
    if count == 0 or not angle.names():
        return None
    if count < 0 and inner.function == "sin":
        factor = -factor
    return Wave(inner.function, angle, abs(count), factor)


def find_common_wave(causes: Sequence[Cause]) -> tuple[Cause, float] | None:
    """Find (angle, waves a turn of it) where the causes are sine and cosine of one angle, else
    None."""
    waves = [read_wave(cause) for cause in causes]
    known = [wave for wave in waves if wave is not None]
    if len(known) != len(causes) or sorted(wave.function for wave in known) != ["cos", "sin"]:
        return None
    first, second = known
    if first.angle != second.angle or first.count != second.count:
        return None
    return first.angle, first.count


def _split_factor(cause: Cause) -> tuple[float, Cause]:
    """Split a cause into the product of its constant factors and the rest."""
    factor = 1.0
    while isinstance(cause, Combined) and cause.operator == "*":
        left = cause.left
        right = cause.right
        if isinstance(left, Number):
            factor, cause = factor * left.number, right
        elif isinstance(right, Number):
            factor, cause = factor * right.number, left
        else:
            break
    return factor, cause
