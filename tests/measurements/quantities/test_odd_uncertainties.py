"""One column of stated uncertainties in another unit than the other two is questioned, before anything
is fitted; uneven ones that an instrument may have are not."""

from __future__ import annotations

import numpy as np
import pytest

from modelsel.measurements.quantities.odd_uncertainties import note_odd_uncertainties


def sentences(*scales: float, rotations: bool = False) -> list[str]:
    rng = np.random.default_rng(1)
    sigma = np.array(scales) * rng.uniform(0.8, 1.2, (30, 1))
    notes = note_odd_uncertainties(*((None, sigma) if rotations else (sigma, None)))
    return [note.sentence for note in notes if note.code == "stated-uncertainty"]


@pytest.mark.parametrize(
    ("scales", "column", "words"),
    [
        ((0.02, 0.02, 20.0), "sz_mm", "1,000 times"),
        ((0.02, 20.0, 0.03), "sy_mm", "Most likely they are in micrometres."),
        ((2e-5, 0.02, 0.02), "sx_mm", "Most likely they are in metres."),
        ((0.02, 0.02, 2.0), "sz_mm", "100 times"),
    ],
)
def test_a_position_column_out_of_line_is_questioned(scales, column, words) -> None:
    (said,) = sentences(*scales)
    assert said.startswith(f"{column}: ")
    assert words in said


def test_degrees_among_radians_are_named() -> None:
    (said,) = sentences(1e-3, 1e-3, 1e-3 * 180 / np.pi, rotations=True)
    assert said.startswith("srz_rad: ")
    assert "Most likely they are in degrees." in said


@pytest.mark.parametrize(
    "scales", [(0.02, 0.02, 0.02), (0.02, 0.02, 0.6), (0.02, 0.0006, 0.02), (0.02, 0.5, 20.0)]
)
def test_uneven_uncertainties_of_an_instrument_are_not(scales) -> None:
    assert sentences(*scales) == []


def test_nothing_stated_is_nothing_to_question() -> None:
    assert note_odd_uncertainties(None, None) == []
