"""Families: one number for all joints, or one for each of some."""

from __future__ import annotations

import numpy as np
import pytest
from builders import OFF_AXIS, bind
from exact import flanges_of
from searches import search_separated

from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.fitting.design import Model
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import build_faults, every, mechanism
from modelsel.robot.files import load_robot

ARM = load_robot("ur5e")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("joints", "names"),
    [
        ((1, 2, 3, 4, 5, 6), {"fault:read-too-early"}),
        ((1, 2, 3), {"settle:1", "settle:2", "settle:3"}),
    ],
)
def test_a_large_lag_is_one_number_where_all_joints_have_it(
    joints: tuple[int, ...], names: set[str], rng: np.random.Generator
) -> None:
    """A hundredth of the last move is missing, by the exact chain: 10 mm and more."""
    q = ARM.draw(rng, 100)
    stands = q.copy()
    moving = [j - 1 for j in joints]
    stands[1:, moving] -= 0.01 * np.diff(q, axis=0)[:, moving]
    flange = flanges_of(ARM, stands)
    position = flange[:, :3, 3] + flange[:, :3, :3] @ np.array(OFF_AXIS)
    position += rng.normal(0, 0.03, position.shape)
    at = bind(ARM, build_measurements(q, position))
    base = Model((mechanism("geometric", ARM),))
    found = build_candidates(at, base, (*build_faults(ARM), *every(ARM)))
    diagnosis = search_separated(at, base, found)
    assert {effect.candidate.label for effect in diagnosis.effects} == names
