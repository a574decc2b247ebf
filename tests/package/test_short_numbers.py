"""Names with short numbers: four significant digits, and never fewer than stand before the point."""

from __future__ import annotations

import pytest

from modelsel._short_numbers import round_numbers


@pytest.mark.parametrize(
    ("name", "short"),
    [
        ("cos(q2-q3-0.1007809991)", "cos(q2-q3-0.1008)"),
        ("sin(2*q4+1.570796327) & q1-20", "sin(2*q4+1.571) & q1-20"),
        ("tanh(2*(q1-0.000367939)*1.910763522)*free(q2)", "tanh(2*(q1-0.0003679)*1.911)*free(q2)"),
        ("exp(time_s/(-12345.678))", "exp(time_s/(-12346))"),
        ("3.679391234e-05*q1", "3.679e-05*q1"),
        ("temperature_C-20.65", "temperature_C-20.65"),
        ("gear-ripple:4", "gear-ripple:4"),
    ],
)
def test_long_numbers_have_four_digits(name: str, short: str) -> None:
    assert round_numbers(name) == short
