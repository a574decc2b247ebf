"""Stated uncertainties that differ from row to row and are not quite right: no part of the errors is
made of what they lack, and one that is there is found all the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import OFF_AXIS, small_arm
from scipy.signal import lfilter

from modelsel.fitting.design import Model
from modelsel.fitting.error_structure import ErrorStructure, find_structure
from modelsel.fitting.least_squares import fit
from modelsel.fitting.possible_parts import list_parts
from modelsel.fitting.problem import Problem
from modelsel.fitting.whitening import Whitening
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.kinematics import forward

ARM = small_arm()
TOOL = np.array([OFF_AXIS])
NOISE_MM = 0.06
POSTURES = 90


def campaign(rng: np.random.Generator, lasting_mm: float = 0.0) -> Problem:
    """Noise alike in all rows and directions; stated is a third to the whole of it, each row and
    direction another share. `lasting_mm`: of an error that fades over five visits."""
    q = ARM.draw(rng, POSTURES)
    kept = np.exp(-1 / 5)
    steps = rng.normal(0, lasting_mm * np.sqrt(1 - kept**2), (POSTURES, 3))
    lasting = lfilter([1.0], [1.0, -kept], steps, axis=0)
    noise = rng.normal(0, NOISE_MM, (POSTURES, 3))
    data = build_measurements(q, forward(ARM, q, TOOL[0]) + noise + lasting)
    stated_mm = NOISE_MM * rng.uniform(1 / 3, 1, (POSTURES, 3))
    matrices = np.zeros((POSTURES, 3, 3))
    matrices[:, range(3), range(3)] = 1 / stated_mm
    return replace(Problem(ARM, data, TOOL), whitening=Whitening(1.0, matrices))


def structure_of(at: Problem) -> ErrorStructure:
    used = np.ones(len(at), bool)
    base = Model((mechanism("geometric", ARM),))
    return find_structure(at, used, fit(at, base), list_parts(at, used))


@pytest.mark.parametrize("seed", range(4))
def test_noise_that_is_alike_in_all_rows_is_no_part(seed: int) -> None:
    found = structure_of(campaign(np.random.default_rng(seed)))
    assert found.names == ()


def test_what_lasts_is_found_beside_uncertainties_that_are_not_right() -> None:
    found = structure_of(campaign(np.random.default_rng(0), lasting_mm=0.15))
    assert found.names == ("lasting",)
