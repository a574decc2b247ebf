"""What is said of a stated uncertainty that is too small does not contradict what the search found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import OFF_AXIS, bind, study_of

from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.noise import Floor
from modelsel.fitting.whitening import Whitening
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward
from modelsel.study.stated_noise import check_stated_noise

ARM = load_robot("puma560")


@pytest.mark.parametrize("sought", [True, False])
def test_where_joints_were_looked_at_their_repeatability_is_not_suspected(rng, sought) -> None:
    """Otherwise one sentence would say that no joint was found, and the next that it is the arm."""
    q = ARM.draw(rng, 80)
    position = forward(ARM, q, np.array(OFF_AXIS)) + rng.normal(0, 0.08, (80, 3))
    at = bind(ARM, build_measurements(q, position))
    at = replace(at, whitening=Whitening(1 / 0.01))
    fitted = fit(at, Model((mechanism("geometric", ARM),)))
    _, _, (note,) = check_stated_noise(study_of(at), Floor(0.01, "stated"), fitted, sought)
    assert ("how well the arm itself repeats" in note.sentence) == (not sought)
    assert ("a mean of many readings" in note.sentence) == sought
