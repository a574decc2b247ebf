"""A target that is measured with more noise, beside an error of the arm: the error is named, nothing
else is, and no row is an outlier for being of that target."""

from __future__ import annotations

import numpy as np
import pytest
from builders import OFF_AXIS, seeds, small_arm
from searches import diagnose_rows

from modelsel.diagnosis.findings.outcome import Diagnosis
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.robot.kinematics import forward
from modelsel.selection.evaluation import Split

ARM = small_arm()
TOOLS = np.array([OFF_AXIS, (-60.0, 30.0, 140.0), (10.0, 80.0, 200.0)])
VISITS = 60


def measure(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Readings of an arm whose joint 2 turns unevenly, and positions, six times louder at target 2."""
    q = ARM.draw(rng, VISITS)
    there = q.copy()
    there[:, 1] += 4e-4 * np.sin(9 * q[:, 1] + rng.uniform(0, 6))
    position = np.stack([forward(ARM, there, tool) for tool in TOOLS], axis=1)
    noise = np.array([0.02, 0.12, 0.02])[:, None]
    return q, position + rng.normal(0, noise, position.shape)


def name(q: np.ndarray, position: np.ndarray) -> tuple[Split, Diagnosis]:
    rows = 3 * VISITS
    visit = np.arange(VISITS).repeat(3)
    target = np.tile([1, 2, 3], VISITS).tolist()
    flat = position.reshape(rows, 3)
    data = build_measurements(q[visit], flat, target=target, configuration=visit)
    return diagnose_rows(Problem(ARM, data, TOOLS))


@pytest.mark.slow
@seeds(1, 2, 3)
def test_the_wave_is_named_and_the_noise_is_the_target_s(rng: np.random.Generator) -> None:
    split, diagnosis = name(*measure(rng))
    assert [effect.candidate.label for effect in diagnosis.effects] == ["gear-ripple:2"]
    assert diagnosis.errors.names == ("instrument target 2",)
    assert not split.outlying.any()


@pytest.mark.slow
def test_a_row_far_off_is_an_outlier_all_the_same(rng: np.random.Generator) -> None:
    """At a quiet target by less than a usual row of the loud one is off."""
    q, position = measure(rng)
    visit = int(rng.integers(VISITS))
    position[visit, 0, 0] += 0.4
    split, _ = name(q, position)
    assert np.flatnonzero(split.outlying).tolist() == [3 * visit]
