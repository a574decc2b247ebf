"""Reading of a robot file's values, with every problem collected, so that all are said at once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .._typing import LARGEST, Array
from ..exceptions import suggest

# a direction shorter than this has no length
MIN_DIRECTION = 1e-9


class Reader:
    """Reads values of one file and collects every problem, so that all are said at once."""

    def __init__(self, where: str):
        self.where = where
        self.problems: list[str] = []

    def report(self, place: str, problem: str) -> None:
        """Note a problem at a place of the file."""
        is_sentence = problem.endswith((".", "?"))
        if not is_sentence:
            problem += "."
        message = f"{self.where}: {place}: {problem}"
        self.problems.append(message)

    def check_keys(self, place: str, table: Mapping[str, Any], known: set[str]) -> None:
        """Note the keys of a table that are not known."""
        for key in table:
            if key in known:
                continue
            suggestion = suggest(key, known)
            self.report(place, f'unknown key "{key}". {suggestion}')

    def word(self, place: str, value: Any, choices: tuple[str, str]) -> str:
        """Return one of two words; the first, and a problem noted, for any other value."""
        if value in choices:
            return str(value)
        first, second = choices
        self.report(place, f'expected "{first}" or "{second}", found "{value}"')
        return first

    def array(self, place: str, value: Any, shape: tuple[int, ...]) -> Array:
        """Return a finite array of the wanted shape; zeros, and a problem noted, for any other
        value."""
        try:
            array = np.array(value, dtype=float)
        except (TypeError, ValueError, OverflowError):
            array = np.array(np.nan)
        is_numeric = not isinstance(value, (bool, str))
        has_shape = array.shape == shape
        is_bounded = (np.abs(array) <= LARGEST).all()
        if is_numeric and has_shape and is_bounded:
            return array
        expected = "one finite number"
        if shape:
            lengths = " x ".join(map(str, shape))
            expected = f"{lengths} finite numbers"
        is_finite = np.isfinite(array).all()
        if has_shape and is_finite:
            expected += f" below {LARGEST:g}"
        found = str(value)[:120]
        self.report(place, f"expected {expected}, found {found}")
        return np.zeros(shape)

    def number(self, place: str, value: Any) -> float:
        """Return a finite number; 0, and a problem noted, for any other value."""
        number = self.array(place, value, shape=())
        return float(number)

    def vector(self, place: str, value: Any) -> tuple[float, float, float]:
        """Return three finite numbers; zeros, and a problem noted, for any other value."""
        array = self.array(place, value, shape=(3,))
        x, y, z = array.tolist()
        return x, y, z

    def direction(self, place: str, value: Any, problem: str) -> Array | None:
        """Return a vector; None, and the problem noted, where it has no length."""
        direction = self.array(place, value, (3,))
        if np.linalg.norm(direction) >= MIN_DIRECTION:
            return direction
        self.report(place, problem)
        return None
