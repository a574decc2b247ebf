"""An instrument, or a base, that drifts as it warms up is told as one drift, whatever its time constant."""

from __future__ import annotations

import numpy as np
import pytest
from builders import bind, seeds
from exact import flanges_of
from scipy.spatial.transform import Rotation
from searches import search_separated

from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.prior_weights import share_constants
from modelsel.diagnosis.candidates.signatures import LEVELS, PROVEN
from modelsel.fitting.design import Model
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.drifts import DRIFTS, WARM_UPS, warms_up
from modelsel.mechanisms.registry import build_mechanisms, every, mechanism
from modelsel.robot.files import load_robot

NOISE_MM = 0.03
ROWS = 110
TOOL = np.array([40.0, -70.0, 120.0])


@pytest.mark.slow
@seeds(1, 2, 3)
def test_a_warm_up_of_the_base_is_one_drift(rng: np.random.Generator) -> None:
    """It was told as a drift and a step, or as two drifts, or taken for errors that last."""
    arm = load_robot(("irb120", "ur5e", "irb1600")[int(rng.integers(3))])
    q = arm.draw(rng, ROWS)
    flange = flanges_of(arm, q)
    position = flange[:, :3, 3] + flange[:, :3, :3] @ TOOL
    constant = rng.uniform(0.06, 0.6)
    course = 1 - np.exp(-np.arange(ROWS) / (ROWS - 1) / constant)
    # about a level axis that is near none of the frame's own
    axis = np.append(rng.choice([-1.0, 1.0], 2) * rng.uniform(0.5, 1, 2), 0.0)
    turns = course[:, None] * axis / np.linalg.norm(axis) * rng.uniform(4e-4, 8e-4)
    measured = Rotation.from_rotvec(turns).apply(position) + rng.normal(0, NOISE_MM, (ROWS, 3))
    at = bind(arm, build_measurements(q, measured), tuple(TOOL))
    base = Model((mechanism("geometric", arm),))
    (effect,) = search_separated(at, base, build_candidates(at, base, every(arm))).effects
    assert effect.candidate.label == "tracker-drift"
    assert warms_up(effect.candidate.mechanism)
    assert effect.claim is not None
    assert effect.claim.levels[LEVELS.index("cause")] >= PROVEN
    # what is told is the whole change; the angle's constant part is the base's
    change = (turns[-1] - turns[0]) @ arm.joints[0].before[:3, :3]
    assert np.abs((effect.estimate[3:] - change) / effect.standard_error[3:]).max() < 5


def test_warm_ups_weigh_as_much_as_the_other_courses_of_a_drift() -> None:
    drifts = build_mechanisms("tracker-drift", load_robot("ur5e"))
    shares = share_constants(drifts)
    warm = [share for share, drift in zip(shares, drifts, strict=True) if warms_up(drift)]
    assert len(drifts) == len(DRIFTS)
    assert len(warm) == len(WARM_UPS)
    assert sum(warm) == pytest.approx(0.5)
    assert sum(shares) == pytest.approx(1.0)
