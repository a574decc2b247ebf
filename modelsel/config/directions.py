"""Directions in a study file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

Numbers = TypeVar("Numbers", bound=Sequence[float])


def check_direction(values: Numbers) -> Numbers:
    """Return a direction that has a length. Raises ValueError."""
    if not any(values):
        raise ValueError("the direction has no length; leave the key out where it is not known")
    return values
