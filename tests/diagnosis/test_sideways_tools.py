"""A tool that stands aside of the flange's axis and droops is told as that, and the link before the flange
is not claimed for it: the end of that link would move the target alike."""

from __future__ import annotations

import numpy as np
import pytest
from builders import bind, seeds
from exact import flanges_of
from scipy.spatial.transform import Rotation
from searches import search_separated

from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.signatures import LEVELS, PROVEN
from modelsel.fitting.design import Model
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import every, mechanism
from modelsel.robot.files import load_robot

NOISE_MM = 0.03
ROWS = 90
G = 9.81


@pytest.mark.slow
@seeds(1, 2, 3)
def test_a_tool_that_stands_aside_and_droops_is_told(rng: np.random.Generator) -> None:
    """Of every arm it was told as the far end of the last link before the flange, with 1.00."""
    arm = load_robot(("irb120", "ur5e", "irb1600")[int(rng.integers(3))])
    tool = rng.choice([-1.0, 1.0], 3) * rng.uniform([80, 80, 60], [160, 160, 120])
    q = arm.draw(rng, ROWS)
    flange = flanges_of(arm, q)
    lever = flange[:, :3, :3] @ tool
    moment = np.cross(lever / 1e3, [0, 0, -G])
    turned = Rotation.from_rotvec(rng.uniform(1e-3, 2e-3) * moment).apply(lever)
    position = flange[:, :3, 3] + turned + rng.normal(0, NOISE_MM, (ROWS, 3))
    at = bind(arm, build_measurements(q, position), tuple(tool))
    base = Model((mechanism("geometric", arm),))
    (effect,) = search_separated(at, base, build_candidates(at, base, every(arm))).effects
    shares = effect.named.sum_by_label()
    assert shares["tool-droop"] > 0.3
    assert set(shares) <= {"tool-droop", f"link-bending:{arm.n - 1}"}
    assert effect.claim is not None
    is_alone = len(shares) == 1
    assert (effect.claim.levels[LEVELS.index("cause")] >= PROVEN) == is_alone


def test_a_target_on_the_flange_s_axis_has_one_droop() -> None:
    """There a tool that turns and one that shifts across the axis move the target alike."""
    arm = load_robot("ur5e")
    q = arm.draw(np.random.default_rng(1), 40)
    base = Model((mechanism("geometric", arm),))
    for tool, forms in (((0.0, 0.0, 120.0), 1), ((30.0, 0.0, 120.0), 2)):
        at = bind(arm, build_measurements(q, np.zeros((40, 3))), tool)
        candidates = build_candidates(at, base, every(arm))
        droops = [one for one in candidates if one.label == "tool-droop"]
        assert len(droops) == forms
        assert sum(one.prior for one in droops) == pytest.approx(
            sum(one.prior for one in candidates if one.label == "tool-stretch")
        )
