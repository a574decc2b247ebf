"""An instrument that is louder in one direction, beside an error of the arm: the error is named, no
joint is blamed, and no row is an outlier for a loud coordinate."""

from __future__ import annotations

import numpy as np
import pytest
from builders import OFF_AXIS, bind, seeds, small_arm
from searches import diagnose_rows

from modelsel.diagnosis.findings.outcome import Diagnosis
from modelsel.measurements.measurements import build_measurements
from modelsel.robot.kinematics import forward
from modelsel.selection.evaluation import Split

ARM = small_arm()


def measure(rng: np.random.Generator, rows: int = 120) -> tuple[np.ndarray, np.ndarray]:
    """Readings of an arm whose joint 2 turns unevenly, and positions, eight times louder along z."""
    q = ARM.draw(rng, rows)
    there = q.copy()
    there[:, 1] += 4e-4 * np.sin(9 * q[:, 1] + rng.uniform(0, 6))
    position = forward(ARM, there, np.array(OFF_AXIS))
    return q, position + rng.normal(0, (0.015, 0.015, 0.12), position.shape)


def name(q: np.ndarray, position: np.ndarray) -> tuple[Split, Diagnosis]:
    return diagnose_rows(bind(ARM, build_measurements(q, position)))


@pytest.mark.slow
@seeds(1, 2, 3)
def test_the_wave_is_named_and_the_noise_is_the_instrument_s(rng: np.random.Generator) -> None:
    split, diagnosis = name(*measure(rng))
    assert [effect.candidate.label for effect in diagnosis.effects] == ["gear-ripple:2"]
    names = diagnosis.errors.names
    assert "instrument z" in names
    assert not any(name.startswith("joint") for name in names)
    assert not split.outlying.any()


@pytest.mark.slow
def test_a_row_far_off_is_an_outlier_all_the_same(rng: np.random.Generator) -> None:
    q, position = measure(rng)
    row = int(rng.integers(len(q)))
    position[row, 0] += 0.6
    split, _ = name(q, position)
    assert np.flatnonzero(split.outlying).tolist() == [row]
