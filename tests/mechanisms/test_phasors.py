"""Sines and cosines as powers and products of unit complex numbers."""

from __future__ import annotations

import numpy as np
import pytest

from modelsel._typing import Array
from modelsel.mechanisms.causes import Applied, Cause, Named, cos, q, sin
from modelsel.mechanisms.phasors import MOST_WAVES, Phasors


class Readings:
    """A state of drawn values, by name."""

    def __init__(self, rng: np.random.Generator):
        self.values = {f"q{j}": rng.uniform(-7, 7, 50) for j in (1, 2, 3)}

    def value(self, name: str) -> Array:
        return self.values[name]


def test_a_wave_is_the_function_of_its_argument(rng: np.random.Generator) -> None:
    readings = Readings(rng)
    phasors = Phasors(readings)
    first, second, third = (int(count) for count in rng.integers(1, 100, 3))
    arguments = {
        q(1): readings.values["q1"],
        float(first) * q(2): first * readings.values["q2"],
        q(2) - float(second) * q(1): readings.values["q2"] - second * readings.values["q1"],
        2.0 * (q(1) + float(third) * q(3)): 2
        * (readings.values["q1"] + third * readings.values["q3"]),
    }
    for argument, angle in arguments.items():
        for cause, expected in ((sin(argument), np.sin(angle)), (cos(argument), np.cos(angle))):
            assert isinstance(cause, Applied)
            values = phasors.evaluate(cause)
            assert values is not None
            # rounding errors of an angle of hundreds of radians
            np.testing.assert_allclose(values, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    "argument",
    [
        2.5 * q(1),
        q(1) + 0.5,
        q(1) - q(1),
        q(1) * q(2),
        q(1) / q(2),
        Applied("abs", q(1)),
        float(MOST_WAVES + 1) * q(1),
    ],
    ids=str,
)
def test_other_arguments_are_no_waves(rng: np.random.Generator, argument: Cause) -> None:
    cause = sin(argument)
    assert isinstance(cause, Applied)
    assert Phasors(Readings(rng)).evaluate(cause) is None


def test_other_functions_are_no_waves(rng: np.random.Generator) -> None:
    assert Phasors(Readings(rng)).evaluate(Applied("tanh", Named("q1"))) is None
