"""An instrument whose axes are not square, or have scales of their own: told as that, not as the arm."""

from __future__ import annotations

import numpy as np
import pytest
from builders import OFF_AXIS, bind, seeds
from exact import flanges_of
from searches import search_separated

from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.signatures import PROVEN
from modelsel.fitting.design import Model
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import every, mechanism
from modelsel.robot.files import load_robot


@pytest.mark.slow
@seeds(1, 2)
@pytest.mark.parametrize("name", ["ur5e", "puma760"])
def test_an_instrument_that_skews_is_told(name: str, rng: np.random.Generator) -> None:
    """By the exact chain, and a matrix that no mechanism has; its part that is alike in all directions
    is an arm of longer links, too."""
    arm = load_robot(name)
    q = arm.draw(rng, 90)
    flange = flanges_of(arm, q)
    position = flange[:, :3, 3] + flange[:, :3, :3] @ np.array(OFF_AXIS)
    skew = np.triu(rng.uniform(2e-4, 4e-4, (3, 3)) * rng.choice([-1, 1], (3, 3)), 1)
    np.fill_diagonal(skew, [3e-4, 0, -3e-4])
    measured = position @ (np.eye(3) + skew).T + rng.normal(0, 0.03, position.shape)
    at = bind(arm, build_measurements(q, measured))
    base = Model((mechanism("geometric", arm),))
    (effect,) = search_separated(at, base, build_candidates(at, base, every(arm))).effects
    assert effect.candidate.label == "tracker-axes"
    assert effect.claim is not None
    assert effect.claim.levels[-1] >= PROVEN
    told = dict(
        zip((t.symbol for t in effect.candidate.mechanism.terms), effect.estimate, strict=True)
    )
    stretch = [2 * told["ex"] + told["ey"], told["gxy"], told["gxz"], told["gyz"]]
    planted = [6e-4, skew[0, 1] / 2, skew[0, 2] / 2, skew[1, 2] / 2]
    np.testing.assert_allclose(stretch, planted, atol=1e-4)
