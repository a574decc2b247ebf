"""Sines and cosines of whole multiples of angles, as powers and products of unit complex numbers.

Thousands of causes are waves such as cos(12*q4) or sin(2*q1+q3). With z = exp(i q), the phasor of an
angle, exp(i k q) is z to the power of k: a product of two numbers in the place of a sine, which takes
several times as long. Rounding errors are those of the function itself: k times one of the angle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .._typing import Array
from .causes import Applied, Cause, Combined, Named, Number, State

Phasor = NDArray[np.complex128]
# waves that are taken as powers have no more to a turn
MOST_WAVES = 1000


@dataclass(frozen=True, eq=False)
class Phasors:
    """Phasors of the named values of a state, and their powers so far."""

    state: State
    _powers: dict[tuple[str, int], Phasor] = field(default_factory=dict, repr=False)

    def evaluate(self, cause: Applied) -> Array | None:
        """Evaluate a sine or cosine (m,) of a sum of whole multiples of named values; None of any
        other function."""
        if cause.function not in ("sin", "cos"):
            return None
        multiples = _add_multiples(cause.argument)
        if multiples is None:
            return None
        phasor = self._multiply(multiples)
        return phasor.imag if cause.function == "sin" else phasor.real

    def _multiply(self, multiples: dict[str, int]) -> Phasor:
        """Multiply the phasors (m,) of some names, each to the power of its multiple."""
        phasors = [self._raise(name, count) for name, count in multiples.items()]
        product = phasors[0]
        for other in phasors[1:]:
            product = product * other
        return product

    def _raise(self, name: str, count: int) -> Phasor:
        """Raise the phasor of a name to a whole power, by its halves."""
        key = name, count
        if key in self._powers:
            return self._powers[key]
        if count == 1:
            angle = self.state.value(name)
            power: Phasor = np.exp(1j * angle)
        elif count < 0:
            opposite = self._raise(name, -count)
            power = opposite.conj()
        else:
            half = count // 2
            rest = count - half
            power = self._raise(name, half) * self._raise(name, rest)
        self._powers[key] = power
        return power


def _add_multiples(argument: Cause) -> dict[str, int] | None:
    """Add up the whole multiples of named values that an argument is the sum of, by name; None where
    it is no such sum, or empty."""
    total: dict[str, float] = {}
    for term in _list_multiples(argument, 1.0):
        if term is None:
            return None
        name, count = term
        before = total.get(name, 0.0)
        total[name] = before + count
    counts = total.values()
    are_whole = all(map(_is_whole, counts))
    if not total or not are_whole:
        return None
    return {name: int(count) for name, count in total.items()}


def _is_whole(count: float) -> bool:
    """Return whether a count is a whole number of waves, not zero and not too many."""
    size = abs(count)
    is_some = 0 < size <= MOST_WAVES
    return is_some and size.is_integer()


def _list_multiples(cause: Cause, factor: float) -> Iterator[tuple[str, float] | None]:
    """List the multiples of named values in a sum, each times a factor; None for anything else."""
    if isinstance(cause, Named):
        yield cause.name, factor
    elif not isinstance(cause, Combined):
        yield None
    elif cause.operator in "+-":
        yield from _list_multiples(cause.left, factor)
        other = factor if cause.operator == "+" else -factor
        yield from _list_multiples(cause.right, other)
    elif cause.operator == "*" and isinstance(cause.left, Number):
        yield from _list_multiples(cause.right, factor * cause.left.number)
    else:
        yield None
