"""Functions that a cause may apply to another one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .._typing import Array

TURN = 2 * np.pi


def rise_and_fall_back(angle: Array) -> Array:
    """Rise evenly from -1 to 1 within every turn of an angle, and fall back at its end."""
    turns = angle / TURN
    begun = np.floor(turns)
    within = turns - begun
    risen = 2 * within - 1
    return np.asarray(risen)


def take_sine(angle: Array) -> Array:
    """Take the sine of an angle [rad]: 2t/(1 + t²) with t = tan(angle/2), numpy's faster one."""
    half = 0.5 * angle
    tangent = np.tan(half)
    divisor = 1.0 + tangent * tangent
    sine: Array = 2.0 * tangent / divisor
    return sine


def take_cosine(angle: Array) -> Array:
    """Take the cosine of an angle [rad]: 2/(1 + t²) - 1 with t = tan(angle/2), as `take_sine`."""
    half = 0.5 * angle
    tangent = np.tan(half)
    divisor = 1.0 + tangent * tangent
    cosine: Array = 2.0 / divisor - 1.0
    return cosine


def take_signed_root(value: Array) -> Array:
    """Take the square root of the absolute value, with the sign of the value."""
    size = np.abs(value)
    root = np.sqrt(size)
    return np.asarray(np.copysign(root, value))


FUNCTIONS: dict[str, Callable[[Any], Any]] = {
    "sin": take_sine,
    "cos": take_cosine,
    "sign": np.sign,
    "abs": np.abs,
    "exp": np.exp,
    "tanh": np.tanh,
    "root": take_signed_root,
    "saw": rise_and_fall_back,
}
# of them those whose value has no unit, whatever that of the argument; root is of its bare number
DIMENSIONLESS = {"sin", "cos", "sign", "exp", "tanh", "root", "saw"}
