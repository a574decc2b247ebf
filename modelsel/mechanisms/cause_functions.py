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


def take_signed_root(value: Array) -> Array:
    """Take the square root of the absolute value, with the sign of the value."""
    size = np.abs(value)
    root = np.sqrt(size)
    return np.asarray(np.copysign(root, value))


FUNCTIONS: dict[str, Callable[[Any], Any]] = {
    "sin": np.sin,
    "cos": np.cos,
    "sign": np.sign,
    "abs": np.abs,
    "exp": np.exp,
    "tanh": np.tanh,
    "root": take_signed_root,
    "saw": rise_and_fall_back,
}
# of them those whose value has no unit, whatever that of the argument
DIMENSIONLESS = {"sin", "cos", "sign", "exp", "tanh", "root", "saw"}
